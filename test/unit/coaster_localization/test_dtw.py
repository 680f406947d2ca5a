"""Dynamic time warping against a plain double loop and against dtaidistance."""

import numpy as np
import pytest
from dtaidistance import dtw as reference
from hypothesis import given, settings
from hypothesis import strategies as st

from coaster_localization import dtw
from track_localization.errors import DataError


def slow_costs(a, b, penalty=0.0, held=None, open_begin=False):
    """Accumulate costs cell by cell, as paper 1, eqs 1-2, and penalties, say."""
    m, n = len(a), len(b)
    H = np.full((m, n), np.inf)
    for i in range(m):
        stay = 0.0 if held is not None and held[i] else penalty
        for j in range(n):
            h = float(((a[i] - b[j]) ** 2).sum())
            if i == 0 and (j == 0 or open_begin):
                H[i, j] = h
                continue
            options = [np.inf]
            if i:
                options.append(H[i - 1, j] + stay)
            if j:
                options.append(H[i, j - 1] + penalty)
            if i and j:
                options.append(H[i - 1, j - 1])
            H[i, j] = h + min(options)
    return H


def walk(rng, n, channels=1):
    return np.cumsum(rng.normal(size=(n, channels)), axis=0)


@pytest.mark.parametrize('shape', [(1, 1), (1, 7), (7, 1), (2, 2), (40, 23), (23, 40), (61, 61)])
@pytest.mark.parametrize('channels', [1, 3])
@pytest.mark.parametrize('penalty', [0.0, 2.0])
def test_cost_is_the_optimum(shape, channels, penalty):
    rng = np.random.default_rng(shape[0] * 100 + channels)
    a, b = walk(rng, shape[0], channels), walk(rng, shape[1], channels)
    found = dtw.align(a, b, penalty)
    assert found.cost == pytest.approx(slow_costs(a, b, penalty)[-1, -1], rel=1e-5, abs=1e-9)


def test_cost_is_that_of_dtaidistance():
    rng = np.random.default_rng(3)
    a, b = walk(rng, 700)[:, 0], walk(rng, 640)[:, 0]
    distance, _ = reference.warping_paths_fast(a, b)
    assert dtw.align(a, b).cost == pytest.approx(distance**2, rel=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 30), st.integers(1, 30), st.integers(0, 10**6), st.floats(0, 10))
def test_path_is_a_warping_path(m, n, seed, penalty):
    """Every path starts at (0, 0), ends at (m-1, n-1) and steps by (1,0), (0,1) or (1,1)."""
    rng = np.random.default_rng(seed)
    path = dtw.align(walk(rng, m, 2), walk(rng, n, 2), penalty).path
    assert path[0].tolist() == [0, 0]
    assert path[-1].tolist() == [m - 1, n - 1]
    assert {tuple(s) for s in np.diff(path, axis=0)} <= {(1, 0), (0, 1), (1, 1)}


def test_path_costs_what_is_claimed():
    rng = np.random.default_rng(5)
    a, b = walk(rng, 200), walk(rng, 220)
    found = dtw.align(a, b, 0.7)
    sides = (np.diff(found.path, axis=0).sum(axis=1) == 1).sum()
    by_hand = ((a[found.path[:, 0]] - b[found.path[:, 1]]) ** 2).sum() + 0.7 * sides
    assert found.cost == pytest.approx(by_hand, rel=1e-12)


def test_equal_series_match_on_the_diagonal():
    a = walk(np.random.default_rng(1), 300)
    found = dtw.align(a, a)
    assert (found.path[:, 0] == found.path[:, 1]).all()
    assert found.cost == 0.0


@pytest.mark.parametrize('open_begin', [False, True])
def test_open_ends_are_the_least_of_all_ends(open_begin):
    rng = np.random.default_rng(8)
    a, b = walk(rng, 30), walk(rng, 80)
    last = slow_costs(a, b, 0.5, open_begin=open_begin)[-1]
    found = dtw.align(a, b, 0.5, open_begin=open_begin, open_end=True)
    assert found.path[-1].tolist() == [29, int(np.argmin(last))]
    assert found.cost == pytest.approx(last.min(), rel=1e-5)
    assert open_begin or found.path[0].tolist() == [0, 0]


def test_a_cut_out_piece_is_found_where_it_was_cut():
    b = walk(np.random.default_rng(2), 500)
    found = dtw.align(b[120:260], b, 1.0, open_begin=True, open_end=True)
    assert found.path[0].tolist() == [0, 120]
    assert found.path[-1].tolist() == [139, 259]


def test_held_samples_wait_without_penalty():
    """A stop of 50 samples in the middle costs nothing where it is known to be a stop."""
    b = walk(np.random.default_rng(4), 100)
    a = np.concatenate([b[:60], np.repeat(b[59:60], 50, axis=0), b[60:]])
    held = np.zeros(150, bool)
    held[60:110] = True
    found = dtw.align(a, b, 3.0, held=held)
    assert found.cost == pytest.approx(0.0, abs=1e-9)
    assert dtw.align(a, b, 3.0).cost > 10.0
    rng = np.random.default_rng(40)
    a, b, held = walk(rng, 40), walk(rng, 30), rng.uniform(size=40) < 0.3
    expected = slow_costs(a, b, 2.0, held)[-1, -1]
    assert dtw.align(a, b, 2.0, held=held).cost == pytest.approx(expected, rel=1e-5)


def test_constant_series_match_evenly_enough():
    """No shape at all is a defined answer: the shortest path, of cost zero."""
    found = dtw.align(np.ones(50), np.ones(50), 1.0)
    assert found.cost == 0.0
    assert len(found.path) == 50


@pytest.mark.parametrize('factor', [1e-12, 1.0, 1e12, 1e100])
def test_the_scale_of_the_data_does_not_matter(factor):
    rng = np.random.default_rng(9)
    a, b = walk(rng, 80), walk(rng, 90)
    unit = dtw.align(a, b, 0.3)
    scaled = dtw.align(a * factor + 5e4 * factor, b * factor + 5e4 * factor, 0.3 * factor**2)
    assert scaled.cost == pytest.approx(unit.cost * factor**2, rel=1e-4)


@pytest.mark.parametrize(
    ('a', 'b', 'message'),
    [
        (np.zeros(0), np.zeros(3), 'nothing to match'),
        (np.zeros(3), np.zeros((0, 1)), 'nothing to match'),
        (np.array([0.0, np.nan]), np.zeros(3), '1 of 2 samples are not finite'),
        (np.zeros(3), np.array([0.0, np.inf, np.nan]), 'design series: 2 of 3'),
        (np.zeros((3, 2)), np.zeros((3, 1)), '2 measured channels against 1'),
    ],
)
def test_unusable_series_are_named(a, b, message):
    with pytest.raises(DataError, match=message):
        dtw.align(a, b)


@pytest.mark.parametrize('penalty', [-1.0, np.nan, np.inf])
def test_unusable_penalty_is_named(penalty):
    with pytest.raises(DataError, match='step penalty'):
        dtw.align(np.zeros(3), np.zeros(3), penalty)


def test_derivative_is_per_second():
    t = np.arange(200)[:, None] / 50.0
    both = dtw.with_derivative(np.sin(t), 50.0, 0.25)
    np.testing.assert_allclose(both[1:-1, 1], 0.5 * np.cos(t[1:-1, 0]), atol=1e-4)
    assert dtw.with_derivative(np.ones((1, 1)), 50.0, 0.2).tolist() == [[1.0, 0.0]]

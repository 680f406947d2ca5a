"""Segment recombination against an exhaustive, plain program."""

import functools

import numpy as np
import pytest

from coaster_localization import dtw, srdtw
from track_localization.errors import DataError

SEVEN = [(1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 4), (4, 2)]
PAPER = srdtw.GlobalPenalty('power', 1.05, 50.0)


def slow_distance(a, b, weight, penalty=0.0):
    """DTW end value of two pieces by paper 1, eqs 1-2 and 14, cell by cell, double precision."""
    m, n = len(a), len(b)
    H = np.full((m, n), np.inf)
    for i in range(m):
        for j in range(n):
            h = weight(i, j, m, n) * float(((a[i] - b[j]) ** 2).sum())
            options = []
            if i:
                options.append(H[i - 1, j] + penalty)
            if j:
                options.append(H[i, j - 1] + penalty)
            if i and j:
                options.append(H[i - 1, j - 1])
            H[i, j] = h + (min(options) if options else 0.0)
    return H[-1, -1]


def slow_srdtw(a, b, cuts_a, cuts_b, weight, penalty=0.0):
    """Eq. 13 as a recursion over the corners from the end, H(0, 0) = 0; return cost, corners."""

    @functools.cache
    def best(i, j):
        if i == 0 and j == 0:
            return 0.0, ((0, 0),)
        found = (np.inf, ())
        for p, q in SEVEN:
            if i < p or j < q:
                continue
            cost, corners = best(i - p, j - q)
            if cost < np.inf:
                pieces = a[cuts_a[i - p] : cuts_a[i]], b[cuts_b[j - q] : cuts_b[j]]
                cost += slow_distance(*pieces, weight, penalty)
                if cost < found[0]:
                    found = cost, (*corners, (int(cuts_a[i]), int(cuts_b[j])))
        return found

    return best(len(cuts_a) - 1, len(cuts_b) - 1)


def power(i, j, m, n):
    """1.05^d at 50 Hz, d the distance of a point from the line (0, 0) to (m-1, n-1)."""
    corner, point = np.array([m - 1.0, n - 1.0]), np.array([i, j], float)
    length = np.linalg.norm(corner)
    along = corner / length if length else corner
    return 1.05 ** np.linalg.norm(point - along * (point @ along) if length else 0.0)


def linear(i, j, m, n):
    return 1.0 + 10.0 * abs(i / max(m - 1, 1) - j / max(n - 1, 1))


def pair(seed, m, n, P, Q, channels=1):
    """Two smooth random series and random cuts into P and Q segments."""
    rng = np.random.default_rng(seed)
    kernel = np.hanning(9)[:, None]
    a, b = (
        np.apply_along_axis(
            np.convolve, 0, rng.normal(size=(k + 8, channels)), kernel[:, 0], 'valid'
        )
        for k in (m, n)
    )
    cuts = [
        np.concatenate([[0], np.sort(rng.choice(np.arange(1, k), s - 1, replace=False)), [k]])
        for k, s in ((m, P), (n, Q))
    ]
    return a, b, cuts[0], cuts[1]


@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize(
    ('form', 'weight'),
    [(PAPER, power), (srdtw.GlobalPenalty('linear', 10.0), linear)],
)
def test_result_is_the_optimum_of_all_recombinations(seed, form, weight):
    rng = np.random.default_rng(seed)
    P, Q = rng.integers(4, 8, 2)
    a, b, cuts_a, cuts_b = pair(seed, 60, 55, P, Q, channels=1 + seed % 2)
    expected, corners = slow_srdtw(a, b, cuts_a, cuts_b, weight)
    found = srdtw.align_segments(a, b, cuts_a, cuts_b, 50.0, form)
    assert found.cost == pytest.approx(expected, rel=1e-5)
    assert found.corners.tolist() == [list(c) for c in corners]


def test_step_penalty_is_part_of_the_distance():
    a, b, cuts_a, cuts_b = pair(11, 50, 56, 5, 6)
    expected, _ = slow_srdtw(a, b, cuts_a, cuts_b, power, penalty=0.8)
    found = srdtw.align_segments(a, b, cuts_a, cuts_b, 50.0, PAPER, step_penalty=0.8)
    assert found.cost == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize('seed', range(8))
@pytest.mark.parametrize('form', [PAPER, srdtw.GlobalPenalty('linear', 20.0)])
def test_pruning_changes_nothing(seed, form):
    """At 100 Hz the coarse stage bounds the search; unpruned, every corner is visited."""
    a, b, cuts_a, cuts_b = pair(100 + seed, 1200, 1100, 18 + seed, 20)
    pruned = srdtw.align_segments(a, b, cuts_a, cuts_b, 100.0, form)
    dense = srdtw.align_segments(a, b, cuts_a, cuts_b, 100.0, form, prune=False)
    assert pruned.cost == dense.cost
    np.testing.assert_array_equal(pruned.corners, dense.corners)
    np.testing.assert_array_equal(pruned.path, dense.path)


@pytest.mark.parametrize('seed', range(4))
def test_path_is_a_warping_path_through_the_corners(seed):
    a, b, cuts_a, cuts_b = pair(200 + seed, 300, 280, 9, 8)
    found = srdtw.align_segments(a, b, cuts_a, cuts_b, 50.0, PAPER)
    assert found.path[0].tolist() == [0, 0]
    assert found.path[-1].tolist() == [299, 279]
    assert {tuple(s) for s in np.diff(found.path, axis=0)} <= {(1, 0), (0, 1), (1, 1)}
    on_path = {tuple(p) for p in found.path}
    assert all(tuple(c) in on_path for c in found.corners[:-1])
    assert all(tuple(c - 1) in on_path for c in found.corners[1:])
    counts_a, counts_b = (
        np.diff(np.searchsorted(cuts, found.corners[:, k]))
        for k, cuts in enumerate((cuts_a, cuts_b))
    )
    assert set(zip(counts_a.tolist(), counts_b.tolist(), strict=True)) <= set(SEVEN)


def test_one_segment_each_is_one_warping():
    """With a single group and kg = 1 nothing is left but plain DTW."""
    rng = np.random.default_rng(7)
    a, b = rng.normal(size=(70, 1)), rng.normal(size=(60, 1))
    none = srdtw.GlobalPenalty('power', 1.0)
    found = srdtw.align_segments(a, b, np.array([0, 70]), np.array([0, 60]), 50.0, none)
    assert found.cost == pytest.approx(dtw.align(a, b).cost, rel=1e-5)
    np.testing.assert_array_equal(found.corners, [[0, 0], [70, 60]])


@pytest.mark.parametrize(('P', 'Q'), [(1, 4), (4, 1), (2, 7), (3, 10), (12, 3)])
def test_segment_counts_that_cannot_be_used_up_give_none(P, Q):
    """More than three segments against one never fit the seven recombinations."""
    a, b, cuts_a, cuts_b = pair(3, 90, 90, P, Q)
    assert slow_srdtw(a, b, cuts_a, cuts_b, power)[0] == np.inf
    assert srdtw.align_segments(a, b, cuts_a, cuts_b, 50.0, PAPER) is None


def test_penalty_does_not_depend_on_the_rate():
    """A group of twice the samples at twice the rate is weighted alike: 1.05 per 1/50 s."""
    kind, at_50 = PAPER.kernel(50.0)
    assert PAPER.kernel(100.0) == (kind, pytest.approx(at_50 / 2))
    assert np.exp(at_50) == pytest.approx(1.05)


def test_very_long_groups_stay_finite():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(9000, 1)), rng.normal(size=(9100, 1))
    cuts = np.array([0, 9000]), np.array([0, 9100])
    found = srdtw.align_segments(a, b, *cuts, 50.0, srdtw.GlobalPenalty('power', 1.2))
    assert np.isfinite(found.cost)


def test_unusable_input_is_named():
    cuts = np.array([0, 5])
    with pytest.raises(DataError, match='not finite'):
        srdtw.align_segments(np.full(5, np.nan), np.zeros(5), cuts, cuts, 50.0, PAPER)
    for penalty in (srdtw.GlobalPenalty('power', 0.9), srdtw.GlobalPenalty('linear', -1.0)):
        with pytest.raises(DataError, match='must not fall'):
            srdtw.align_segments(np.zeros(5), np.zeros(5), cuts, cuts, 50.0, penalty)


def test_constant_series_have_an_answer():
    cuts = np.array([0, 40])
    found = srdtw.align_segments(np.ones(40), np.ones(40), cuts, cuts, 50.0, PAPER)
    assert found.cost == 0.0
    np.testing.assert_array_equal(found.path[:, 0], found.path[:, 1])

"""The hidden Markov tracker against dense matrices."""

import numpy as np
import pytest

from coaster_localization.tracker import PACES, Tracker

WANDER, JUMP, NOISE = 0.05, 0.02, 0.7


def dense_steps(n, held):
    """Return (nP, nP) transition matrix from (row, pace) to (row, pace), built state by state."""
    P = len(PACES)
    change = np.zeros((P, P))
    for p in range(P):
        change[p, p] = 1.0
        for q in (p - 1, p + 1):
            if 0 <= q < P:
                change[p, q] += WANDER
                change[p, p] -= WANDER
    T = np.zeros((n * P, n * P))
    for j in range(n):
        for p in range(P):
            for q in range(P):
                pace = PACES[q]
                stay, skip = max(1 - pace, 0) + JUMP, max(pace - 1, 0) + JUMP
                step = (0.999, 0.001, 0.0) if held else (stay, 1 - stay - skip, skip)
                for k in range(3):
                    T[j * P + p, min(j + k, n - 1) * P + q] += change[p, q] * step[k]
    return T


def at_all_paces(design):
    """Return (P, n, C): rows that feel the same at any pace."""
    return np.repeat(design[None], len(PACES), axis=0)


def dense(design, rows, held, start, lag):
    """Return the smoothed probabilities of design rows, ``lag`` measured rows ago."""
    P, n = design.shape[:2]
    prior = np.exp(-0.5 * ((PACES - 1.0) / 0.1) ** 2)
    state = np.zeros((n, P))
    state[start] = prior
    state = state.ravel() / state.sum()
    forward, likes = [state], []
    for row, still in zip(rows, held, strict=True):
        h = ((design - row) ** 2).sum(axis=2).T.ravel()
        like = np.exp(-0.5 * (h - h.min()) / NOISE)
        state = (state @ dense_steps(n, still)) * like
        state /= state.sum()
        forward.append(state)
        likes.append(like)
    backward = np.ones(n * P)
    for k in range(lag):
        backward = dense_steps(n, held[-1 - k]) @ (likes[-1 - k] * backward)
    both = forward[-1 - lag] * backward
    return (both / both.sum()).reshape(n, P).sum(axis=1)


@pytest.mark.parametrize('lag', [0, 1, 4])
@pytest.mark.parametrize('seed', range(4))
def test_probabilities_are_those_of_the_chain(seed, lag):
    rng = np.random.default_rng(seed)
    plain = np.cumsum(rng.normal(size=(12, 2)), axis=0)
    design = PACES[:, None, None] ** [2.0, 0.0] * plain
    rows = plain[[1, 2, 3, 3, 4, 6, 8]] + rng.normal(0, 0.4, (7, 2))
    held = np.array([0, 0, 0, 1, 0, 0, 0], dtype=bool)
    tracker = Tracker(design, 5, NOISE, WANDER, JUMP)
    tracker.start(0, 3)
    for row, still in zip(rows, held, strict=True):
        tracker.advance(row, bool(still))
    found, first = tracker.look_back(lag)
    expected = dense(design, rows, held, slice(0, 3), lag)
    np.testing.assert_allclose(found, expected[first : first + len(found)], atol=2e-5)
    assert expected[:first].sum() + expected[first + len(found) :].sum() < 1e-5


def test_only_likely_rows_are_visited():
    rng = np.random.default_rng(1)
    design = np.cumsum(rng.normal(size=(3000, 3)), axis=0)
    tracker = Tracker(at_all_paces(design), 10, 1.0, 0.005, 0.02)
    tracker.start(0, 3000)
    assert tracker.width == 3000
    for k in range(1000, 1100):
        tracker.advance(design[k], False)
    assert tracker.width < 60
    chance, first = tracker.look_back(10)
    assert first + int(np.argmax(chance)) == 1089


def test_a_place_that_fits_nowhere_costs_no_certainty_of_numbers():
    design = np.zeros((50, 1))
    tracker = Tracker(at_all_paces(design), 3, 1e-3, 0.01, 0.01)
    tracker.start(0, 1)
    for _ in range(200):
        tracker.advance(np.array([1e6]), False)
    chance, first = tracker.look_back(3)
    assert np.isfinite(chance).all()
    assert chance.sum() == pytest.approx(1.0)
    assert first + len(chance) == 50
    assert tracker.fit == pytest.approx(1e12)


def test_a_standing_train_stays():
    design = np.zeros((400, 1))
    tracker = Tracker(at_all_paces(design), 3, 1.0, 0.01, 0.01)
    tracker.start(10, 11)
    for _ in range(250):
        tracker.advance(np.zeros(1), True)
    chance, first = tracker.look_back(0)
    assert chance @ (first + np.arange(len(chance))) < 11.0

"""What a bank makes of the passing of a balise: against Bayes' rule and dense updates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.maglev_bank import MEAN, SHARE, close, joseph, one
from scipy import stats

from maglev_localization import bank, hearing, passing
from maglev_localization.line_kernels import SIZE, A, B, C, K, S, V

PITCH, R_LOOP, R_RADAR = 0.2, 0.004, 0.01
POSITION = np.eye(SIZE)[C] - np.eye(SIZE)[B]


def hear_balise(state, told, chainage, R=0.01, length=7000.0, most=100):
    table = np.asarray(chainage, float)
    settings = (0.05, 1e-4, 1e-3, length, most, 0.5)
    return passing.hear_balise(*state, table, np.full(len(table), R), told, *settings)


def test_a_balise_as_told_corrects_the_master():
    """Fused, both locals have the dense update of the global estimate."""
    state = one()
    log_w, x, P, nis, says = hear_balise(state, 1, [100.0, 900.2, 1900.0])
    mean, spread = joseph(MEAN, SHARE * state[2][0, 0], POSITION, 0.2, 0.01)
    heaviest = np.argmax(log_w)
    bank.federate(x, P)
    assert says == hearing.PLAIN
    assert x[heaviest, 0] == pytest.approx(mean, rel=1e-9)
    assert close(SHARE * P[heaviest, 0], spread)
    assert nis == pytest.approx(0.2**2 / (0.03**2 + 0.1**2 + 0.01), rel=1e-9)


@pytest.mark.parametrize('told', [0, 2, -1])
def test_a_wrong_or_unknown_id_is_that_of_the_balise_at_hand(told):
    log_w, x, _, _, says = hear_balise(one(), told, [100.0, 900.2, 1900.0])
    heaviest = np.argmax(log_w)
    assert says == hearing.NEARBY
    assert POSITION @ x[heaviest, 0] == pytest.approx(900.1, abs=0.05)


def test_the_odds_of_balises_are_bayes():
    """Two balises 1 m apart, the train between them: id and distance decide."""
    log_w, x, *_ = hear_balise(one(), 0, [899.5, 900.5, 5000.0])
    place = x[:, 0, C] - x[:, 0, B]
    sigma = math.sqrt(0.03**2 + 0.1**2 + 0.01)
    expected = (
        0.95 / (0.05 / 2.0) * stats.norm.pdf(0.5, scale=sigma) / stats.norm.pdf(0.5, scale=sigma)
    )
    weights = [math.exp(log_w[np.argmin(np.abs(place - p))]) for p in (899.7, 900.3)]
    assert weights[0] / weights[1] == pytest.approx(expected, rel=1e-6)


def test_a_passing_where_no_balise_is_changes_nothing():
    """An id that nobody knows, 100 m from any balise."""
    log_w, x, P, _, says = hear_balise(one(), -1, [100.0, 1000.0, 1900.0])
    assert says == hearing.IGNORED
    assert len(log_w) == 1
    assert np.array_equal(x, one()[1])
    assert np.array_equal(P, one()[2])


def test_a_balise_far_astray_may_be_right():
    """
    1 km from where the train is thought to be, by its own id: it moves, or the passing is nothing.

    Both densities are flat over the line, so the odds are 0.001 x 0.95 to 0.0001.
    """
    log_w, x, P, _, says = hear_balise(one(), 2, [100.0, 1000.0, 1900.0])
    assert says == hearing.MOVED
    assert len(log_w) == 2
    assert math.exp(log_w[0] - log_w[1]) == pytest.approx(9.5, rel=1e-9)
    bank.federate(x, P)
    assert POSITION @ x[0, 0] == pytest.approx(1900.0, abs=1e-9)
    assert SHARE * POSITION @ P[0, 0] @ POSITION == pytest.approx(0.01, rel=1e-9)
    assert x[0, 0, [C, V, A, S, K]] == pytest.approx(MEAN[[C, V, A, S, K]], rel=1e-12)


def test_from_anywhere_every_balise_is_possible():
    """The id is right in 19 of 20 passings; the other is any of the rest, wherever the train is."""
    sigma = [0.03, 0.05, 0.1, 3500.0, 1e-4, 2e-3]
    log_w, x, *_ = hear_balise(one(b=-3000.0, sigma=sigma), 2, np.arange(1, 7) * 1000.0)
    w = np.exp(log_w)
    place = x[:, 0, C] - x[:, 0, B]
    inside = [w[np.abs(place - p) < 1.0].sum() for p in np.arange(1, 7) * 1000.0]
    prior = stats.norm.pdf(np.arange(1, 7) * 1000.0 - 3500.0, scale=3500.0)
    chance = np.array([0.01, 0.01, 0.95, 0.01, 0.01, 0.01])
    expected = prior * chance
    assert np.array(inside) / sum(inside) == pytest.approx(expected / expected.sum(), rel=1e-2)


def test_an_empty_table_tells_nothing():
    _, x, P, _, says = hear_balise(one(), -1, [])
    assert says == hearing.IGNORED
    assert np.array_equal(x, one()[1])
    assert np.array_equal(P, one()[2])


def test_hypotheses_are_bounded_in_number():
    """Readings that allow several accounts each, for a thousand readings: never more than asked."""
    rng = np.random.default_rng(3)
    state = one(sigma=[0.1, 0.05, 0.1, 0.1, 1e-4, 2e-3])
    for k in range(1000):
        reading = 500.0 + 0.1 * rng.normal()
        log_w, x, P, *_ = hearing.hear_loop(
            *state, reading, R_LOOP, PITCH, 0.05, 0.05, 0.1, 8, rng.random()
        )
        assert 1 <= len(log_w) <= 8
        assert np.exp(log_w).sum() == pytest.approx(1.0, rel=1e-9)
        state = (log_w, x, P) if k % 50 else (log_w[:1] * 0.0, x[:1], P[:1] + one()[2])

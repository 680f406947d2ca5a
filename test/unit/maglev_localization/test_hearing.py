"""What a bank makes of one reading of loop or radar: against scipy, Bayes' rule, dense updates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.maglev_bank import MEAN, SHARE, close, joseph, one
from scipy import stats

from maglev_localization import bank, hearing, standing
from maglev_localization.line_kernels import SIZE, A, B, C, K, V

PITCH, R_LOOP, R_RADAR = 0.2, 0.004, 0.01
MISSED, EXTRA, BURST = 3e-4, 1e-4, 1e-3
POSITION = np.eye(SIZE)[C] - np.eye(SIZE)[B]


def hear_loop(state, reading, pitch=PITCH, most=100, burst=BURST, missed=MISSED):
    return hearing.hear_loop(*state, reading, R_LOOP, pitch, missed, EXTRA, burst, most, 0.5)


def hear_radar(state, speed, most=100, outlier=0.02, slip=1.5e-4, unseen=(0.0, 0.0), least=0.0):
    settings = (outlier, slip, 0.03, least)
    return hearing.hear_radar(*state, speed, R_RADAR, *settings, *unseen, most, 0.5)


def test_densities_are_scipys(rng):
    for nu, sigma in zip(rng.normal(size=20), rng.exponential(size=20), strict=True):
        expected = stats.norm.logpdf(nu, scale=sigma)
        assert hearing.log_normal(nu, sigma**2) == pytest.approx(expected, rel=1e-12)
    for count in range(5):
        for expected in (1e-6, 0.3, 4.0):
            chance = stats.poisson.pmf(count, expected)
            assert hearing.poisson(count, expected) == pytest.approx(chance, rel=1e-12)


def test_a_reading_as_expected_is_a_kalman_update_of_the_loops_filter():
    state = one()
    log_w, x, P, nis, says, singles = hear_loop(state, 500.05)
    mean, spread = joseph(MEAN, state[2][0, 0], np.eye(SIZE)[C], 0.05, R_LOOP)
    heaviest = np.argmax(log_w)
    assert says == hearing.PLAIN
    assert x[heaviest, 0] == pytest.approx(mean, rel=1e-12)
    assert close(P[heaviest, 0], spread)
    assert np.array_equal(x[heaviest, 1], MEAN)
    assert nis == pytest.approx(0.05**2 / (2.0 * 0.03**2 + R_LOOP), rel=1e-12)
    assert singles < 0.01


def loop_odds(nu, spread, missed=MISSED):
    """Return the weights of crossings jumped by Bayes' rule; jump 0 with a reading that is void."""
    nearest = round(nu / PITCH)
    w = {
        0: math.exp(-missed - EXTRA) * stats.norm.pdf(nu, scale=spread) + 1e-6 / max(200.0, abs(nu))
    }
    for j in (nearest - 1, nearest, nearest + 1):
        if j == 0:
            continue
        chance = BURST / 60 if abs(j) <= 60 else BURST / 6000
        if abs(j) <= 3:
            chance += stats.poisson.pmf(abs(j), missed if j < 0 else EXTRA)
        w[j] = chance * stats.norm.pdf(nu - j * PITCH, scale=spread)
    return {j: one / sum(w.values()) for j, one in w.items()}


@pytest.mark.parametrize('missed', [MISSED, 0.3])
@pytest.mark.parametrize('crossings', [-1, -2, 1, -4, -17, 60, -61, 61, -4000, 2])
def test_the_odds_of_a_miscount_are_bayes(crossings, missed):
    """
    A reading 1 cm from so many crossings off: every account of it has chance times density.

    The filter adds 1e-12 to chances, 6e-6 of the least of these, and drops weights of a millionth.
    """
    state = one(sigma=[0.03, 0.05, 0.1, 0.05, 1e-4, 2e-3])
    nu, spread = 0.01 + crossings * PITCH, math.sqrt(2.0 * 0.03**2 + R_LOOP)
    log_w, x, _, _, _, singles = hear_loop(state, 500.0 + nu, missed=missed)
    jumped = np.round((x[:, 0, B] - MEAN[B]) / PITCH).astype(int)
    expected = loop_odds(nu, spread, missed)
    for j, weight in expected.items():
        assert np.exp(log_w[jumped == j]).sum() == pytest.approx(weight, rel=1e-5, abs=1e-5)
    seen = sum(-j * weight for j, weight in expected.items() if -3 <= j < 0)
    assert singles == pytest.approx(seen, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize('crossings', [-5, -29, 40, -200, -2500, 5_000_000])
def test_a_count_that_jumps_leaves_the_train(crossings):
    """A burst, a glitch, a dead zone, a counter that starts over: whole crossings, all of them."""
    log_w, x, _, _, says, _ = hear_loop(one(), 500.0 + crossings * PITCH)
    heaviest = np.argmax(log_w)
    assert says == hearing.SHIFT
    assert x[heaviest, :, B] == pytest.approx(MEAN[B] + crossings * PITCH, abs=1e-6)
    assert x[heaviest, :, C] - x[heaviest, :, B] == pytest.approx(900.0, abs=1e-6)


@pytest.mark.parametrize('reading', [499.0, 620.0, 0.0, 9.9e6])
def test_a_count_that_jumps_by_no_known_unit_begins_anew(reading):
    """Without a pitch a jump has any size: the train stays, to all the digits of its variance."""
    state = one()
    log_w, x, P, _, says, _ = hear_loop(state, reading, pitch=0.0)
    heaviest = np.argmax(log_w)
    assert says == hearing.UNKNOWN
    assert x[heaviest, 0, C] == reading
    bank.federate(x, P)
    assert x[heaviest, 0, C] == pytest.approx(reading, abs=1e-3)
    assert POSITION @ x[heaviest, 0] == pytest.approx(900.0, abs=1e-6)
    place = POSITION @ P[heaviest, 0] @ POSITION * SHARE
    assert place == pytest.approx(0.03**2 + 0.1**2, rel=1e-3)
    assert P[heaviest, 0, C, C] * SHARE == pytest.approx(R_LOOP, rel=0.01)


@pytest.mark.parametrize('reading', [600.0, 9.9e6])
def test_after_such_a_jump_both_filters_go_on(reading):
    """The radar's filter does not stay behind: fused, both are one again after any jump."""
    log_w, x, P, *_ = hear_loop(one(), reading, pitch=0.0)
    x, P = x[:1], P[:1]
    bank.federate(x, P)
    assert (x[0, 0] == x[0, 1]).all()
    *_, says, _ = hear_loop((log_w[:1], x, P), reading + 0.05, pitch=0.0)
    assert says == hearing.PLAIN


def test_speed_as_expected_is_an_extended_kalman_update_of_the_radars_filter():
    state = one()
    log_w, x, P, nis, says = hear_radar(state, 20.3)
    H = np.zeros(SIZE)
    H[V], H[K] = 1.005, 20.0
    mean, spread = joseph(MEAN, state[2][0, 1], H, 20.3 - 20.1, R_RADAR)
    heaviest = np.argmax(log_w)
    assert says == hearing.PLAIN
    assert x[heaviest, 1] == pytest.approx(mean, rel=1e-12)
    assert close(P[heaviest, 1], spread)
    assert np.array_equal(x[heaviest, 0], MEAN)
    assert nis == pytest.approx(0.2**2 / (H @ state[2][0, 1] @ H + R_RADAR), rel=1e-12)


@pytest.mark.parametrize('speed', [15.0, 25.2, -20.0, 290.0, 1.0])
def test_a_radar_outlier_changes_nothing(speed):
    log_w, x, P, _, says = hear_radar(one(), speed)
    _, before, P_before = one()
    assert says == hearing.IGNORED
    heaviest = np.argmax(log_w)
    assert np.array_equal(x[heaviest], before[0])
    assert np.array_equal(P[heaviest], P_before[0])


def test_a_slip_is_a_change_of_scale():
    """Readings 3 % high from one to the next: within half a second the scale has gone, not v."""
    state = one()
    for _ in range(10):
        log_w, x, P, _, _ = hear_radar(state, 20.0 * 1.035)
        bank.federate(x, P)
        state = bank.merge(log_w, x, P, 0.08)
    heaviest = np.argmax(state[0])
    assert state[1][heaviest, 0, K] == pytest.approx(0.035, abs=0.006)
    assert state[1][heaviest, 0, V] == pytest.approx(20.0, abs=0.1)


def test_a_train_that_stood_may_have_set_out():
    """One sensible reading is a doubt, two are no outliers: it is up to ``unseen`` further."""
    sigma = [0.05, 0.02, 0.1, 0.1, 1e-4, 2e-3]
    for sign in (1.0, -1.0):
        state = one(sigma=sigma, v=0.0)
        doubt = hear_radar(state, 0.7 * sign, unseen=(0.4 * sign, 0.5))
        weight = dict(zip(doubt[1][:, 1, V].round(1) * sign, np.exp(doubt[0]), strict=True))
        density = stats.norm.pdf(0.7, scale=math.sqrt(2 * 0.02**2 + R_RADAR + 0.25))
        assert weight[0.7] / weight[0.0] == pytest.approx(0.001 * density / (0.02 / 20.0), rel=1e-3)
        sure = hear_radar(doubt[:3], 0.75 * sign, unseen=(0.4 * sign, 0.5))
        x, P = sure[1][0, 1], sure[2][0, 0]
        assert sure[4] == hearing.PLAIN
        assert x[C] - MEAN[C] == pytest.approx(0.2 * sign, abs=0.01)
        assert x[V] == pytest.approx(0.72 * sign, abs=0.03)
        assert SHARE * P[C, C] - 0.05**2 == pytest.approx(0.4**2 / 12.0, rel=1e-6)


@pytest.mark.parametrize('speed', [0.52, -0.6, 0.8])
def test_a_radar_that_tells_no_slow_speeds_moves_no_train_that_stands(speed):
    """Readings just above the least are what it reads there; of a running train they are speeds."""
    sigma = [0.05, 0.02, 0.1, 0.1, 1e-4, 2e-3]
    state, unseen = one(sigma=sigma, v=0.0), (math.copysign(0.4, speed), 0.5)
    log_w, x, _, _, says = hear_radar(state, speed, unseen=unseen, least=0.5)
    assert says == hearing.IGNORED
    assert x[np.argmax(log_w), 1, V] == 0.0
    assert np.exp(log_w).max() > 0.97
    running = hear_radar(one(v=5.0, sigma=sigma), 5.02, unseen=unseen, least=0.5)
    assert running[4] == hearing.PLAIN


def test_an_outlier_is_no_departure_and_neither_is_a_running_train():
    state = one(sigma=[0.05, 0.02, 0.1, 0.1, 1e-4, 2e-3], v=0.0)
    assert hear_radar(state, 5.0, unseen=(0.4, 0.5))[4] == hearing.IGNORED
    assert hear_radar(one(v=1.0), 1.6, unseen=(0.4, 0.5))[4] != hearing.DEPARTED


def slowness(least=0.5, outlier=0.02, **mean):
    """Return mean and covariance of the radar's filter after a reading below ``least``."""
    _, x, P = one(**mean)
    ignored = standing.hear_slowness(np.zeros(1), x, P, 1.0, least, outlier)
    return x[0, 1], P[0, 1], ignored


@pytest.mark.parametrize('v', [0.0, 0.3, 0.5])
def test_a_reading_below_the_least_is_no_news_to_a_slow_train(v):
    x, P, ignored = slowness(v=v)
    assert np.array_equal(P, one()[2][0, 1])
    assert x[V] == v
    assert not ignored


def test_a_reading_below_the_least_holds_a_speed_that_leaves_its_bounds():
    x, _, ignored = slowness(v=0.6)
    assert 0.5 < x[V] < 0.6
    assert not ignored
    x, _, ignored = slowness(v=-0.2, a=-0.8)
    assert -0.2 < x[V] < 0.0
    assert -0.8 < x[A] < -0.6
    assert not ignored


@pytest.mark.parametrize('v', [3.0, 20.0, 83.0, -20.0])
def test_a_radar_that_reads_nothing_does_not_stop_a_running_train(v):
    """A speed known to 5 cm/s and a radar that lost the ground: nothing changes."""
    x, P, ignored = slowness(v=v)
    assert x[V] == v
    assert np.array_equal(P, one()[2][0, 1])
    assert ignored


def test_hypotheses_too_fast_for_a_reading_below_the_least_lose_weight():
    """0.7 m/s known to 5 cm/s and told with as much noise: two sigma and more beyond 0.5 m/s."""
    states = [one(v=v) for v in (0.0, 0.7)]
    x, P = (np.concatenate([s[k] for s in states]) for k in (1, 2))
    log_w = np.log([0.5, 0.5])
    standing.hear_slowness(log_w, x, P, 1.0, 0.5, 0.02)
    sigma = math.sqrt(0.05**2 / SHARE + 0.05**2)
    slow = 0.98 * stats.norm.cdf(-0.2 / sigma) + 0.02
    assert np.exp(log_w).sum() == pytest.approx(1.0, rel=1e-12)
    assert np.exp(log_w[1] - log_w[0]) == pytest.approx(slow, rel=1e-6)


def test_a_speed_in_doubt_is_held_by_a_radar_that_reads_nothing():
    """After a minute without sensors nobody knows better."""
    _, x, P = one(sigma=[30.0, 12.0, 1.0, 0.1, 1e-4, 2e-3])
    assert not standing.hear_slowness(np.zeros(1), x, P, 1.0, 0.5, 0.02)
    assert x[0, 1, V] == pytest.approx(0.25, abs=0.05)


def test_a_slow_train_in_doubt_is_held_too():
    """Else the doubt of a train that stands grows until an outlier is believed."""
    _, x, P = one(v=0.2, sigma=[30.0, 12.0, 1.0, 0.1, 1e-4, 2e-3])
    assert not standing.hear_slowness(np.zeros(1), x, P, 1.0, 0.5, 0.02)
    assert x[0, 1, V] == pytest.approx(0.0, abs=1e-3)
    assert math.sqrt(P[0, 1, V, V]) == pytest.approx(0.25, rel=0.01)
    assert hear_radar((np.zeros(1), x, P), 5.0)[4] == hearing.IGNORED

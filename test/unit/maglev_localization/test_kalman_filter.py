"""The baseline: one extended Kalman filter with gates, against dense updates and by its faults."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.maglev_bank import close, joseph

from maglev_localization.config import MaglevConfig
from maglev_localization.kalman_filter import KalmanFilter
from maglev_localization.line_kernels import SIZE, A, B, C, K, V
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from track_localization.track.balise_table import BaliseTable

TABLE = BaliseTable(('a', 'b'), np.array([300.0, 900.0]), np.array([0.05, 0.1]))
POSITION = np.eye(SIZE)[C] - np.eye(SIZE)[B]


def moving(table=TABLE, **changes):
    """Return a filter, and its belief of a train at 800 m and 20 m/s, the counter at 500 m."""
    filter_ = KalmanFilter(MaglevConfig(), table, 1000.0)
    belief = filter_.start(100.0, 800.0, 0.04)
    mean = np.array([500.0, 20.0, 0.0, -300.0, 0.0, 0.005])
    memory = belief.memory._replace(reading=499.9, sampled_s=100.0, changed_s=100.0, used_s=100.0)
    P = np.diag(np.array([0.03, 0.05, 0.1, 0.1, 1e-4, 2e-3]) ** 2)
    return filter_, belief._replace(x=mean, P=P, memory=memory, **changes)


def test_radar_is_an_extended_kalman_update():
    """At the belief's own stamp nothing moves first."""
    filter_, belief = moving()
    H = np.zeros(SIZE)
    H[V], H[K] = 1.005, 20.0
    expected = joseph(belief.x, belief.P, H, 0.1, 0.01)
    after = filter_.apply(belief, (RadarSpeed(100.0, 20.2, 0.01), 0.5))
    assert after.x == pytest.approx(expected[0], rel=1e-9)
    assert close(after.P, expected[1])
    assert after.nis == pytest.approx(0.1**2 / (H @ belief.P @ H + 0.01), rel=1e-9)


def test_a_doubtful_speed_weighs_less_and_a_wild_one_nothing():
    """NIS 9 is more than 4: the variance is raised by 9 / 4; NIS beyond 49 is refused."""
    filter_, belief = moving()
    H = np.zeros(SIZE)
    H[V], H[K] = 1.005, 20.0
    spread = float(H @ belief.P @ H)
    nu = 3.0 * np.sqrt(spread + 0.01)
    expected = joseph(belief.x, belief.P, H, nu, 0.01 * 9.0 / 4.0)
    after = filter_.apply(belief, (RadarSpeed(100.0, 20.1 + nu, 0.01), 0.5))
    assert after.x == pytest.approx(expected[0], rel=1e-9)
    wild = filter_.apply(belief, (RadarSpeed(100.0, 20.1 + 7.1 / 3.0 * nu, 0.01), 0.5))
    assert wild.reason == 'gate'
    assert np.array_equal(wild.x, belief.x)


@pytest.mark.parametrize(
    ('told', 'reason'), [('b', ''), ('a', 'wrong_id'), ('nobody', 'unknown_id')]
)
def test_a_balise_corrects_the_place(told, reason):
    """Heard 0.2 m off balise b, whose survey is known to 0.1 m; the crossing's time to 2 ms."""
    filter_, belief = moving()
    belief = belief._replace(x=belief.x + 100.2 * np.eye(SIZE)[C])
    expected = joseph(belief.x, belief.P, POSITION, -0.2, 0.1**2 + 0.0004 + 0.04**2)
    after = filter_.apply(belief, (BalisePassing(100.0, told, 0.0, 0.0004), 0.5))
    assert after.reason == reason
    assert after.x == pytest.approx(expected[0], rel=1e-9)
    assert close(after.P, expected[1])


@pytest.mark.parametrize(('told', 'reason'), [('b', 'gate'), ('nobody', 'unknown_id')])
@pytest.mark.parametrize('table', [TABLE, BaliseTable((), np.zeros(0), np.zeros(0))])
def test_a_passing_far_from_any_balise_changes_nothing(told, reason, table):
    """Nor does any where the table is empty, whose ids are all unknown."""
    filter_, belief = moving(table)
    after = filter_.apply(belief, (BalisePassing(100.0, told, 0.0, 0.0004), 0.5))
    assert after.reason == (reason if len(table) else 'unknown_id')
    assert np.array_equal(after.x, belief.x)
    assert np.array_equal(after.P, belief.P)


def test_a_second_reading_off_is_a_jump_and_leaves_the_train():
    """The first is refused; after the second the count is what it says, the train where it was."""
    filter_, belief = moving()
    once = filter_.apply(belief, (LoopPosition(100.02, 520.4, 0.004), 0.5))
    twice = filter_.apply(once, (LoopPosition(100.04, 520.8, 0.004), 0.5))
    assert (once.reason, twice.reason) == ('gate', 'gate')
    assert POSITION @ twice.x == pytest.approx(800.8, abs=1e-6)
    assert twice.x[C] == pytest.approx(520.9, abs=0.01)
    then = filter_.apply(twice, (LoopPosition(100.06, 521.2, 0.004), 0.5))
    assert then.reason == ''
    assert POSITION @ then.x == pytest.approx(801.2, abs=0.05)


@pytest.mark.parametrize(
    ('v', 'sigma', 'held'),
    [
        (0.3, 0.1, False),
        (20.0, 0.05, False),
        (0.6, 0.05, True),
        (-0.2, 0.05, True),
        (5.0, 9.0, True),
    ],
)
def test_a_radar_below_its_least_holds_what_leaves_its_bounds(v, sigma, held):
    """A running train does not stand because its radar lost the ground."""
    filter_, belief = moving()
    x, P = belief.x.copy(), belief.P.copy()
    x[V], P[V, V] = v, sigma**2
    after = filter_.apply(belief._replace(x=x, P=P), (RadarSpeed(100.0, 0.0, 0.01), 0.5))
    assert (abs(after.x[V] - 0.25) < abs(v - 0.25)) == held
    assert (after.reason == 'gate') == (v == 20.0)


def test_standstill_stops_a_slow_train_only():
    """The count has stood for 3 s and the radar reads nought; at 20 m/s neither is believed."""
    for v, stops in ((0.2, True), (20.0, False)):
        filter_, belief = moving()
        memory = belief.memory._replace(changed_s=97.0, still_s=97.0, radar_mps=0.0, radar_s=99.99)
        x = belief.x.copy()
        x[V] = v
        state = belief._replace(x=x, memory=memory)
        after = filter_.apply(state, (RadarSpeed(100.0, 0.0, 0.01), 0.5))
        assert (abs(after.x[V]) < 0.7 * v) == stops
        assert (after.memory.still_s == 100.0) == stops


def test_the_estimate_is_that_of_the_train():
    filter_, belief = moving()
    estimate = filter_.estimate(belief)
    assert estimate.mean == pytest.approx([800.0, 20.0, 0.0])
    assert estimate.covariance[0, 0] == pytest.approx(0.03**2 + 0.1**2)
    assert estimate.covariance[1, 1] == pytest.approx(belief.P[V, V])
    assert estimate.covariance[2, 2] == pytest.approx(belief.P[A, A])
    assert estimate.time_s == 100.0

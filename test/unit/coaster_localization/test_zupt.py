"""When the filter takes the train to stand."""

import numpy as np
import pytest

from coaster_localization.estimate import FusedState
from coaster_localization.zupt import standstill
from track_localization.estimation import eskf
from track_localization.estimation.imu_monitor import ImuStep
from track_localization.estimation.strapdown import gravity_vector

BIAS = np.array([1e-3, -2e-3, 5e-4])


def state_at(speed, sigma, rolled_s=0.0):
    sigmas = (np.ones(3), np.full(3, sigma / np.sqrt(3.0)), np.full(3, 0.01), 0.05, 0.01, 0.01)
    velocity = np.array([speed, 0.0, 0.0])
    nav = eskf.make_state(9.0, np.zeros(3), velocity, np.eye(3), gravity_vector(), sigmas)
    return FusedState(nav, 50.0, 8.9, float('nan'), 8.0, rolled_s)


def step(rate=BIAS):
    force = np.array([0.0, 0.0, 9.81])
    mean = np.concatenate([force, rate])
    return ImuStep(9.0, 0.01, force, rate, 0.01, force, rate, 0.01, 1e-3, np.zeros(6), mean)


def test_at_rest_it_tells_velocity_and_gyro_bias():
    after = standstill(state_at(0.1, 0.3), step(), 3.0)
    assert np.linalg.norm(after.nav.velocity) < 0.01
    np.testing.assert_allclose(after.nav.gyro_bias, BIAS, atol=1e-5)
    assert after.last_zupt_s == 9.0


@pytest.mark.parametrize(('speed', 'sigma'), [(3.0, 0.2), (1.5, 0.2), (4.0, 3.5)])
def test_a_train_that_moves_or_may_do_anything_is_not_stopped(speed, sigma):
    before = state_at(speed, sigma)
    assert standstill(before, step(), 3.0).nav is before.nav


def test_a_turning_sensor_does_not_stand():
    before = state_at(0.0, 0.1)
    assert standstill(before, step(np.array([0.0, 0.0, 0.05])), 3.0).nav is before.nav


@pytest.mark.parametrize(
    ('rolled_s', 'usual_mps', 'stopped'), [(0.0, 3.0, True), (2.0, 3.0, False), (2.0, 0.0, True)]
)
def test_one_that_rolls_as_quietly_as_it_stands_is_stopped_in_the_station_only(
    rolled_s, usual_mps, stopped
):
    """The filter has 1.8 m/s and is so unsure that it may be nothing."""
    after = standstill(state_at(1.8, 1.0, rolled_s), step(), usual_mps)
    assert (np.linalg.norm(after.nav.velocity) < 0.1) == stopped


def test_rolling_quietly_is_noticed_while_the_speed_is_sure():
    state = state_at(2.2, 0.2)
    for _ in range(10):
        state = standstill(state, step(), 3.0)
    assert state.rolled_s == pytest.approx(2.0)

"""A train that rolls as quietly as it stands: it must not be taken to stand."""

import dataclasses

import numpy as np
import pytest

from coaster_localization.config import CoasterConfig, MatcherConfig
from coaster_localization.methods import run_methods
from coaster_localization.planned import PlannedRows
from coaster_localization.rest import RestWatch
from coaster_localization.sensed import measured_motion
from coaster_localization.start import observe_rest
from coaster_localization.ticks import FORCE, VERTICAL, WIDTH
from coaster_localization.tracker import PACES
from track_localization.estimation.imu import ImuSample
from track_localization.sim.coaster import scenario, simulate_coaster
from track_localization.track.design_ride import DesignRide

RATE_HZ = 25.0


@pytest.fixture(scope='module')
def ride():
    return simulate_coaster('looping', scenario('novib'), 73)


def rows(seconds, push, shake, rng):
    """Rows of a level train that is pushed ahead [m/s^2]: force, vertical, change of the force."""
    out = np.zeros((round(seconds * RATE_HZ), WIDTH))
    out[:, FORCE] = rng.normal([push, 0.0, 9.81], 0.006, (len(out), 3))
    out[:, VERTICAL] = [0.0, 0.0, 1.0]
    out[:, 9] = shake * (1.0 + 0.1 * rng.normal(size=len(out)))
    out[:, 10] = 1e-5
    return out


def watched(watch, part):
    return np.array([watch.push(row) for row in part])


@pytest.mark.parametrize(('rolling', 'smooth'), [(1e-3, True), (1e-2, False)])
def test_a_train_that_left_moves_though_it_does_not_shake(rng, rolling, smooth):
    watch = RestWatch(RATE_HZ)
    assert watched(watch, rows(10.0, 0.0, 1e-3, rng))[50:].all()
    watched(watch, rows(4.0, 0.6, rolling, rng))
    assert not watched(watch, rows(10.0, 0.0, rolling, rng)).any()
    assert watch.smooth == smooth


def test_a_train_that_stops_again_stands(rng):
    watch = RestWatch(RATE_HZ)
    watched(watch, rows(10.0, 0.0, 1e-3, rng))
    watched(watch, rows(3.0, 0.6, 1e-3, rng))
    watched(watch, rows(3.0, -0.6, 1e-3, rng))
    assert watched(watch, rows(5.0, 0.0, 1e-3, rng))[50:].all()


@pytest.mark.parametrize(
    ('count', 'push', 'rests'), [(1, 0.0, True), (300, 0.0, True), (300, 0.2, False)]
)
def test_a_rest_does_not_drift(count, push, rests):
    """A train that is pushed harder and harder does not rest, however smoothly it is done."""
    samples = [
        ImuSample(0.01 * i, np.array([push * i / count, 0.0, 9.81]), np.zeros(3))
        for i in range(count)
    ]
    assert (observe_rest(samples) is not None) == rests


def test_a_smooth_ride_stands_at_its_ends_only(ride):
    held = measured_motion(ride.imu, ride.design).held
    speed = np.interp(ride.imu.time_s, ride.truth.time_s, ride.truth.speed)
    assert speed[held].max() < 0.5
    assert held[speed < 0.005].mean() > 0.9


@pytest.mark.parametrize(('method', 'limit_m'), [('eskf_live', 2.5), ('eskf', 1.5)])
def test_a_smooth_ride_is_followed(ride, method, limit_m):
    (result,) = run_methods(ride.imu, ride.design, CoasterConfig(), [method])
    there = ride.truth.time_s[(ride.truth.speed > 0.5)][::50]
    error = np.linalg.norm(
        result.trajectory.position_at(there) - ride.truth.position_at(there), axis=1
    )
    assert np.nanmean(error) < limit_m
    assert np.nanmax(error) < 15.0


def circle(speed):
    """A level circle of 20 m radius at a speed: what turns the train is v^2 / r, the rate v / r."""
    time_s = np.arange(0.0, 12.0, 0.01)
    s, r = speed * time_s, 20.0
    zero, one = np.zeros_like(s), np.ones_like(s)
    half = 0.5 * s / r
    return DesignRide(
        time_s=time_s,
        chainage=s,
        position=np.stack([r * np.sin(s / r), r - r * np.cos(s / r), zero], axis=-1),
        quaternion=np.stack([zero, zero, np.sin(half), np.cos(half)], axis=-1),
        velocity=speed * np.stack([np.cos(s / r), np.sin(s / r), zero], axis=-1),
        specific_force=np.stack([zero, one * speed**2 / r, one * 9.80665], axis=-1),
        angular_rate=np.stack([zero, zero, one * speed / r], axis=-1),
    )


@pytest.mark.parametrize('pace', [0.8, 1.2])
def test_what_is_felt_at_a_pace_is_what_a_train_of_that_speed_feels(pace):
    config = MatcherConfig()
    usual = PlannedRows(circle(10.0), 'multi', config).features
    quick = PlannedRows(circle(10.0 * pace), 'multi', config).features
    p, one = list(PACES).index(pace), list(PACES).index(1.0)
    channels = slice(0, 8)
    np.testing.assert_allclose(usual[p, 100, channels], quick[one, 100, channels], atol=1e-6)
    assert np.abs(usual[p, 100, channels] - usual[one, 100, channels]).max() > 0.3


def test_a_recording_that_begins_as_the_train_leaves_is_begun_by_a_match():
    """There is no rest to level by; the filter is under way within seconds."""
    ride = simulate_coaster('wooden', scenario('dwell0'), 74)
    (result,) = run_methods(ride.imu, ride.design, CoasterConfig(), ['eskf'])
    assert result.trajectory.time_s[0] < ride.imu.time_s[0] + 5.0
    there = ride.truth.time_s[(ride.truth.speed > 0.5)][::50]
    error = np.linalg.norm(
        result.trajectory.position_at(there) - ride.truth.position_at(there), axis=1
    )
    assert np.nanmean(error) < 3.0


def test_quiet_design_rows_need_no_gyro(ride):
    """Without rates nothing is quiet on the design, and every rest is the station's."""
    assert measured_motion(
        dataclasses.replace(ride.imu, angular_rate=ride.imu.angular_rate * np.nan), ride.design
    ).rests == (True, True)

"""The recording turned into the vehicle's axes."""

import dataclasses

import numpy as np
import pytest

from coaster_localization.sensed import design_motion, measured_motion, shortest_turn
from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSeries
from track_localization.sim.coaster import scenario, simulate_coaster


@pytest.fixture(scope='module')
def ride():
    return simulate_coaster('mine', scenario('nominal'), 11)


@pytest.fixture(scope='module')
def sensed(ride):
    return measured_motion(ride.imu, ride.design)


def moving_times(ride, speed=0.05):
    moving = ride.truth.time_s[ride.truth.speed > speed]
    return moving[0], moving[-1]


def test_the_ride_begins_and_ends_where_it_does(ride, sensed):
    """Within half a second at the start; a train that creeps into the station looks at rest."""
    first, last = moving_times(ride)
    assert abs(sensed.start_s - first) < 0.5
    assert -2.0 < sensed.end_s - last < 0.5
    assert sensed.rests == (True, True)


def test_a_slow_train_is_not_a_standing_one(ride, sensed):
    speed = np.interp(sensed.time_s, ride.truth.time_s, ride.truth.speed)
    assert not sensed.held[speed > 1.5].any()
    assert sensed.held[speed < 1e-6].mean() > 0.9


def test_levelled_at_rest_as_the_design(ride, sensed):
    """The mount is 2.5 deg off per axis; 0.04 m/s^2 of bias are 0.25 deg of what is left."""
    rest = sensed.time_s < sensed.start_s - 1.0
    up = so3.matrix_from_quat(ride.design.quaternion[0])[2]
    force = sensed.force[rest].mean(axis=0)
    angle = np.arccos(force @ up / np.linalg.norm(force))
    assert np.rad2deg(angle) < 0.05
    raw = ride.imu.specific_force[: rest.sum()].mean(axis=0)
    assert np.rad2deg(np.arccos(raw @ up / np.linalg.norm(raw))) > 0.5


def test_attitude_keeps_the_vertical(ride, sensed):
    R_true = so3.matrix_from_quat(ride.truth.quaternion)
    cosine = (sensed.R_nb[:, 2] * R_true[:, 2]).sum(axis=1)
    assert np.rad2deg(np.arccos(np.clip(cosine, -1, 1))).max() < 6.0


def test_gyro_bias_drifts_from_rest_to_rest(ride, sensed):
    for rest in (sensed.time_s < sensed.start_s - 0.5, sensed.time_s > sensed.end_s + 0.5):
        assert np.abs(sensed.rate[rest].mean(axis=0)).max() < 5e-4


def test_the_last_rest_serves_when_there_is_no_first(ride):
    first, _ = moving_times(ride, 3.0)
    later = ride.imu[ride.imu.time_s > first]
    sensed = measured_motion(later, ride.design)
    assert sensed.rests == (False, True)
    assert any('levelled at the one after' in note for note in sensed.notes)
    R_true = so3.matrix_from_quat(ride.truth.quaternion[ride.imu.time_s > first])
    cosine = (sensed.R_nb[:, 2] * R_true[:, 2]).sum(axis=1)
    assert np.rad2deg(np.arccos(np.clip(cosine, -1, 1))).max() < 8.0


def test_no_rest_at_all_is_said(ride):
    first, last = moving_times(ride, 3.0)
    inside = (ride.imu.time_s > first) & (ride.imu.time_s < last - 40.0)
    sensed = measured_motion(ride.imu[inside], ride.design)
    assert sensed.rests == (False, False)
    assert any('no rest before or after' in note for note in sensed.notes)


def test_unusable_recordings_are_named(ride):
    rest = ride.imu[ride.imu.time_s < ride.imu.time_s[0] + 6.0]
    with pytest.raises(DataError, match='rest'):
        measured_motion(rest, ride.design)
    with pytest.raises(DataError, match='usable samples'):
        measured_motion(ride.imu[:5], ride.design)
    nothing = ImuSeries(ride.imu.time_s, ride.imu.specific_force * np.nan, ride.imu.angular_rate)
    with pytest.raises(DataError, match='usable samples'):
        measured_motion(nothing, ride.design)
    standing = dataclasses.replace(ride.design, velocity=0.0 * ride.design.velocity)
    with pytest.raises(DataError, match='design ride'):
        design_motion(standing)


def test_bad_samples_are_counted(ride):
    force = ride.imu.specific_force.copy()
    force[5000:5010] = np.nan
    sensed = measured_motion(ImuSeries(ride.imu.time_s, force, ride.imu.angular_rate), ride.design)
    assert '10 samples dropped: not_finite' in sensed.notes


@pytest.mark.parametrize('seed', range(5))
def test_shortest_turn(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3))
    R = shortest_turn(a, b)
    np.testing.assert_allclose(R @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ np.cross(a, b), np.cross(a, b), atol=1e-12)
    back = shortest_turn(a, -a)
    np.testing.assert_allclose(back @ a, -a, atol=1e-9)
    assert np.linalg.det(back) == pytest.approx(1.0)

"""Starting from a rest, and out of a bend; motion here is made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from track_localization.geodesy import Datum, geodetic_from_enu
from train_localization.alignment import Alignment
from train_localization.config import AlignmentConfig
from train_localization.measurements import GnssFix, WheelSpeed

GRAVITY = 9.80665
DATUM = Datum(0.7, 2.0, 100.0)
EARTH = 7.292115e-5 * np.array([0.0, math.cos(0.7), math.sin(0.7)])
BIAS = np.array([3e-5, -4e-5, 5e-5])
REST_S = 60.0


def leave(rng, course=2.0, pull=0.6, top=3.5, bend=0.25, noise=2e-4):
    """Return the start, and the heading then, of a car that rests, then drives off in a bend."""
    found, place, heading = Alignment(AlignmentConfig()), np.zeros(2), course
    for k in range(int((REST_S + 20.0) * 100)):
        t = 0.01 * k
        moving = max(t - REST_S, 0.0)
        turning = bend if 2.0 < moving < 5.0 else 0.0
        v = min(pull * moving, top)
        heading += 0.01 * turning
        R = so3.matrix_from_rpy(0.0, 0.0, heading)
        rate = R.T @ EARTH + [0.0, 0.0, turning] + BIAS + noise * rng.standard_normal(3)
        gained = pull if 0.0 < v < top else 0.0
        found.imu(ImuSample(t, np.array([gained, v * turning, GRAVITY]), rate))
        if k % 10 == 0:
            found.wheel(WheelSpeed(t, v, 0.01))
        if k % 100 == 0:
            lat, lon, h = geodetic_from_enu([*place, 0.0], DATUM)[0]
            found.gnss(GnssFix(t, lat, lon, h, 2.25 * np.eye(3)))
            if found.start is not None:
                return found.start, heading
        place += 0.01 * v * np.array([math.cos(heading), math.sin(heading)])
    raise AssertionError('no start')


def test_course_of_a_car_that_turned_before_it_was_fast(rng):
    """
    The way counts, not the time: where the turn is, the car is slow.

    The mean course over time is 0.1 rad off; 0.01 rad is what an odometer held for 0.1 s leaves.
    """
    start, heading = leave(rng)
    yaw = float(so3.euler_zyx(so3.matrix_from_quat(start.quaternion))[0])
    assert math.remainder(yaw - heading, 2.0 * math.pi) == pytest.approx(0.0, abs=0.01)


def test_gyro_biases_at_rest_are_what_the_earth_does_not_explain(rng):
    """Its rate is 7e-5 rad/s; noise of 2e-4 over a minute of 100 Hz leaves 2.6e-6, 1 sigma."""
    start, _ = leave(rng)
    assert start.rested
    np.testing.assert_allclose(start.gyro_bias, BIAS, atol=1e-5)


def roll(speed, until_s):
    """Return an alignment without an odometer, on a train that turns smoothly at a speed [m/s]."""
    found, turn = Alignment(AlignmentConfig()), 5e-3 if speed else 0.0
    for k in range(int(until_s * 100)):
        t, heading = 0.01 * k, turn * 0.01 * k
        rate = so3.matrix_from_rpy(0.0, 0.0, heading).T @ EARTH + [0.0, 0.0, turn] + BIAS
        found.imu(ImuSample(t, np.array([0.0, speed * turn, GRAVITY]), rate))
        if k % 100 == 50:
            way = speed * t * np.array([math.cos(0.5 * heading), math.sin(0.5 * heading), 0.0])
            lat, lon, h = geodetic_from_enu(way, DATUM)[0]
            found.gnss(GnssFix(t, lat, lon, h, 2.25 * np.eye(3)))
    return found


def test_a_train_that_runs_smoothly_does_not_stand_where_no_odometer_tells():
    """Its turn of 1000 deg/h would be taken for a drift."""
    start = roll(10.0, 6.0).start
    assert start is not None
    assert not start.rested
    np.testing.assert_array_equal(start.gyro_bias, np.zeros(3))


@pytest.mark.parametrize('speed', [0.5, 3.0])
def test_fixes_of_a_moment_tell_of_no_rest(speed):
    """Ten a second, from 1.7 s on: three are heard before the first 2 s are over."""
    found, turn = Alignment(AlignmentConfig()), 8e-3
    for k in range(450):
        t = 0.01 * k
        found.imu(
            ImuSample(t, np.array([0.0, speed * turn, GRAVITY]), np.array([0.0, 0.0, turn]) + BIAS)
        )
        if k >= 170 and k % 10 == 0:
            lat, lon, h = geodetic_from_enu([speed * t, 0.0, 0.0], DATUM)[0]
            found.gnss(GnssFix(t, lat, lon, h, 0.1 * np.eye(3)))
    for k in range(450, 1800):
        t = 0.01 * k
        found.imu(ImuSample(t, np.array([0.0, 0.0, GRAVITY + 0.5 * (k % 2)]), EARTH + BIAS))
        lat, lon, h = geodetic_from_enu([10.0 * (t - 4.5), 0.0, 0.0], DATUM)[0]
        if k % 100 == 0 and found.start is None:
            found.gnss(GnssFix(t, lat, lon, h, 0.1 * np.eye(3)))
    assert found.start is not None
    assert not found.start.rested


def test_fixes_tell_of_a_rest_where_no_odometer_does():
    found = roll(0.0, 8.0)
    for k in range(800, 1400):
        t = 0.01 * k
        found.imu(ImuSample(t, np.array([0.0, 0.0, GRAVITY + 0.5 * (k % 2)]), EARTH + BIAS))
        if k % 100 == 50:
            lat, lon, h = geodetic_from_enu([20.0 * (t - 8.0), 0.0, 0.0], DATUM)[0]
            found.gnss(GnssFix(t, lat, lon, h, 2.25 * np.eye(3)))
    assert found.start is not None
    assert found.start.rested
    np.testing.assert_allclose(found.start.gyro_bias, BIAS, atol=1e-6)

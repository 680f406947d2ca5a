"""Starting: the course from fixes, level from gravity; motion here is made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from track_localization.geodesy import Datum, geodetic_from_enu
from train_localization.alignment import Alignment, start_at
from train_localization.config import AlignmentConfig
from train_localization.measurements import GnssFix, WheelSpeed

GRAVITY = 9.80665
DATUM = Datum(0.7, 2.0, 100.0)


def drive(speed, course, seconds, roll=0.0, pitch=0.0, turning=0.0, gain=0.0, off=None, slip=()):
    """
    Return an Alignment that heard a train.

    ``off`` {second: metres north} spoils fixes; from ``slip[0]`` to ``slip[1]`` s wheels turn a
    fifth too fast.
    """
    found, place, begin = Alignment(AlignmentConfig()), np.zeros(2), 100.0
    R = so3.matrix_from_rpy(roll, pitch, 0.0)
    for k in range(int(seconds * 100) + 1):
        t = begin + 0.01 * k
        v = speed + gain * 0.01 * k
        heading = course + turning * 0.01 * k
        force = R.T @ np.array([gain, v * turning, GRAVITY])
        found.imu(ImuSample(t, force, R.T @ np.array([0.0, 0.0, turning])))
        if k % 10 == 0:
            slipping = bool(slip) and slip[0] <= t - begin < slip[1]
            found.wheel(WheelSpeed(t, 1.2 * v if slipping else v, 0.01))
        if k % 100 == 0:
            lat, lon, h = geodetic_from_enu([*place, 0.0], DATUM)[0]
            far = (off or {}).get(k // 100, 0.0)
            fix = GnssFix(t, lat + far / 6.36e6, lon, h, np.eye(3))
            found.gnss(fix)
            if found.start is not None:
                return found.start, heading, v
        place += 0.01 * v * np.array([math.cos(heading), math.sin(heading)])
    return found.start, heading, v


def angles(start):
    yaw, pitch, roll = so3.euler_zyx(so3.matrix_from_quat(start.quaternion))
    return float(roll), float(pitch), float(yaw)


@pytest.mark.parametrize('course', [0.0, 1.0, 3.0, -2.0])
def test_course_of_a_straight_way(course):
    start, heading, speed = drive(30.0, course, 10.0)
    assert angles(start)[2] == pytest.approx(heading, abs=2e-3)
    assert np.hypot(*start.velocity[:2]) == pytest.approx(speed, abs=0.01)


def test_course_at_the_end_of_a_curve_not_in_its_middle():
    """0.02 rad/s over two seconds: the chord's direction would be 0.02 rad behind."""
    start, heading, _ = drive(30.0, 0.5, 10.0, turning=0.02)
    assert angles(start)[2] == pytest.approx(heading, abs=4e-3)


def test_level_from_gravity_while_it_brakes_in_a_curve():
    """Centripetal and braking forces are taken out: else 3.5 deg of roll and 3 of pitch."""
    start, _, _ = drive(30.0, 0.5, 10.0, roll=0.05, pitch=-0.02, turning=0.02, gain=-0.5)
    roll, pitch, _ = angles(start)
    assert roll == pytest.approx(0.05, abs=5e-3)
    assert pitch == pytest.approx(-0.02, abs=5e-3)


def test_a_standing_train_has_no_course_whatever_its_fixes_do():
    """Outliers of 20 to 80 m are no way: the odometer says that it stands."""
    start, _, _ = drive(0.0, 0.5, 30.0, off={3: 25.0, 4: 80.0, 9: 40.0, 10: 45.0, 11: 50.0})
    assert start is None


def test_an_outlier_under_way_delays_the_start():
    clean, _, _ = drive(30.0, 0.5, 10.0)
    late, heading, _ = drive(30.0, 0.5, 20.0, off={1: 40.0})
    assert late.time_s > clean.time_s
    assert angles(late)[2] == pytest.approx(heading, abs=2e-3)


def test_a_start_that_is_told_couples_velocity_and_attitude():
    """Monte Carlo of the pose: attitude errors turn the velocity; 3000 draws are good to 5 %."""
    rng = np.random.default_rng(4)
    R = so3.matrix_from_rpy(0.02, 0.01, 1.0)
    pose = np.diag([1.0, 2.0, 3.0, 1e-4, 2e-4, 3e-4])
    start = start_at(5.0, np.array([0.7, 2.0, 0.0]), R, pose, 50.0, 0.5)
    drawn = []
    for _ in range(3000):
        turn = so3.exp(np.sqrt(np.diag(pose)[3:]) * rng.standard_normal(3))
        R_true = turn @ R
        v = R_true @ [50.0, 0.0, 0.0] - start.velocity + 0.5 * rng.standard_normal(3)
        drawn.append([*v, *so3.log(R.T @ R_true)])
    sampled = np.cov(np.array(drawn).T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    np.testing.assert_allclose(start.covariance[3:, 3:] / scale, sampled / scale, atol=0.06)


@pytest.mark.parametrize('slip', [(0.5, 4.0), (1.0, 2.05), (1.8, 3.0)])
def test_wheels_that_slip_are_no_acceleration(slip):
    """Level is found once they do not: half a degree, where 10 m/s in 0.1 s would tilt all."""
    start, _, speed = drive(50.0, 0.5, 12.0, slip=slip)
    roll, pitch, _ = angles(start)
    sigma = np.sqrt(np.diag(start.covariance))
    assert abs(pitch) < 2.0 * sigma[7]
    assert abs(roll) < 2.0 * sigma[6]
    assert np.hypot(*start.velocity[:2]) == pytest.approx(speed, abs=2.0)

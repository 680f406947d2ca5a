"""The paper's filter: its fading factor and its dead reckoning, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from track_localization.estimation import so3
from track_localization.estimation.earth import curvature_radii, gravity
from train_localization import paper_filter
from train_localization.alignment import start_at
from train_localization.config import ImuConfig, PaperConfig, TrainConfig
from train_localization.kernels import moved
from train_localization.measurements import GnssFix, WheelSpeed
from train_localization.paper_filter import PaperFilter
from train_localization.state import Fix, Stretch

LATITUDE, V, NORTH = 0.7, 50.0, 0.5 * math.pi
H = np.array([1.0, 0.0])


def faded(nu, V, R=1.0, limit=math.inf):
    """Return V and the first variance after the factor, for a variance of 4 before."""
    P = np.diag([4.0, 9.0])
    after = paper_filter.fade(P, H, R, nu, V, limit)
    assert P[1, 1] == pytest.approx(9.0 / 4.0 * P[0, 0])
    return after, P[0, 0]


def test_the_first_innovation_begins_its_variance():
    """V = nu^2 = 36: lambda = (36 - 1) / 4."""
    assert faded(6.0, math.nan) == pytest.approx((36.0, 35.0))


def test_later_innovations_are_averaged_as_in_eq_6():
    """V = (0.95 x 10 + 36) / 1.95 = 23.33: the variance becomes V - R."""
    V = (9.5 + 36.0) / 1.95
    assert faded(6.0, 10.0) == pytest.approx((V, V - 1.0))


def test_small_innovations_do_not_fade():
    assert faded(1.0, 2.0)[1] == 4.0


def test_the_factor_has_a_limit():
    assert faded(60.0, math.nan, limit=1.05)[1] == pytest.approx(4.2)


def north(t, stamps, pitch=0.0):
    """Return a stretch of level motion northward without turning, from ``t`` on [s]."""
    force = so3.matrix_from_rpy(0.0, pitch, NORTH).T @ [0.0, 0.0, gravity(LATITUDE, 0.0)]
    n = len(stamps)
    return Stretch(stamps[-1], np.array(stamps), np.zeros((n, 3)), np.tile(force, (n, 1)))


def ride(until_s, lost_s=math.inf, told=V, jump=(), pitch=0.0, **paper):
    """
    Yield (filter's state, reason) after everything heard on a way due north at 50 m/s from a start.

    ``told`` is the odometer's speed, or a function of time; fixes, one a second, are true until
    ``lost_s`` but for those at times in ``jump``, 60 m east.
    """
    config = TrainConfig(paper=PaperConfig(**paper))
    filter_, geodetic = PaperFilter(config), np.array([LATITUDE, 0.3, 0.0])
    R_nb, spread = so3.matrix_from_rpy(0.0, pitch, NORTH), np.diag([1.0] * 3 + [1e-6] * 3)
    start = start_at(0.0, geodetic, R_nb, spread, V, 0.1)
    state = filter_.start(start._replace(velocity=np.array([0.0, V, 0.0])))
    for k in range(1, round(10 * until_s) + 1):
        t = 0.1 * k
        state = filter_.apply(state, north(t - 0.1, [t - 0.05, t], pitch))
        yield state, ''
        state = filter_.apply(state, WheelSpeed(t, told(t) if callable(told) else told, 0.01))
        yield state, state.reason
        if k % 10 == 0 and t < lost_s:
            way = np.array([60.0 if round(t) in jump else 0.0, t * V, 0.0])
            fix = GnssFix(t, *moved(geodetic, way), np.eye(3))
            state = filter_.apply(state, Fix(t, fix, 3))
            yield state, state.reason


def last(steps):
    """Return the last state of a ride."""
    return list(steps)[-1][0]


def test_the_scale_is_learnt_while_there_are_fixes():
    """An odometer that reads 0.2 % too much; compared in outages only, nothing tells it."""
    assert last(ride(60.0, told=1.002 * V)).aux[9] == pytest.approx(0.002, rel=0.2)
    assert abs(last(ride(60.0, told=1.002 * V, compares=False)).aux[9]) < 1e-5


def test_a_slip_between_fixes_teaches_nothing():
    """Wheels that spin by a tenth for 2 s are 10 m in 3 km: a scale of 0.3 %, if believed."""

    def told(t):
        return 1.1 * V if 30.0 < t < 32.0 else V

    assert abs(last(ride(60.0, told=told)).aux[9]) < 2e-4
    assert abs(last(ride(60.0, told=told, gate=1e9)).aux[9]) > 2e-3


def test_a_slip_just_before_an_outage_does_not_enter_it():
    """From the last fix on, 2.5 m too far; dead reckoning begins anew once fixes are missed."""

    def told(t):
        return 1.1 * V if 29.0 < t < 29.55 else V

    meridian, _ = curvature_radii(LATITUDE)
    off = []
    for gate in (16.0, 1e9):
        place = last(ride(45.0, lost_s=29.5, told=told, gate=gate)).nav[0]
        off.append(abs((place - LATITUDE) * meridian - 45.0 * V))
    assert off[0] < 0.1
    assert off[1] > 0.3


def test_a_fix_far_off_is_refused_and_many_are_believed():
    steps = list(ride(20.0, jump=[10]))
    assert [reason for _, reason in steps].count('gate') == 1
    _, normal = curvature_radii(LATITUDE)
    east = normal * math.cos(LATITUDE)
    assert abs(steps[-1][0].nav[1] - 0.3) * east < 0.5
    steps = list(ride(45.0, jump=range(10, 99)))
    assert [reason for _, reason in steps].count('gate') <= 24
    assert (steps[-1][0].nav[1] - 0.3) * east > 30.0


def test_heights_are_not_compared_unless_it_is_set():
    """An IMU pitched up by 0.3 deg: dead reckoning climbs by 0.26 m/s, the car does not."""
    pitch = math.radians(-0.3)
    climbs = {
        height: last(ride(60.0, lost_s=30.0, pitch=pitch, height=height)).nav[5]
        for height in (False, True)
    }
    assert abs(climbs[False]) < 0.02
    assert climbs[True] > 0.05


def test_dead_reckoning_goes_on_from_the_last_odometer_reading():
    """Readings at 0.1 and 0.2 s, a fix at 0.17 s: of 50 m/s nothing is counted twice."""
    filter_ = PaperFilter(TrainConfig())
    geodetic = np.array([LATITUDE, 0.3, 0.0])
    state = filter_.start(
        start_at(0.0, geodetic, so3.matrix_from_rpy(0.0, 0.0, np.pi / 2), np.eye(6) * 1e-4, V, 0.1)
    )
    for heard in (
        north(0.0, [0.05, 0.1]),
        WheelSpeed(0.1, V, 0.01),
        north(0.1, [0.15, 0.17]),
        Fix(0.17, GnssFix(0.17, *moved(geodetic, np.array([0.0, 0.17 * V, 0.0])), np.eye(3)), 3),
        north(0.17, [0.2]),
        WheelSpeed(0.2, V, 0.01),
    ):
        state = filter_.apply(state, heard)
    # Forces of a moving Earth, 1e-2 m/s^2, are all that differs.
    assert np.abs(state.aux[6:9]).max() < 0.01


@pytest.mark.parametrize('times', [1.0, 3.0])
def test_gyros_count_for_so_many_times_their_noise_and_walk(times):
    """0.5 deg/sqrt(h) and 0.2 deg/h/sqrt(s) over 36 s without anything but the IMU."""
    imu = ImuConfig('mems', gyro_noise=0.5, gyro_bias_sigma=1e-3, gyro_bias_walk=0.2)
    filter_ = PaperFilter(TrainConfig(imu=imu, paper=PaperConfig(gyro_times=times)))
    upright = so3.matrix_from_rpy(0.0, 0.0, NORTH)
    start = start_at(0.0, np.array([LATITUDE, 0.3, 0.0]), upright, np.eye(6) * 1e-12, V, 0.1)
    state = filter_.start(start)
    for k in range(360):
        state = filter_.apply(state, north(0.1 * k, [0.1 * k + 0.05, 0.1 * k + 0.1]))
    walked, noise = (times * 0.2) ** 2 * 36.0, (times * 0.5) ** 2 * 36.0 / 3600.0
    yaw, bias = np.degrees(np.sqrt(np.diag(state.P)[[8, 11]]))
    assert bias * 3600.0 == pytest.approx(math.sqrt(walked), rel=1e-3)
    assert yaw == pytest.approx(math.sqrt(noise + walked * 36.0**2 / 3.0 / 3600.0**2), rel=0.01)

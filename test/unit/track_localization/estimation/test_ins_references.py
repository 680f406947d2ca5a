"""Mechanisation against another formulation of it, solved as an ODE, and against pyins."""

import numpy as np
import pandas as pd
import pymap3d
import pytest
from pyins import sim, strapdown, transform
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from track_localization.estimation import ins

RATE, SEMI_MAJOR = 7.292115e-5, 6378137.0
DEG = np.pi / 180.0


def nav_at(lat, lon, h, velocity, attitude):
    return np.array([lat, lon, h, *velocity, *attitude.as_quat()])


def shaken_rate(t):
    return np.array([0.3 * np.sin(0.9 * t), 0.2 * np.cos(1.7 * t), 0.15 * np.sin(0.6 * t + 1.0)])


def shaken_force(t):
    return np.array([1.5 * np.sin(0.8 * t), 2.0 * np.cos(1.3 * t), 9.8 + np.sin(2.1 * t)])


def steady_rate(t):
    return np.array([0.0005, -0.001, 0.004])


def steady_force(t):
    return np.array([1.2, 0.3, 9.9])


def ramp_rate(t):
    return np.array([1.0 + 3.0 * t, -2.0 + 8.0 * t, 1.5 - 6.0 * t])


def ramp_force(t):
    return np.array([5.0 - 40.0 * t, -8.0 + 60.0 * t, 9.8 + 50.0 * t])


def earth_fixed_solution(nav, rate, force, seconds, normal_gravity):
    """
    Return place, velocity (3,) and attitude after ``seconds``, by an ODE solver.

    In Earth-fixed axes; ``rate`` and ``force`` are functions of time.
    """
    spin = np.array([0.0, 0.0, RATE])

    def level_axes(lat, lon):
        return Rotation.from_euler('ZX', [lon + 0.5 * np.pi, 0.5 * np.pi - lat])

    def slope(t, y):
        r, v, q = y[:3], y[3:6], Rotation.from_quat(y[6:10])
        lat, lon, h = (float(x) for x in pymap3d.ecef2geodetic(*r, deg=False))
        down = level_axes(lat, lon).apply([0.0, 0.0, -normal_gravity(lat, h)])
        a = q.apply(force(t)) + down - 2.0 * np.cross(spin, v)
        w = rate(t) - q.inv().apply(spin)
        x, s = y[6:9], y[9]
        return np.concatenate([v, a, 0.5 * (s * w + np.cross(x, w)), [-0.5 * x @ w]])

    to_earth = level_axes(nav[0], nav[1])
    start = np.concatenate(
        [
            pymap3d.geodetic2ecef(*nav[:3], deg=False),
            to_earth.apply(nav[3:6]),
            (to_earth * Rotation.from_quat(nav[6:10])).as_quat(),
        ]
    )
    y = solve_ivp(slope, (0.0, seconds), start, method='DOP853', rtol=1e-12, atol=1e-9).y[:, -1]
    lat, lon, h = (float(x) for x in pymap3d.ecef2geodetic(*y[:3], deg=False))
    level = level_axes(lat, lon).inv()
    return np.array([lat, lon, h]), level.apply(y[3:6]), level * Rotation.from_quat(y[6:10])


def errors(nav, rate, force, dt, seconds, truth):
    """Return how far mechanising with steps ``dt`` is off in the end: m, m/s and rad (3,)."""
    nav = nav.copy()
    for k in range(round(seconds / dt)):
        t, after = k * dt, (k + 1) * dt
        ins.mechanise(nav, rate(after), force(after), rate(t), force(t), dt)
    place, velocity, attitude = truth
    metres = np.array([SEMI_MAJOR, SEMI_MAJOR * np.cos(place[0]), 1.0])
    return np.array(
        [
            np.linalg.norm((nav[:3] - place) * metres),
            np.linalg.norm(nav[3:6] - velocity),
            (attitude.inv() * Rotation.from_quat(nav[6:10])).magnitude(),
        ]
    )


LATITUDES = [-70.0, 5.0, 40.3458]


@pytest.mark.parametrize('lat', LATITUDES)
def test_second_order_against_earth_fixed_equations(lat, normal_gravity):
    """
    Another formulation, with neither radii of curvature nor a transport rate, solved to 1e-12.

    Halving the step quarters every error: nothing of first order in it is wrong or missing.
    """
    ride = nav_at(lat * DEG, 1.0, 120.0, (70.0, -50.0, 1.0), Rotation.from_euler('z', 0.7))
    ride = (ride, shaken_rate, shaken_force)
    truth = earth_fixed_solution(*ride, 20.0, normal_gravity)
    coarse, fine = (errors(*ride, dt, 20.0, truth) for dt in (0.02, 0.01))
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.02)
    # dt^2 / 12 of the rate's derivative, 0.3 rad/s^2, is 2.5e-6 rad; of gravity over 20 s, 5 mm.
    assert fine[2] < 5e-6
    assert fine[0] < 1e-2


@pytest.mark.parametrize('lat', LATITUDES)
def test_the_earths_part_is_second_order_too(lat, normal_gravity):
    """
    Steady rate and force leave the Earth's part alone, and steps of seconds make it large.

    A ride that climbs, turns and gains 120 m/s: Coriolis, gravity, the frame's own rotation and
    the radii all change within a step.
    """
    ride = nav_at(lat * DEG, 1.0, 0.0, (-30.0, 20.0, 0.0), Rotation.from_euler('z', 2.0))
    ride = (ride, steady_rate, steady_force)
    truth = earth_fixed_solution(*ride, 96.0, normal_gravity)
    coarse, fine = (errors(*ride, dt, 96.0, truth) for dt in (4.0, 2.0))
    # Orders above the second make it more than four times less; the first would make it two.
    assert (coarse / fine).min() > 3.9
    # Coriolis by the speed at a step's beginning would be off by 1.5e-4 rad/s of 120 m/s: 0.02.
    assert fine[1] < 1e-4
    # The trapezoid leaves dt^2 / 12 of the change of acceleration, 1 m/s^2 or so.
    assert fine[0] < 0.5


def test_coning_and_sculling_are_third_order_where_samples_are_all(normal_gravity):
    """
    Rate and force that really are straight lines over one step: what is left is of fourth order.

    Halving the step makes the error of velocity 16 times less, and 8 without sculling or without
    the second effect of a turn; of the attitude 32 times, and 8 without coning.
    """
    ride = nav_at(0.7, 1.0, 0.0, (10.0, 20.0, 0.0), Rotation.from_euler('xyz', [0.3, 0.2, 0.7]))
    ride = (ride, ramp_rate, ramp_force)
    coarse, fine = (
        errors(*ride, dt, dt, earth_fixed_solution(*ride, dt, normal_gravity)) for dt in (0.1, 0.05)
    )
    assert coarse[1] / fine[1] > 14.0
    assert coarse[2] / fine[2] > 28.0


# pyins has axes north, east, down and forward, right, down.
FLIP = np.array([1.0, -1.0, -1.0])
ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def as_nav(pva: pd.Series):
    """Return what pyins calls position, velocity and attitude as ours (10,)."""
    R = ENU_FROM_NED @ transform.mat_from_rph(pva[['roll', 'pitch', 'heading']]) @ np.diag(FLIP)
    velocity = ENU_FROM_NED @ pva[['VN', 'VE', 'VD']].to_numpy(float)
    place = (pva['lat'] * DEG, pva['lon'] * DEG, pva['alt'])
    return nav_at(*place, velocity, Rotation.from_matrix(R))


def apart(a, b):
    """Return how far apart two states are: level [m], height [m], velocity [m/s], turn [rad]."""
    east = (a[1] - b[1]) * np.cos(b[0])
    turn = Rotation.from_quat(a[6:10]).inv() * Rotation.from_quat(b[6:10])
    return (
        SEMI_MAJOR * np.hypot(a[0] - b[0], east),
        abs(a[2] - b[2]),
        np.abs(a[3:6] - b[3:6]).max(),
        turn.magnitude(),
    )


@pytest.mark.filterwarnings('ignore:The copy keyword is deprecated')
def test_ride_of_pyins():
    """
    Same stream, made and integrated by pyins: in the end both are where its truth is.

    It states 10 m, 1e-2 m/s and 1e-4 deg after an hour of this motion from rates at 100 Hz; a free
    navigator's errors grow with the square of time, so ten minutes make 0.28 m at most. The ride
    stays on the ellipsoid: pyins lets gravity's slope with height be the same everywhere.
    """
    truth, imu = sim.generate_sine_velocity_motion(
        0.01,
        600.0,
        [40.0, 116.0, 0.0],
        [50.0, -30.0, 0.0],
        velocity_change_amplitude=[1.0, 1.0, 0.0],
    )
    theirs = strapdown.Integrator(truth.iloc[0]).integrate(
        strapdown.compute_increments_from_imu(imu, 'rate')
    )
    nav = as_nav(truth.iloc[0])
    gyro = imu[['gyro_x', 'gyro_y', 'gyro_z']].to_numpy() * FLIP
    accel = imu[['accel_x', 'accel_y', 'accel_z']].to_numpy() * FLIP
    for k in range(1, len(imu)):
        ins.mechanise(nav, gyro[k], accel[k], gyro[k - 1], accel[k - 1], 0.01)
    stated = (10.0 / 36.0, 10.0 / 36.0, 1e-2, 1e-4 * DEG)
    from_truth = apart(nav, as_nav(truth.iloc[-1]))
    from_theirs = apart(nav, as_nav(theirs.iloc[-1]))
    assert all(found < limit for found, limit in zip(from_truth, stated, strict=True)), from_truth
    assert all(found < limit for found, limit in zip(from_theirs, stated, strict=True)), from_theirs
    # Both round the same way from the same samples: what parts them is of the Earth, not of dt.
    assert from_theirs[0] < 0.01
    assert from_theirs[1] < 0.01

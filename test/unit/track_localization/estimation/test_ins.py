"""Mechanisation against closed forms; corrections of the navigation state."""

import numpy as np
import pytest
from pyins import earth
from scipy.spatial.transform import Rotation

from track_localization.estimation import ins

RATE, SEMI_MAJOR, ECC2 = 7.292115e-5, 6378137.0, 6.69437999014e-3
DEG = np.pi / 180.0


def nav_at(lat, lon, h, velocity=(0.0, 0.0, 0.0), attitude=None):
    attitude = Rotation.identity() if attitude is None else attitude
    return np.array([lat, lon, h, *velocity, *attitude.as_quat()])


def earth_rate(lat):
    return RATE * np.array([0.0, np.cos(lat), np.sin(lat)])


def run(nav, w, f, dt, steps, level=False):
    """Mechanise a constant rate and force; ``level`` holds the height, as a barometer would."""
    for _ in range(steps):
        ins.mechanise(nav, w, f, w, f, dt)
        if level:
            nav[2] = nav[5] = 0.0
    return nav


@pytest.mark.parametrize('lat', [-60 * DEG, 0.0, 40.3458 * DEG])
@pytest.mark.parametrize('rpy', [(0.0, 0.0, 0.0), (0.02, -0.03, 2.1), (1.0, -1.2, -3.0)])
def test_at_rest_for_an_hour(lat, rpy):
    """
    Nothing but rounding moves it: 360 000 steps, each good to 1e-16 of a turn, or 1e-11 rad in all.

    That tilts gravity by 1e-10 m/s^2, or 6e-5 m in a Schuler period. Height grows an error of
    1e-15 g by cosh(kt) = 270 / k^2, k = 1.75e-3: less than a millimetre too.
    """
    attitude = Rotation.from_euler('xyz', rpy)
    g = 9.7803253359 * (1.0 + 0.00193185265241 * np.sin(lat) ** 2)
    f = attitude.inv().apply([0.0, 0.0, g / np.sqrt(1.0 - ECC2 * np.sin(lat) ** 2)])
    w = attitude.inv().apply(earth_rate(lat))
    nav = nav_at(lat, 2.0, 0.0, attitude=attitude)
    run(nav, w, f, 0.01, 360_000)
    np.testing.assert_allclose(nav[:2] * SEMI_MAJOR, np.array([lat, 2.0]) * SEMI_MAJOR, atol=1e-3)
    assert abs(nav[2]) < 1e-2
    np.testing.assert_allclose(nav[3:6], 0.0, atol=1e-5)
    turn = (attitude.inv() * Rotation.from_quat(nav[6:10])).magnitude()
    assert turn < 1e-10


@pytest.mark.parametrize('speed', [100.0, -80.0])
def test_along_a_parallel(speed):
    """
    A ride along a parallel is one steady rotation about the Earth's axis: rate and force in the
    body stay as they are, the centripetal force points to that axis, and longitude grows by rate.
    """
    lat, seconds = 52.0 * DEG, 600.0
    across = SEMI_MAJOR / np.sqrt(1.0 - ECC2 * np.sin(lat) ** 2)
    radius = across * np.cos(lat)
    total = RATE + speed / radius
    g = 9.7803253359 * (1.0 + 0.00193185265241 * np.sin(lat) ** 2) * across / SEMI_MAJOR
    outward = np.array([0.0, -np.sin(lat), np.cos(lat)])
    f = np.array([0.0, 0.0, g]) - (total**2 - RATE**2) * radius * outward
    w = total / RATE * earth_rate(lat)
    yaw = Rotation.from_euler('z', 0.3)
    nav = nav_at(lat, 0.1, 0.0, (speed, 0.0, 0.0), yaw)
    run(nav, yaw.inv().apply(w), yaw.inv().apply(f), 0.01, round(100 * seconds))
    # A step's midpoint leaves (w dt)^2 / 12 of 10 m/s^2 out, w the frame's 1e-4 rad/s: nothing.
    assert (nav[0] - lat) * SEMI_MAJOR == pytest.approx(0.0, abs=1e-4)
    assert (nav[1] - 0.1) * radius == pytest.approx(speed * seconds, abs=1e-4)
    assert nav[2] == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_allclose(nav[3:6], [speed, 0.0, 0.0], atol=1e-6)
    assert (yaw.inv() * Rotation.from_quat(nav[6:10])).magnitude() < 1e-10


def schuler(gyro_bias=0.0, tilt=0.0, hours=2.0, dt=0.1):
    """Return east velocities (N,) at the equator of a free navigator at rest, height held."""
    nav = nav_at(0.0, 0.0, 0.0, attitude=Rotation.from_rotvec([0.0, tilt, 0.0]))
    w, f = earth_rate(0.0), np.array([0.0, 0.0, 9.7803253359])
    w[1] += gyro_bias
    out = np.empty(round(hours * 3600.0 / dt))
    for k in range(len(out)):
        run(nav, w, f, dt, 1, level=True)
        out[k] = nav[3]
    return out


def test_a_tilt_swings_with_the_schuler_period():
    """2 pi sqrt(R / g) is 84.4 min for the mean Earth, 84.6 min east at the equator."""
    period = 2.0 * np.pi * np.sqrt(SEMI_MAJOR / 9.7803253359)
    assert period / 60.0 == pytest.approx(84.6, abs=0.05)
    east = schuler(tilt=1e-5, hours=3.0)
    rising = np.flatnonzero((east[:-1] < 0.0) & (east[1:] >= 0.0))
    crossing = 0.1 * (rising + 1 - east[rising] / (east[rising + 1] - east[rising]))
    assert len(crossing) == 2
    # Zero crossings of a line between samples: 0.1 s of 5 000 s at most.
    assert np.diff(crossing)[0] == pytest.approx(period, rel=2e-5)
    assert np.abs(east).max() == pytest.approx(1e-5 * np.sqrt(9.7803253359 * SEMI_MAJOR), rel=1e-3)


def test_a_gyro_bias_drifts_as_the_closed_form_says():
    """East velocity is b R (1 - cos w t): 0.01 deg/h makes 0.6 m/s at most."""
    bias = 0.01 * DEG / 3600.0
    east = schuler(gyro_bias=bias)
    t = 0.1 * np.arange(1, len(east) + 1)
    expected = bias * SEMI_MAJOR * (1.0 - np.cos(np.sqrt(9.7803253359 / SEMI_MAJOR) * t))
    np.testing.assert_allclose(east, expected, atol=1e-3 * np.abs(expected).max())


def test_height_is_unstable_as_the_closed_form_says(normal_gravity):
    """
    An accelerometer's bias b grows to b / k^2 (cosh k t - 1), k^2 the slope of gravity: 2 g / R.

    At 80 degrees, where Coriolis (4 w^2 cos^2(lat) = 6e-10 of k^2 = 3e-6) stays out of it.
    """
    lat, bias = 80.0 * DEG, 1e-4
    k = np.sqrt((normal_gravity(lat, -100.0) - normal_gravity(lat, 100.0)) / 200.0)
    f = np.array([0.0, 0.0, normal_gravity(lat, 0.0) + bias])
    nav = run(nav_at(lat, 0.0, 0.0), earth_rate(lat), f, 0.1, 18_000)
    expected = bias / k**2 * (np.cosh(1800.0 * k) - 1.0)
    assert expected > 300.0
    assert nav[2] == pytest.approx(expected, rel=1e-3)


def coning(t, half_angle, speed):
    """Return attitude (4,) and rate (3,) of an axis that goes round a cone, at time t."""
    s, c = np.sin(0.5 * half_angle), np.cos(0.5 * half_angle)
    turning = np.array([0.0, np.cos(speed * t), np.sin(speed * t)])
    side = np.array([0.0, -np.sin(speed * t), np.cos(speed * t)])
    rate = speed * np.sin(half_angle) * side - 2.0 * speed * s * s * np.array([1.0, 0.0, 0.0])
    return np.array([*(s * turning), c]), rate


@pytest.mark.parametrize('dt', [0.01, 0.005])
def test_coning_drifts_only_by_what_sampling_leaves(dt):
    """
    Rates that are straight lines between samples enclose a little less than the true circle.

    With x = W dt the cone's drift sin^2(b) W / 2 per second comes out short by the factor
    2 x sin x (1 / (8 tan^2(x / 2)) + 1 / 12), from the areas of the inscribed polygons; without
    the coning term it would be short by twice that.
    """
    half_angle, speed, seconds = 2.0 * DEG, 2.0 * np.pi * 3.0, 20.0
    q0, _ = coning(0.0, half_angle, speed)
    lat, g = 45.0 * DEG, 9.80619777
    nav = nav_at(lat, 0.0, 0.0, attitude=Rotation.from_quat(q0))

    def sample(t):
        q, rate = coning(t, half_angle, speed)
        level = Rotation.from_quat(q).inv()
        return rate + level.apply(earth_rate(lat)), level.apply([0.0, 0.0, g])

    before = sample(0.0)
    for k in range(round(seconds / dt)):
        now = sample((k + 1) * dt)
        ins.mechanise(nav, now[0], now[1], before[0], before[1], dt)
        before = now
    x = speed * dt
    kept = 2.0 * x * np.sin(x) * (1.0 / (8.0 * np.tan(0.5 * x) ** 2) + 1.0 / 12.0)
    drift = 0.5 * np.sin(half_angle) ** 2 * speed * (kept - 1.0) * seconds
    q_end, _ = coning(seconds, half_angle, speed)
    error = (Rotation.from_quat(nav[6:10]) * Rotation.from_quat(q_end).inv()).as_rotvec()
    assert error[0] == pytest.approx(drift, rel=0.02)
    # Across the cone the chords' own shortness x^2 / 12 of its angle is left, to and fro.
    assert np.abs(error[1:]).max() < half_angle * x * x / 6.0


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_across_the_date_line(way):
    """Longitude stays within pi of zero."""
    lat, g = 0.2, ins.gravity(0.2, 0.0)
    nav = nav_at(lat, way * (np.pi - 1e-7), 0.0, (way * 100.0, 0.0, 0.0))
    run(nav, earth_rate(lat), np.array([0.0, 0.0, g]), 0.01, 100)
    passed = 100.0 - 1e-7 * SEMI_MAJOR * np.cos(lat)
    assert abs(nav[1]) < np.pi
    assert np.sign(nav[1]) == -way
    east = (np.pi - abs(nav[1])) * SEMI_MAJOR * np.cos(lat)
    # The radius across the meridian is 0.01 % more than the equator's here.
    assert east == pytest.approx(passed, rel=1e-3)


@pytest.mark.parametrize('lat', [-60.0, 0.0, 40.0, 80.0])
def test_inject_adds_the_error_it_is_given(lat, rng):
    """Read back by pyins' radii and scipy's rotations; longer errors' tails are left alone."""
    attitude = Rotation.random(rng=rng)
    nav = nav_at(lat * DEG, -2.0, 300.0, (30.0, 40.0, -1.0), attitude)
    before = nav.copy()
    dx = np.concatenate([[120.0, -85.0, 9.0], [0.3, -0.2, 0.1], [0.2, -0.1, 0.3], np.ones(10)])
    ins.inject(nav, dx)
    north, _, parallel = earth.principal_radii(lat, 300.0)
    moved = (nav - before)[:3] * [north, parallel, 1.0]
    # Differences of angles are rounded to 2e-16 of a turn: 3e-9 m.
    np.testing.assert_allclose(moved, [-85.0, 120.0, 9.0], atol=1e-8)
    np.testing.assert_allclose((nav - before)[3:6], dx[3:6], atol=1e-13)
    turn = attitude.inv() * Rotation.from_quat(nav[6:10])
    np.testing.assert_allclose(turn.as_rotvec(), dx[6:9], atol=1e-14)
    assert np.linalg.norm(nav[6:10]) == pytest.approx(1.0, abs=1e-15)


def test_inject_there_and_back():
    """Taken back, an error leaves what the change of the radii leaves: (d / R)^2 R."""
    nav = nav_at(0.7, 2.0, 100.0, (30.0, 40.0, -1.0), Rotation.from_rotvec([0.3, -0.2, 1.0]))
    before, dx = nav.copy(), np.zeros(15)
    dx[:9] = [50.0, -30.0, 4.0, 1.0, -2.0, 0.5, 0.1, 0.2, -0.3]
    ins.inject(nav, dx)
    assert np.abs(nav - before)[3:].max() > 0.01
    ins.inject(nav, -dx)
    metres = (nav - before)[:3] * [SEMI_MAJOR, SEMI_MAJOR * np.cos(0.7), 1.0]
    np.testing.assert_allclose(metres, 0.0, atol=50.0 * 50.0 / SEMI_MAJOR)
    np.testing.assert_allclose(nav[3:], before[3:], atol=1e-14)


def test_attitude_matrix_turns_the_body_to_east_north_up(rng):
    attitude, C = Rotation.random(rng=rng), np.empty((3, 3))
    ins.attitude_matrix(nav_at(0.1, 0.2, 0.3, attitude=attitude), C)
    np.testing.assert_allclose(C, attitude.as_matrix(), atol=1e-14)

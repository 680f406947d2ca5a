"""The line on the Earth, and the inertial truth against an integrator of its own."""

import numpy as np
import pymap3d
import pytest
from numba import njit
from pymap3d.vincenty import vdist
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from track_localization.geodesy import Datum, geodetic_from_enu
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.sim.train.alignment import Alignment
from track_localization.sim.train.route import Route, gravity

PERFECT = {'imu.rate_hz': 1000.0, 'clock.truth_rate_hz': 1000.0, 'motion.legs': 1}
PERFECT['survey.given'] = False
PERFECT |= {
    f'imu.{name}': 0.0
    for name in (
        *('gyro_bias_dph', 'angle_walk', 'accel_bias_mg', 'velocity_walk'),
        *('gyro_in_run_dph', 'accel_in_run_mg'),
    )
}
SPIN = 7.292115e-5
NONE = np.zeros(0)


def axes_at(lat, lon):
    """Return east, north and up as columns, in Earth-centred, Earth-fixed axes."""
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return np.stack([east, np.cross(up, east), up], axis=1)


@njit
def slope(state, feel, out):
    """
    Write how place, velocity and quaternion change, in Earth-fixed axes, into ``out`` (10,).

    Gravity is Somigliana's in the form with the eccentricity; latitude and height are Bowring's.
    """
    x, y, z, u, v, w, i, j, k, s = state
    a, b = 6378137.0, 6356752.314245
    e2, level = 1.0 - (b / a) ** 2, np.hypot(x, y)
    beta = np.arctan2(a * z, b * level)
    north = z + e2 * a**2 / b * np.sin(beta) ** 3
    lat = np.arctan2(north, level - e2 * a * np.cos(beta) ** 3)
    s2, root = np.sin(lat) ** 2, np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
    h = level * np.cos(lat) + z * np.sin(lat) - a * root
    f = 1.0 / 298.257223563
    g = 9.7803253359 * (1.0 + 0.00193185265241 * s2) / root
    g *= 1.0 - 2.0 * (1.0 + f + 0.00344978650684 - 2.0 * f * s2) * h / a + 3.0 * (h / a) ** 2
    fx, fy, fz, p, q, r = feel
    cx, cy, cz = j * fz - k * fy + s * fx, k * fx - i * fz + s * fy, i * fy - j * fx + s * fz
    out[0], out[1], out[2] = u, v, w
    out[3] = fx + 2.0 * (j * cz - k * cy) + 2.0 * SPIN * v - g * np.cos(lat) * x / level
    out[4] = fy + 2.0 * (k * cx - i * cz) - 2.0 * SPIN * u - g * np.cos(lat) * y / level
    out[5] = fz + 2.0 * (i * cy - j * cx) - g * np.sin(lat)
    out[6] = 0.5 * (s * p + j * r - k * q + SPIN * j)
    out[7] = 0.5 * (s * q + k * p - i * r - SPIN * i)
    out[8] = 0.5 * (s * r + i * q - j * p - SPIN * s)
    out[9] = 0.5 * (SPIN * k - i * p - j * q - k * r)


@njit
def runge_kutta(state, feel, h):
    """Integrate samples (2n + 1, 6) at every half step ``h / 2``; ``state`` (10,) goes along."""
    k1, k2, k3, k4 = np.zeros(10), np.zeros(10), np.zeros(10), np.zeros(10)
    for i in range(0, len(feel) - 2, 2):
        slope(state, feel[i], k1)
        slope(state + 0.5 * h * k1, feel[i + 1], k2)
        slope(state + 0.5 * h * k2, feel[i + 1], k3)
        slope(state + h * k3, feel[i + 2], k4)
        state += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def carried(simulated, duration):
    """
    Integrate an error-free IMU in Earth-fixed axes; return errors at the end.

    Nothing of a local level: no transport rate, no latitude in the state.
    """
    local, rate = simulated.local, simulated.imu.rate_hz
    n = 2 * round(duration * rate / 2)

    def state(i):
        place = local.latitude[i], local.longitude[i], local.height[i]
        C = axes_at(*place[:2])
        q = (Rotation.from_matrix(C) * Rotation.from_quat(local.quaternion[i])).as_quat()
        return np.concatenate([pymap3d.geodetic2ecef(*place, deg=False), C @ local.velocity[i], q])

    imu = simulated.imu
    feel = np.concatenate([imu.specific_force, imu.angular_rate], axis=1)[: n + 1]
    found, true = state(0), state(n)
    runge_kutta(found, feel, 2.0 / rate)
    tilt = (Rotation.from_quat(true[6:]).inv() * Rotation.from_quat(found[6:])).magnitude()
    return np.linalg.norm(found[:3] - true[:3]), np.linalg.norm(found[3:6] - true[3:6]), tilt


@pytest.mark.parametrize('name', ['paper', 'line'])
def test_an_ideal_imu_carries_the_train_to_where_it_is(name):
    """
    200 s, through curves, slopes and a start: 3 mm, 0.03 mm/s, 3e-8 rad.

    An error of 1e-6 m/s^2 would be 2 cm, so gravity, Coriolis and transport rates are all in it:
    the least of them, the transport rate's part of the Coriolis force, is 6e-4 m/s^2. Sampled at
    1 kHz, as the ends of transitions are kinks.
    """
    simulated = simulate_train(override(scenario(name), PERFECT), 5)
    position, velocity, tilt = carried(simulated, 200.0)
    assert simulated.speed.max() > 50.0
    assert position < 0.003
    assert velocity < 3e-5
    assert tilt < 3e-8


def test_truth_in_map_and_against_the_horizon_are_one():
    """Same place by pymap3d; velocity is the position's slope; x of the vehicle lies along it."""
    simulated = simulate_train(scenario('paper'), 2)
    local = simulated.local
    geodetic = geodetic_from_enu(simulated.position, simulated.datum)
    place = np.stack([local.latitude, local.longitude, local.height], axis=1)
    np.testing.assert_allclose(
        geodetic * [6.4e6, 4.9e6, 1.0], place * [6.4e6, 4.9e6, 1.0], atol=1e-6
    )
    slope = CubicSpline(simulated.time_s, simulated.position)(simulated.time_s, 1)
    np.testing.assert_allclose(slope[9:-9], simulated.velocity[9:-9], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(simulated.velocity, axis=1), simulated.speed)
    for velocity, quaternion in (
        (simulated.velocity, simulated.quaternion),
        (local.velocity, local.quaternion),
    ):
        body = Rotation.from_quat(quaternion).apply(velocity, inverse=True)
        vehicle = body @ simulated.mount  # R_bv' v_b
        np.testing.assert_allclose(vehicle[:, 0], simulated.speed, rtol=1e-12)
        np.testing.assert_allclose(vehicle[:, 1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(simulated.position[0], 0.0, atol=1e-6)


def test_chainage_is_the_length_of_the_way_in_space():
    """11 km of chords of 0.55 m in a curve of 2.2 km: they are 0.3 micrometres too short each."""
    simulated = simulate_train(scenario('paper'), 3)
    way = np.linalg.norm(np.diff(simulated.position, axis=0), axis=1).sum()
    assert simulated.chainage[-1] - simulated.chainage[0] == pytest.approx(way, abs=1e-3)


def flat(course, length=30e3):
    return Alignment(length, course, np.zeros((0, 2)), *(NONE,) * 6)


def test_a_level_straight_line_is_a_geodesic():
    """By Vincenty's formula; not the plane of ``map``: 30 km away the Earth has fallen by 70 m."""
    datum = Datum(0.7, 2.0, 0.0)
    route = Route.lay(flat(0.0), datum, 0.0)
    s = np.linspace(0.0, 30e3, 7)
    latitude, longitude, height = route.place(s)
    np.testing.assert_allclose(height, 0.0, atol=1e-9)
    for i in range(1, 7):
        arc, azimuth = vdist(latitude[0], longitude[0], latitude[i], longitude[i], deg=False)
        assert arc == pytest.approx(s[i], abs=1e-3)
        assert azimuth == pytest.approx(np.pi / 2, abs=1e-7)
        _, back = vdist(latitude[i], longitude[i], latitude[0], longitude[0], deg=False)
        course = np.pi / 2 - (back - np.pi)
        assert route.angles(s[i : i + 1]).course == pytest.approx(course, abs=1e-7)


def test_along_a_meridian():
    """The way is the ellipsoid's arc, by Vincenty's formula."""
    route = Route.lay(flat(np.pi / 2), Datum(0.7, 2.0, 0.0), 0.0)
    latitude, longitude, _ = route.place(np.array([0.0, 30e3]))
    arc, _ = vdist(latitude[0], longitude[0], latitude[1], longitude[1], deg=False)
    assert arc == pytest.approx(30e3, abs=1e-3)
    np.testing.assert_allclose(longitude, 2.0, atol=1e-15)


@pytest.mark.parametrize(
    ('latitude', 'height', 'expected'),
    [
        (0.0, 0.0, 9.7803253359),
        (90.0, 0.0, 9.8321849378),
        (45.0, 0.0, 9.806199203),  # Moritz, Geodetic Reference System 1980, table of gamma
        (45.0, 1000.0, 9.806199203 - 3.0852e-3),  # free air: 0.30877 - 0.00044 sin^2 mGal/m, + h^2
    ],
)
def test_gravity(latitude, height, expected):
    """Published values: the ends exactly, GRS 80's table to its 2 micrometres/s^2."""
    found = gravity(np.radians([latitude]), np.array([height]))[0]
    assert found == pytest.approx(expected, abs=2e-6)

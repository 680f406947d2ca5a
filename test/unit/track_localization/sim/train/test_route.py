"""The line on the Earth, and the inertial truth against an integrator of its own."""

import numpy as np
import pymap3d
import pytest
from pymap3d.vincenty import vdist
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from track_localization.geodesy import Datum, geodetic_from_enu
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.sim.train.alignment import Alignment
from track_localization.sim.train.route import Route, gravity

PERFECT = {'imu.rate_hz': 1000.0, 'clock.truth_rate_hz': 1000.0}
PERFECT |= {
    f'imu.{name}': 0.0
    for name in (
        *('gyro_bias_dph', 'angle_walk', 'accel_bias_mg', 'velocity_walk'),
        *('gyro_in_run_dph', 'accel_in_run_mg'),
    )
}
SPIN = np.array([0.0, 0.0, 7.292115e-5])
NONE = np.zeros(0)


def axes_at(lat, lon):
    """Return east, north and up as columns, in Earth-centred, Earth-fixed axes."""
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return np.stack([east, np.cross(up, east), up], axis=1)


def pull(p):
    """Return normal gravity (3,) at an Earth-fixed point, by Somigliana's other form."""
    lat, lon, h = (float(x) for x in pymap3d.ecef2geodetic(*p, deg=False))
    s2 = np.sin(lat) ** 2
    surface = 9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - 0.00669437999014 * s2)
    slope = 2.0 * (1.0 + 1 / 298.257223563 + 0.00344978650684 - 2 / 298.257223563 * s2)
    g = surface * (1.0 - slope * h / 6378137.0 + 3.0 * (h / 6378137.0) ** 2)
    return -g * axes_at(lat, lon)[:, 2]


def carried(simulated, duration):
    """
    Integrate an error-free IMU in Earth-fixed axes; return errors at the end.

    Nothing of a local level: no transport rate, no latitude in the state. The samples are joined
    by a spline and integrated by an eighth-order method with its own step.
    """
    local, t = simulated.local, simulated.time_s - simulated.time_s[0]
    n = int(np.searchsorted(t, duration + 1e-9)) - 1
    imu = simulated.imu
    feel = CubicSpline(t, np.concatenate([imu.specific_force, imu.angular_rate], axis=1))

    def slope(time, state):
        p, v, (x, y, z, s) = state[:3], state[3:6], state[6:]
        f, w = np.split(feel(time), 2)
        E = np.array([[s, -z, y], [z, s, -x], [-y, x, s], [-x, -y, -z]])
        r = np.array([x, y, z])
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        R = (s * s - r @ r) * np.eye(3) + 2.0 * (np.outer(r, r) + s * K)
        a = R @ f - 2.0 * np.cross(SPIN, v) + pull(p)
        return np.concatenate([v, a, 0.5 * E @ (w - R.T @ SPIN)])

    def state(i):
        place = local.latitude[i], local.longitude[i], local.height[i]
        C = axes_at(*place[:2])
        q = (Rotation.from_matrix(C) * Rotation.from_quat(local.quaternion[i])).as_quat()
        p = np.array(pymap3d.geodetic2ecef(*place, deg=False))
        return np.concatenate([p, C @ local.velocity[i], q])

    found = solve_ivp(
        slope, (0.0, t[n]), state(0), method='DOP853', rtol=1e-10, atol=1e-10, max_step=1.0
    ).y[:, -1]
    true = state(n)
    tilt = (Rotation.from_quat(true[6:]).inv() * Rotation.from_quat(found[6:])).magnitude()
    return np.linalg.norm(found[:3] - true[:3]), np.linalg.norm(found[3:6] - true[3:6]), tilt


@pytest.mark.parametrize('name', ['paper', 'line'])
def test_an_ideal_imu_carries_the_train_to_where_it_is(name):
    """
    200 s, through curves, slopes and a start: 5 mm, 0.1 mm/s, 1e-7 rad.

    An error of 1e-6 m/s^2 would be 2 cm, so gravity, Coriolis and transport rates are all in it:
    the least of them, the transport rate's part of the Coriolis force, is 6e-4 m/s^2. Sampled at
    1 kHz, as the ends of transitions are kinks that the spline rounds (at 100 Hz by 3 cm).
    """
    simulated = simulate_train(override(scenario(name), PERFECT), 5)
    position, velocity, tilt = carried(simulated, 200.0)
    assert simulated.speed.max() > 50.0
    assert position < 0.005
    assert velocity < 1e-4
    assert tilt < 1e-7


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


def test_a_level_straight_line_keeps_its_height_and_course():
    """Not the plane of ``map``: 30 km away the Earth has fallen by 70 m."""
    datum = Datum(0.7, 2.0, 100.0)
    route = Route.lay(flat(0.0), datum, 0.0)
    s = np.linspace(0.0, 30e3, 7)
    latitude, longitude, height = route.place(s)
    np.testing.assert_allclose(height, 100.0, atol=1e-9)
    np.testing.assert_allclose(latitude, 0.7, atol=1e-15)
    # along a parallel: its radius is N + h times the cosine of the latitude
    across = 6378137.0 / np.sqrt(1.0 - 0.00669437999014 * np.sin(0.7) ** 2)
    np.testing.assert_allclose((longitude - 2.0) * (across + 100.0) * np.cos(0.7), s, atol=1e-6)


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

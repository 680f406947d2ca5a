"""
The train on the rotating Earth: where it is, how it lies, and what an ideal IMU would feel.

The line is laid on the WGS-84 ellipsoid by course, slope and cant against the local horizon; what
is set out straight is a geodesic, whose course against north changes with the longitude. And
everything else follows by differentiating, never by integrating inertial quantities: this is the
inverse of a strapdown mechanisation (Groves, Principles of GNSS, Inertial, and Multisensor
Integrated Navigation Systems, 2nd ed., sections 2.4 and 5.4) and shares no code with one.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from track_localization.estimation import so3
from track_localization.geodesy import Datum
from track_localization.sim.train.alignment import Alignment, Angles
from track_localization.sim.train.waves import Waves

Array = NDArray[np.float64]

SEMI_MAJOR_M = 6378137.0
ECCENTRICITY2 = 6.69437999014e-3
EARTH_RATE = 7.292115e-5
GRAVITY_EQUATOR = 9.7803253359
GRAVITY_POLE = 9.8321849378
FLATTENING = 1.0 / 298.257223563
CENTRIFUGAL = 3.449786506841e-3
"""m of WGS 84: omega^2 a^2 b / GM."""

STEP_M = 2.0
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
ROUNDS = 5
"""Of the latitude's fixed-point iteration; each gains some three digits over 100 km."""


class Pose(NamedTuple):
    """
    Where the vehicle is and how it lies and moves, against the local horizon, (N,) rows.

    Attributes:
        latitude, longitude: [rad].
        height: above the ellipsoid [m].
        velocity: (N, 3) east, north, up there [m/s].
        attitude: (N, 3, 3) vehicle axes to east, north, up there.
    """

    latitude: Array
    longitude: Array
    height: Array
    velocity: Array
    attitude: Array


@dataclasses.dataclass(frozen=True)
class Route:
    """An alignment on the Earth, rails in waves; ``start`` is the chainage at the datum."""

    alignment: Alignment
    datum: Datum
    start: float
    _waves: Waves | None
    _place: CubicHermiteSpline

    @classmethod
    def lay(
        cls, alignment: Alignment, datum: Datum, start: float, waves: Waves | None = None
    ) -> Route:
        """Lay an alignment so that it passes the datum at chainage ``start``."""
        count = int(np.ceil(alignment.length / STEP_M))
        grid = np.linspace(0.0, alignment.length, count + 1)
        grid = np.unique(np.append(grid, start))
        origin = int(np.searchsorted(grid, start))
        half = 0.5 * np.diff(grid)
        s = 0.5 * (grid[1:] + grid[:-1])[:, None] + half[:, None] * NODES
        inner = _with(waves, alignment.at(s.ravel()), s.ravel())
        rise = np.sin(inner.slope).reshape(s.shape)
        height = datum.height_m + _from(origin, (rise @ WEIGHTS) * half)
        latitude, turned = np.full_like(grid, datum.latitude_rad), np.zeros_like(grid)
        for _ in range(ROUNDS):
            at, h = (np.interp(s, grid, values).ravel() for values in (latitude, height))
            course = inner.course + np.interp(s, grid, turned).ravel()
            rates = _angles_per_metre(inner._replace(course=course), at, h)
            north, east, turn = (rate.reshape(s.shape) @ WEIGHTS * half for rate in rates)
            latitude = datum.latitude_rad + _from(origin, north)
            turned = _from(origin, turn)
        longitude = datum.longitude_rad + _from(origin, east)
        knots = _with(waves, alignment.at(grid), grid)
        knots = knots._replace(course=knots.course + turned)
        north, east, turn = _angles_per_metre(knots, latitude, height)
        values = np.stack([latitude, longitude, height, turned], axis=1)
        slope = np.stack([north, east, np.sin(knots.slope), turn], axis=1)
        return cls(alignment, datum, start, waves, CubicHermiteSpline(grid, values, slope))

    def angles(self, s: Array) -> Angles:
        """Return the angles of the rails against the local horizon at chainages (N,)."""
        angles = _with(self._waves, self.alignment.at(s), s)
        latitude, _, height, turned = self._place(s).T
        angles = angles._replace(course=angles.course + turned)
        turn = _angles_per_metre(angles, latitude, height)[2]
        return angles._replace(course_rate=angles.course_rate + turn)

    def place(self, s: Array) -> tuple[Array, Array, Array]:
        """Return latitude, longitude [rad] and height [m] (N,) at chainages."""
        found = self._place(s)
        return found[:, 0], found[:, 1], found[:, 2]

    def pose(self, s: Array, speed: Array) -> Pose:
        """Return how a vehicle lies at chainages (N,), and moves at these speeds [m/s]."""
        angles = self.angles(s)
        R = attitude_of(angles)
        return Pose(*self.place(s), speed[:, None] * R[:, :, 0], R)

    def inertial(self, s: Array, speed: Array, acceleration: Array) -> tuple[Array, Array]:
        """Return specific force [m/s^2] and angular rate [rad/s] (N, 3) in vehicle axes."""
        angles = self.angles(s)
        latitude, _, height = self.place(s)
        R = attitude_of(angles)
        v = speed[:, None] * R[:, :, 0]
        earth, transport = earth_rate(latitude), transport_rate(latitude, height, v)
        bend = _bend(angles)
        f = acceleration[:, None] * R[:, :, 0] + speed[:, None] ** 2 * bend
        f += np.cross(2.0 * earth + transport, v)
        f[:, 2] += gravity(latitude, height)
        own = _turning(angles) * speed[:, None]
        turned = np.swapaxes(R, 1, 2)
        f_b = np.einsum('nij,nj->ni', turned, f)
        return f_b, own + np.einsum('nij,nj->ni', turned, earth + transport)


def attitude_of(angles: Angles) -> Array:
    """Return ``Rz(course) Ry(-slope) Rx(cant)`` (N, 3, 3)."""
    cy, sy = np.cos(angles.course), np.sin(angles.course)
    cp, sp = np.cos(angles.slope), np.sin(angles.slope)
    cr, sr = np.cos(angles.cant)[:, None], np.sin(angles.cant)[:, None]
    ahead = np.stack([cp * cy, cp * sy, sp], axis=1)
    left = np.stack([-sy, cy, np.zeros_like(cy)], axis=1)
    up = np.cross(ahead, left)
    return np.stack([ahead, cr * left + sr * up, cr * up - sr * left], axis=2)


def gravity(latitude: Array, height: Array) -> Array:
    """Return normal gravity (N,) [m/s^2]: Somigliana, to second order in height."""
    a, b = SEMI_MAJOR_M, SEMI_MAJOR_M * (1.0 - FLATTENING)
    c2, s2 = np.cos(latitude) ** 2, np.sin(latitude) ** 2
    surface = a * GRAVITY_EQUATOR * c2 + b * GRAVITY_POLE * s2
    surface /= np.sqrt(a**2 * c2 + b**2 * s2)
    x = height / a
    return np.asarray(
        surface
        * (1.0 - 2.0 * x * (1.0 + FLATTENING + CENTRIFUGAL - 2.0 * FLATTENING * s2) + 3.0 * x**2)
    )


def radii(latitude: Array) -> tuple[Array, Array]:
    """Return the radii of curvature (N,) along the meridian and across it [m]."""
    w2 = 1.0 - ECCENTRICITY2 * np.sin(latitude) ** 2
    across = SEMI_MAJOR_M / np.sqrt(w2)
    return across * (1.0 - ECCENTRICITY2) / w2, across


def earth_rate(latitude: Array) -> Array:
    """Return the Earth's turning (N, 3), east, north, up [rad/s]."""
    zero = np.zeros_like(latitude)
    return EARTH_RATE * np.stack([zero, np.cos(latitude), np.sin(latitude)], axis=1)


def transport_rate(latitude: Array, height: Array, v: Array) -> Array:
    """Return the turning (N, 3) of the horizon under a moving vehicle [rad/s]."""
    meridian, across = radii(latitude)
    east = v[:, 0] / (across + height)
    return np.stack([-v[:, 1] / (meridian + height), east, east * np.tan(latitude)], axis=1)


def axes_in_map(latitude: Array, longitude: Array, datum: Datum) -> Array:
    """Return rotations (N, 3, 3) from the local east, north, up to the axes of ``map``."""
    own = np.array([datum.latitude_rad]), np.array([datum.longitude_rad])
    R: Array = np.swapaxes(_axes(*own), 1, 2) @ _axes(latitude, longitude)
    return R


def quaternions(R: Array) -> Array:
    """Return quaternions (N, 4), x y z w, each on the side of the one before."""
    q = so3.quat_from_matrix(R)
    flip = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
    q[1:] *= flip[:, None]
    return q


def _axes(latitude: Array, longitude: Array) -> Array:
    """Return east, north and up (N, 3, 3), as columns, in axes fixed to the Earth."""
    ca, sa, co, so = np.cos(latitude), np.sin(latitude), np.cos(longitude), np.sin(longitude)
    east = np.stack([-so, co, np.zeros_like(so)], axis=1)
    north = np.stack([-sa * co, -sa * so, ca], axis=1)
    return np.stack([east, north, np.cross(east, north)], axis=2)


def _with(waves: Waves | None, angles: Angles, s: Array) -> Angles:
    return angles if waves is None else waves.on(angles, s)


def _angles_per_metre(angles: Angles, latitude: Array, height: Array) -> tuple[Array, Array, Array]:
    """
    Return how latitude, longitude and a geodesic's course change by the metre (N,) [rad/m].

    That course turns as the meridians do: to the right on the way east, on the northern half.
    """
    meridian, across = radii(latitude)
    level = np.cos(angles.slope)
    north = level * np.sin(angles.course) / (meridian + height)
    east = level * np.cos(angles.course) / ((across + height) * np.cos(latitude))
    return north, east, -east * np.sin(latitude)


def _from(origin: int, steps: Array) -> Array:
    """Return the sums (N + 1,) of steps (N,), zero at row ``origin``."""
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(total - total[origin])


def _bend(angles: Angles) -> Array:
    """Return how the direction changes by the metre (N, 3), east, north, up."""
    cy, sy = np.cos(angles.course), np.sin(angles.course)
    cp, sp = np.cos(angles.slope), np.sin(angles.slope)
    k, g = angles.course_rate, angles.slope_rate
    return np.stack([-g * sp * cy - k * cp * sy, -g * sp * sy + k * cp * cy, g * cp], axis=1)


def _turning(angles: Angles) -> Array:
    """Return the turning against the horizon by the metre (N, 3), in vehicle axes [rad/m]."""
    cp, sp = np.cos(angles.slope), np.sin(angles.slope)
    cr, sr = np.cos(angles.cant), np.sin(angles.cant)
    k, g = angles.course_rate, -angles.slope_rate
    return np.stack(
        [angles.cant_rate + k * sp, g * cr + k * cp * sr, -g * sr + k * cp * cr], axis=1
    )

"""From geodetic places and level axes to ``map``, the Cartesian frame of a datum, and back."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization.estimation.earth import curvature_radii
from track_localization.estimation.so3 import quat_one
from track_localization.geodesy import Datum, geodetic_from_enu
from train_localization.kernels import rotation

Array = NDArray[np.float64]

ECCENTRICITY2 = 6.69437999014e-3
"""Of the WGS-84 ellipsoid, squared."""


@njit(cache=True)
def level_axes(latitude: float, longitude: float) -> Array:
    """Return east, north, up of a place [rad] as rows (3, 3), Earth-centred."""
    sl, cl = math.sin(latitude), math.cos(latitude)
    so, co = math.sin(longitude), math.cos(longitude)
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = -so, co, 0.0
    out[1, 0], out[1, 1], out[1, 2] = -sl * co, -sl * so, cl
    out[2, 0], out[2, 1], out[2, 2] = cl * co, cl * so, sl
    return out


@njit(cache=True)
def earth_centred(latitude: float, longitude: float, height: float) -> Array:
    """Return a place's Earth-centred, Earth-fixed coordinates (3,) [m]."""
    _, normal = curvature_radii(latitude)
    out = np.empty(3)
    out[0] = (normal + height) * math.cos(latitude) * math.cos(longitude)
    out[1] = (normal + height) * math.cos(latitude) * math.sin(longitude)
    out[2] = (normal * (1.0 - ECCENTRICITY2) + height) * math.sin(latitude)
    return out


@njit(cache=True)
def _placed(nav: Array, P: Array, axes: Array, origin: Array) -> tuple[Array, Array, Array, Array]:
    turn = axes @ np.ascontiguousarray(level_axes(nav[0], nav[1]).T)
    position = axes @ (earth_centred(nav[0], nav[1], nav[2]) - origin)
    R_nb = turn @ rotation(nav)
    T = np.eye(9)
    T[:3, :3] = turn
    T[3:6, 3:6] = turn
    covariance = T @ np.ascontiguousarray(P[:9, :9]) @ np.ascontiguousarray(T.T)
    velocity = turn @ np.ascontiguousarray(nav[3:6])
    return position, quat_one(R_nb), velocity, covariance


class Placing:
    """Places and directions in the frame ``map`` of one datum."""

    def __init__(self, datum: Datum) -> None:
        self.datum = datum
        self._axes = level_axes(datum.latitude_rad, datum.longitude_rad)
        self._origin = earth_centred(*datum)

    def position(self, nav: Array) -> Array:
        """Return the position (3,) of a navigation state [m]."""
        place: Array = self._axes @ (earth_centred(nav[0], nav[1], nav[2]) - self._origin)
        return place

    def geodetic(self, position: Array) -> Array:
        """Return latitude, longitude [rad], height [m] (3,) of a position (3,) in ``map``."""
        place: Array = geodetic_from_enu(position, self.datum)[0]
        return place

    def rotation(self, nav: Array) -> Array:
        """Return the rotation (3, 3) from the state's own east, north, up to ``map``."""
        out: Array = self._axes @ level_axes(nav[0], nav[1]).T
        return out

    def place(self, nav: Array, P: Array) -> tuple[Array, Array, Array, Array]:
        """Return position (3,), quaternion (4,), velocity (3,) and covariance (9, 9) in ``map``."""
        placed: tuple[Array, Array, Array, Array] = _placed(nav, P, self._axes, self._origin)
        return placed

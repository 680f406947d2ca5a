"""WGS-84 coordinates to and from the local east-north-up frame of a datum."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pymap3d
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Datum(NamedTuple):
    """
    Where the frame ``map`` has its origin; x is east, y north and z up there.

    Attributes:
        latitude_rad: geodetic, WGS 84 [rad].
        longitude_rad: [rad].
        height_m: above the ellipsoid [m].
    """

    latitude_rad: float
    longitude_rad: float
    height_m: float


def enu_from_geodetic(lat: ArrayLike, lon: ArrayLike, h: ArrayLike, datum: Datum) -> Array:
    """
    Return positions (N, 3) in ``map`` [m] of latitudes, longitudes [rad] and heights [m].

    The frame is Cartesian: at a distance d the ground has fallen below its plane by d^2 / 2R.
    """
    lat, lon, h = (np.asarray(x, float) for x in (lat, lon, h))
    return _columns(pymap3d.geodetic2enu(lat, lon, h, *datum, deg=False))


def geodetic_from_enu(enu: ArrayLike, datum: Datum) -> Array:
    """Return latitude, longitude [rad] and height [m] (N, 3) of positions (N, 3) in ``map``."""
    east, north, up = np.atleast_2d(np.asarray(enu, float)).T
    return _columns(pymap3d.enu2geodetic(east, north, up, *datum, deg=False))


def _columns(values: tuple[ArrayLike, ArrayLike, ArrayLike]) -> Array:
    """Return three numbers or series as one array (N, 3)."""
    series = np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, float)) for x in values))
    return np.stack(series, axis=-1)

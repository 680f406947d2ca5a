"""
The Earth under an inertial navigator: WGS-84 figure, normal gravity, rotation; compiled.

Axes are east, north, up. Longitude is not defined at the poles, so nothing here is either.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEMI_MAJOR = 6378137.0
"""Equatorial radius of the ellipsoid [m] (WGS 84, as all that follows)."""
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
"""First eccentricity, squared."""
EARTH_RATE = 7.292115e-5
"""Angular rate of the Earth [rad/s]."""
GRAVITY_EQUATOR = 9.7803253359
"""Normal gravity on the ellipsoid at the equator [m/s^2]."""
SOMIGLIANA = 0.00193185265241
"""Somigliana's constant, b g_pole / (a g_equator) - 1."""
CENTRIFUGAL = 0.00344978650684
"""Ratio of the rotation's pull to gravity at the equator, w^2 a^2 b / GM."""


@numba.njit(cache=True)
def curvature_radii(lat: float) -> tuple[float, float]:
    """Return the radii (M, N) of curvature [m]: of the meridian and across it."""
    s = np.sin(lat)
    flat = 1.0 - ECCENTRICITY2 * s * s
    across = SEMI_MAJOR / np.sqrt(flat)
    return across * (1.0 - ECCENTRICITY2) / flat, across


@numba.njit(cache=True)
def gravity(lat: float, h: float) -> float:
    """
    Return normal gravity [m/s^2], positive down, at latitude [rad] and height [m].

    Somigliana's formula on the ellipsoid, to second order in height above it. Up there the plumb
    line leans towards the equator by 8e-9 h sin(2 lat) m/s^2: left out.
    """
    s2 = np.sin(lat) ** 2
    surface = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * s2) / np.sqrt(1.0 - ECCENTRICITY2 * s2)
    slope = 1.0 + FLATTENING + CENTRIFUGAL - 2.0 * FLATTENING * s2
    part = h / SEMI_MAJOR
    return surface * (1.0 - 2.0 * slope * part + 3.0 * part * part)


@numba.njit(cache=True)
def gravity_slope(lat: float, h: float) -> float:
    """Return how gravity changes with height [1/s^2]; negative."""
    s2 = np.sin(lat) ** 2
    surface = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * s2) / np.sqrt(1.0 - ECCENTRICITY2 * s2)
    slope = 1.0 + FLATTENING + CENTRIFUGAL - 2.0 * FLATTENING * s2
    return surface * (6.0 * h / SEMI_MAJOR - 2.0 * slope) / SEMI_MAJOR


@numba.njit(cache=True)
def earth_rate(lat: float, out: Array) -> None:
    """Write the Earth's rotation (3,) [rad/s] into ``out``."""
    out[0] = 0.0
    out[1] = EARTH_RATE * np.cos(lat)
    out[2] = EARTH_RATE * np.sin(lat)


@numba.njit(cache=True)
def transport_rate(nav: Array, out: Array) -> None:
    """Write how the local level frame turns because it travels (3,) [rad/s] into ``out``."""
    M, N = curvature_radii(nav[0])
    out[0] = -nav[4] / (M + nav[2])
    out[1] = nav[3] / (N + nav[2])
    out[2] = out[1] * np.tan(nav[0])

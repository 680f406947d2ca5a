"""References that the tests of inertial navigation share, none of them the project's own code."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

SEMI_MAJOR, SEMI_MINOR = 6378137.0, 6356752.314245
FOCAL = np.sqrt(SEMI_MAJOR**2 - SEMI_MINOR**2)
GM, RATE = 3.986004418e14, 7.292115e-5


def _normal_gravity(lat: float, h: float) -> float:
    """
    Return normal gravity along the ellipsoid's normal [m/s^2] from the exact closed potential.

    In ellipsoidal-harmonic coordinates (NIMA TR8350.2, chapter 4); no series in height.
    """
    across = SEMI_MAJOR**2 / np.hypot(SEMI_MAJOR * np.cos(lat), SEMI_MINOR * np.sin(lat))
    p = (across + h) * np.cos(lat)
    z = (across * (SEMI_MINOR / SEMI_MAJOR) ** 2 + h) * np.sin(lat)
    d = p * p + z * z - FOCAL**2
    u = np.sqrt(0.5 * d * (1.0 + np.sqrt(1.0 + 4.0 * (FOCAL * z / d) ** 2)))
    long = np.hypot(u, FOCAL)
    beta = np.arctan2(z * long, u * p)
    s, c = np.sin(beta), np.cos(beta)
    w = np.sqrt((u * u + (FOCAL * s) ** 2) / (u * u + FOCAL**2))

    def q(x: float) -> float:
        return 0.5 * ((1.0 + 3.0 * (x / FOCAL) ** 2) * np.arctan(FOCAL / x) - 3.0 * x / FOCAL)

    slope = 3.0 * (1.0 + (u / FOCAL) ** 2) * (1.0 - u / FOCAL * np.arctan(FOCAL / u)) - 1.0
    swing = (RATE * SEMI_MAJOR) ** 2
    ratio = slope / q(SEMI_MINOR)
    pull = GM + swing * FOCAL * ratio * (0.5 * s * s - 1.0 / 6.0)
    outward = (-pull / long**2 + RATE**2 * u * c * c) / w
    northward = s * c * (swing * q(u) / (q(SEMI_MINOR) * long) - RATE**2 * long) / w
    # From the confocal ellipsoid's axes to the normal of the one that latitude belongs to.
    out_p, out_z = u * c / (long * w), s / w
    north_p, north_z = -out_z, out_p
    g_p = outward * out_p + northward * north_p
    g_z = outward * out_z + northward * north_z
    return float(-(g_p * np.cos(lat) + g_z * np.sin(lat)))


@pytest.fixture(scope='session')
def normal_gravity() -> Callable[[float, float], float]:
    """Normal gravity [m/s^2] of latitude [rad] and height [m], positive down."""
    return _normal_gravity

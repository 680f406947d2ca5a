"""What the surveyed line tells the train's error state, compiled; see ``kernels``."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization.estimation.sequential import update
from train_localization.kernels import MAP, give

Array = NDArray[np.float64]


@njit(cache=True)
def line(
    nav: Array,
    aux: Array,
    P: Array,
    ahead: Array,
    left: Array,
    upward: Array,
    R: Array,
    course: float,
    gate: float,
) -> float:
    """
    Update with the surveyed line, in place; return the NIS across it, above ``gate`` unused.

    Args:
        nav: (10,) navigation state.
        aux: (14,) the other states.
        P: (23, 23) covariance.
        ahead: (3,) the line's nearest point as seen from the state [m].
        left: (3,) unit vector across the line, level.
        upward: (3,) unit vector across the line, upward.
        R: (2,) variances of the line's wander to the left and upward [m^2].
        course: variance of its direction [rad^2].
        gate: of the NIS.
    """
    n = P.shape[0]
    dx, h = np.zeros(n), np.zeros(n)
    speed = max(math.sqrt(nav[3] ** 2 + nav[4] ** 2 + nav[5] ** 2), 1.0)
    nis = 0.0
    for k in range(2):
        axis = left if k == 0 else upward
        h[:] = 0.0
        h[:3] = axis
        h[MAP + k] = -1.0
        nu = axis @ ahead + aux[MAP + k - 9]
        if k == 0:
            nis = nu * nu / (R[0] + h @ P @ h)
            if nis > gate:
                return nis
        update(P, h, R[k], nu, dx)
        h[:] = 0.0
        h[3:6] = axis
        update(P, h, course * speed * speed, -(axis @ nav[3:6]), dx)
    give(nav, aux, dx)
    return nis


@njit(cache=True)
def trust_map(nav: Array, aux: Array, P: Array, R: float, limit: float) -> bool:
    """Take the map's offset for small, variance ``R``, unless what is known speaks against it."""
    n = P.shape[0]
    dx, h = np.zeros(n), np.zeros(n)
    trusted = True
    for k in range(2):
        j = MAP + k
        if aux[j - 9] ** 2 > limit * (P[j, j] + R):
            trusted = False
            continue
        h[:] = 0.0
        h[j] = 1.0
        update(P, h, R, -aux[j - 9], dx)
    give(nav, aux, dx)
    return trusted

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
        aux: (18,) the other states.
        P: (27, 27) covariance.
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
def weigh_map(nav: Array, aux: Array, P: Array, wide: float, narrow: float, share: float) -> float:
    """
    Weigh a map that is not beside its line against one that is, in place; return how probable.

    The state takes the map's offset to the left for anything within a variance ``wide`` [m^2]. Of
    maps a ``share`` is within ``narrow`` [m^2], and what is known of this one's offset tells how
    probable that is. State and covariance become the moments of the two cases together. Of its
    height nothing is weighed: fixes know too little of heights to speak against it.
    """
    if not narrow < wide:
        return 0.0
    n = P.shape[0]
    # The narrow density over the wide one is that of measuring no offset, with variance R.
    R = 1.0 / (1.0 / narrow - 1.0 / wide)
    S, off = P[MAP, MAP] + R, aux[MAP - 9]
    odds = math.sqrt(wide / narrow * R / S) * math.exp(-0.5 * off * off / S)
    if not share * odds > 0.0:
        return 0.0
    right = share * odds / (share * odds + 1.0 - share)
    dx, h = np.zeros(n), np.zeros(n)
    told = P.copy()
    h[MAP] = 1.0
    update(told, h, R, -off, dx)
    for i in range(n):
        for j in range(n):
            mixed = right * told[i, j] + (1.0 - right) * P[i, j]
            P[i, j] = mixed + right * (1.0 - right) * dx[i] * dx[j]
    dx *= right
    give(nav, aux, dx)
    return right

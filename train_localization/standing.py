"""
Whether the IMU could be that of a train that stands.

An odometer that reads nothing does not yet prove it: its last reading may be a second old, and its
least step that of walking. A train that starts is felt at once, one that creeps has gained speed.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization.estimation.ins import earth_rate, gravity
from track_localization.estimation.sequential import innovation
from train_localization.kernels import rotation

Array = NDArray[np.float64]

QUIET_RADPS, QUIET_MPS2 = 4e-3, 0.06
"""What engines and passengers do to a standing IMU, a mean over 0.1 s, 1 sigma."""
STILL_SIGMA_MPS = 0.02
"""How well a train that stands is known to, 1 sigma [m/s]."""
QUIET_NIS = 9.0


@njit(cache=True)
def quiet(nav: Array, aux: Array, P: Array, rate: Array, force: Array) -> bool:
    """
    Return whether ``rate`` and ``force`` (3,) are the Earth's turning and gravity, and biases.

    And whether the velocity may be none: each axis by its innovation against its variance.
    """
    turning = np.empty(3)
    earth_rate(nav[0], turning)
    R_nb = rotation(nav)
    turned, up = R_nb.T @ turning, gravity(nav[0], nav[2]) * R_nb[2]
    lean = np.zeros((3, 3))
    lean[0, 1], lean[0, 2] = -up[2], up[1]
    lean[1, 0], lean[1, 2] = up[2], -up[0]
    lean[2, 0], lean[2, 1] = -up[1], up[0]
    n = P.shape[0]
    h, nothing = np.zeros(n), np.zeros(n)
    for k in range(3):
        if nav[3 + k] ** 2 > QUIET_NIS * (P[3 + k, 3 + k] + STILL_SIGMA_MPS**2):
            return False
        h[:] = 0.0
        h[9 + k] = 1.0
        nu, S = innovation(P, h, QUIET_RADPS**2, rate[k] - aux[k] - turned[k], nothing)
        if nu * nu > QUIET_NIS * S:
            return False
        h[:] = 0.0
        h[6:9] = lean[k]
        h[12 + k] = 1.0
        nu, S = innovation(P, h, QUIET_MPS2**2, force[k] - aux[3 + k] - up[k], nothing)
        if nu * nu > QUIET_NIS * S:
            return False
    return True

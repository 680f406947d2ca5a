"""Times in which the IMU is silent, and what a train may do in them unseen."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import so3
from train_localization import kernels

Array = NDArray[np.float64]

GAP_S = 0.25
"""An IMU that is silent for longer leaves something unseen [s]."""
GAP_MPS2, GAP_RADPS = 0.3, (0.014, 0.002, 0.011)
"""So much a train's pull and its roll, pitch and yaw rates walk in a second, 1 sigma."""
IMU_SILENT = 'imu_silent'
"""Why nothing is made of what was measured in such a time: where the train is then is not known."""


def unseen(P: Array, nav: Array, gap_s: float) -> None:
    """
    Add what happened while the IMU was silent, in place.

    Rates were heard before and after; what a walk between them may add to the line between them has
    the variance of an integrated Brownian bridge, T^3 / 12. Where the train turned its velocity
    turned with it: were it told apart from the heading, rails would turn the heading.
    """
    R, between = kernels.rotation(nav), math.sqrt(gap_s**3 / 12.0)
    G = np.zeros((9, 4))
    G[6:, :3] = np.diag(GAP_RADPS) * between
    G[3:6, :3] = -R @ so3.hat(R.T @ nav[3:6]) @ G[6:, :3]
    G[3:6, 3] = GAP_MPS2 * between * R[:, 0]
    G[:3] = 0.5 * gap_s * G[3:6]
    P[:9, :9] += G @ G.T

"""Times in which the IMU is silent, and what a train may do in them unseen."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import so3
from train_localization import kernels

Array = NDArray[np.float64]

LEAST_S, LATE_S, SAMPLES = 0.25, 0.15, 2.5
"""
A gap is at least so long, longer by so much than a step of the filter, behind which a late message
is taken, and as long as so many samples [s], [s], [].
"""
AGAIN_S = 4.0
"""After a longer one the filter begins anew [s]: too much is unseen for small corrections."""
GAP_MPS2, GAP_RADPS = 0.3, (0.014, 0.002, 0.011)
"""So much a train's pull and its roll, pitch and yaw rates walk in a second, 1 sigma."""
IMU_SILENT = 'imu_silent'
"""Why nothing is made of what was measured in a gap: where the train was then is not known."""


def shortest(epoch_s: float) -> float:
    """Return what time without samples is a gap [s], before anything was heard of their rate."""
    return max(LEAST_S, epoch_s + LATE_S)


def adapted(gap_s: float, epoch_s: float, stamps: Array, time_s: float) -> float:
    """
    Return what time without samples is a gap [s], after new samples.

    Args:
        gap_s: the same before them [s].
        epoch_s: of a filter's step [s].
        stamps: (m,) of new samples [s].
        time_s: of the sample before them [s].
    """
    usual = SAMPLES * (float(stamps[-1]) - time_s) / len(stamps)
    slower = gap_s + 0.1 * (min(usual, 2.0 * gap_s) - gap_s)
    return max(slower, shortest(epoch_s))


def unseen(P: Array, nav: Array, gap_s: float) -> None:
    """
    Add to P what happened while the IMU was silent for ``gap_s``, in place.

    Rates were heard before and after; what a walk between them may add to the line between them has
    the variance of an integrated Brownian bridge, T^3 / 12. Where the train turned, its velocity
    turned with it: uncorrelated, a speed across the rails would later be undone by a false turn.

    Args:
        P: (n, n) covariance, n >= 9, after the gap.
        nav: (10,) navigation state, after it.
        gap_s: how long the IMU was silent [s].
    """
    R, between = kernels.rotation(nav), math.sqrt(gap_s**3 / 12.0)
    G = np.zeros((9, 4))
    G[6:, :3] = np.diag(GAP_RADPS) * between
    G[3:6, :3] = -R @ so3.hat(R.T @ nav[3:6]) @ G[6:, :3]
    G[3:6, 3] = GAP_MPS2 * between * R[:, 0]
    G[:3] = 0.5 * gap_s * G[3:6]
    P[:9, :9] += G @ G.T

"""An estimate carried on in time: constant acceleration, changed by white jerk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_localization.estimate import Estimate

Array = NDArray[np.float64]


def transition(T: float) -> Array:
    """Return F (3, 3), which carries [p, v, a] on by ``T`` [s]: the discrete form of eq. (2)."""
    return np.array([[1.0, T, 0.5 * T * T], [0.0, 1.0, T], [0.0, 0.0, 1.0]])


def process_noise(T: float, jerk_density: float) -> Array:
    """Return Q (3, 3) of ``T`` [s] of white jerk of a spectral density [m^2/s^5]."""
    return jerk_density * np.array(
        [
            [T**5 / 20.0, T**4 / 8.0, T**3 / 6.0],
            [T**4 / 8.0, T**3 / 3.0, T**2 / 2.0],
            [T**3 / 6.0, T**2 / 2.0, T],
        ]
    )


def predicted(estimate: Estimate, time_s: float, jerk_density: float) -> Estimate:
    """Return what ``estimate`` says of a later time [s]; its covariance has grown accordingly."""
    T = time_s - estimate.time_s
    F = transition(T)
    P = F @ estimate.covariance @ F.T + process_noise(T, jerk_density)
    return Estimate(time_s, F @ estimate.mean, P)

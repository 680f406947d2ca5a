"""What is given out while several hypotheses are possible: the heaviest, with an honest doubt."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import line_state

Array = NDArray[np.float64]

DOUBT = 0.1
"""Probability of being lost above which the covariance is opened."""
WIDER = 0.3
"""Of a few places that look alike less is known than it seems: the power of the weights that open
the covariance."""


def mixture(X: Array, P: Array, log_weight: Array) -> tuple[int, Array]:
    """
    Return the heaviest of hypotheses (H, 30), (H, 18, 18) and its covariance, opened to the others.

    Chainage and speed are opened, about the heaviest hypothesis itself.
    """
    h = int(np.argmax(log_weight))
    weight = np.exp(WIDER * (log_weight - log_weight[h]))
    weight /= weight.sum()
    out = P[h].copy()
    for k in (0, 1):
        out[k, k] += float(weight @ (X[:, k] - X[h, k]) ** 2)
    return h, out


def opened(P: Array, lost: float, length: float) -> Array:
    """Return ``P`` (18, 18) as it is where a vehicle is ``lost``, to be anywhere on its line."""
    if lost <= DOUBT:
        return P
    out = P.copy()
    out[0, 0] += lost * length**2 / 12.0
    return out


def figures(x: Array, P: Array, nis: Array, lost: float, count: int) -> dict[str, float | str]:
    """Return what a health report tells of the heaviest of ``count`` hypotheses."""
    status = 'running' if count == 1 else 'place in doubt'
    mount = P[line_state.MOUNT : line_state.MOUNT + 3, line_state.MOUNT : line_state.MOUNT + 3]
    return {
        'status': 'lost' if lost > 0.5 else status,
        'lost_probability': lost,
        'hypotheses': float(count),
        'chainage_m': float(x[0]),
        'chainage_sigma_m': math.sqrt(P[0, 0]),
        'speed_mps': float(x[1]),
        'mount_sigma_deg': float(np.rad2deg(math.sqrt(np.trace(mount) / 3.0))),
        'attitude_nis': float(nis.mean()),
    }

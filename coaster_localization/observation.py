"""The match as a position observation with a long thin covariance along the track (eq. 21)."""

from __future__ import annotations

import dataclasses

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.cholesky import lower_root

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class MatchObservation:
    """
    Where the matcher says that the seat was at ``time_s``.

    Attributes:
        time_s: stamp of the measured sample that was matched [s]; it lies in the past.
        position: (3,) on the design line, in ``map`` [m].
        quaternion: (4,) x, y, z, w: design attitude there, body to map.
        covariance: (3, 3) of the position [m^2]; its long axis is the track's tangent.
        chainage: along the track [m]; NaN where the source did not say.
    """

    time_s: float
    position: Array
    quaternion: Array
    covariance: Array
    chainage: float = float('nan')


def observation_covariance(
    R_nb: Array, lambda_x: float | Array, lambda_y: float | Array, lambda_z: float | Array
) -> Array:
    """
    Return V = R diag(lx, ly, lz) R' (paper 1, eq. 21), shape (..., 3, 3) [m^2].

    ``R_nb`` (..., 3, 3) holds the vehicle's forward, left and up axes in ``map`` as columns; the
    lambdas are variances along them.
    """
    lambdas = np.stack(np.broadcast_arrays(lambda_x, lambda_y, lambda_z), axis=-1)
    V: Array = (R_nb * lambdas[..., None, :]) @ np.swapaxes(R_nb, -1, -2)
    return V


def problem(match: MatchObservation) -> str | None:
    """Return why a match cannot be fused, or None: the reasons are those of the diagnostics."""
    if not np.isfinite(match.time_s):
        return 'not_finite'
    return PROBLEMS[_problem(match.position, match.covariance)]


PROBLEMS = (None, 'not_finite', 'covariance_not_symmetric', 'covariance_not_positive')


@numba.njit(cache=True)
def _problem(position: Array, V: Array) -> int:
    """Return the place in PROBLEMS of what is wrong."""
    if not (np.isfinite(position).all() and np.isfinite(V).all()):
        return 1
    if np.abs(V - V.T).max() > 1e-6 * max(1.0, np.abs(V).max()):
        return 2
    return 0 if lower_root(V)[1] else 3

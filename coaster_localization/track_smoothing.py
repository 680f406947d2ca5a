"""Smoothing of the track filter: over a whole ride, or the last seconds of it."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_filter import CoasterTrackFilter, Epoch
from track_localization.estimation import line_filter as kernel

Array = NDArray[np.float64]


def smooth_epochs(epochs: Sequence[Epoch]) -> tuple[Array, Array]:
    """
    Return smoothed nominal states (N, 30) and covariances (N, 18, 18) of successive epochs.

    Rauch-Tung-Striebel, from the last epoch's own estimate back.
    """
    n = len(epochs)
    x = np.array([e.x for e in epochs]).reshape(n, kernel.NOMINAL)
    P = np.array([e.P for e in epochs]).reshape(n, kernel.ERRORS, kernel.ERRORS)
    for k in range(n - 2, -1, -1):
        after = epochs[k + 1]
        _backward(x[k], P[k], after.x_before, after.P_before, after.F, x[k + 1], P[k + 1])
    return x, P


@numba.njit(cache=True)
def _backward(
    x: Array, P: Array, x_before: Array, P_before: Array, F: Array, x_next: Array, P_next: Array
) -> None:
    """Smooth one epoch in place: ``x``, ``P`` are the filter's, ``*_next`` the smoothed."""
    d = 1.0 / np.sqrt(np.diag(P_before))
    scaled = P_before * np.outer(d, d)
    FP = F @ P
    for i in range(len(d)):
        FP[i] *= d[i]
    G = np.ascontiguousarray(np.linalg.solve(scaled, FP).T)
    for i in range(len(d)):
        G[:, i] *= d[i]
    new = P + G @ (P_next - P_before) @ np.ascontiguousarray(G.T)
    P[:, :] = 0.5 * (new + new.T)
    kernel.add_error(x, G @ kernel.difference(x_next, x_before))


def smooth(filter_: CoasterTrackFilter) -> tuple[Array, Array, Array]:
    """Return stamps (N,), states (N, 30) and covariances (N, 18, 18) at the filter's epochs."""
    x, P = smooth_epochs(filter_.epochs)
    return np.array([e.time_s for e in filter_.epochs]), x, P

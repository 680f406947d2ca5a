"""
Rauch-Tung-Striebel smoothing over the steps of any error-state filter.

The forward pass gives, per step, the state after its updates; the backward pass needs the
prediction from it to the next step. Nominal states are compared and corrected by the filter's own
``box_minus`` and ``box_plus``, so the smoother knows nothing of what the numbers mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.cholesky import LEAST_PIVOT

Array = NDArray[np.float64]


def rts_smooth(
    x: Sequence[Array],
    P: Sequence[Array],
    predict: Callable[[int], tuple[Array, Array, Array]],
    box_minus: Callable[[Array, Array], Array],
    box_plus: Callable[[Array, Array], Array],
) -> tuple[list[Array], list[Array]]:
    """
    Return smoothed nominal states and covariances at every epoch.

    ``x[k]``, ``P[k]`` are the filter's after epoch k; ``predict(k)`` gives the nominal state, the
    covariance and the error transition F from epoch k to k + 1, before that epoch's updates
    (recomputed on demand: cheaper to repeat than to keep).
    """
    n = len(x)
    x_s, P_s = list(x), list(P)
    for k in range(n - 2, -1, -1):
        x_pred, P_pred, F = predict(k)
        error = box_minus(x_s[k + 1], x_pred)
        correction, P_s[k] = _backward(P[k], P_pred, F, P_s[k + 1], error)
        x_s[k] = box_plus(x[k], correction)
    return x_s, P_s


@numba.njit(cache=True)
def _backward(
    P: Array, P_pred: Array, F: Array, P_next: Array, error: Array
) -> tuple[Array, Array]:
    G = gain(P, P_pred, F)
    P_new = P + G @ (P_next - P_pred) @ np.ascontiguousarray(G.T)
    return G @ error, 0.5 * (P_new + P_new.T)


@numba.njit(cache=True)
def gain(P: Array, P_pred: Array, F: Array) -> Array:
    """
    Return the smoother's gain (n, n), P F' P_pred^-1.

    Scaled by its diagonal P_pred is well conditioned whatever the units of its states; a state
    that is known for certain stays out.
    """
    d = np.diag(P_pred).copy()
    for i in range(len(d)):
        d[i] = 1.0 / np.sqrt(d[i]) if d[i] > 1e-30 else 0.0
    scaled = P_pred * np.outer(d, d)
    FP = F @ P
    for i in range(len(d)):
        if d[i] == 0.0:
            scaled[i, i] = 1.0
        FP[i] *= d[i]
    turned = FP.copy()
    if not eliminated(scaled.copy(), turned):
        turned[:, :] = np.linalg.solve(scaled, FP)
    G = np.ascontiguousarray(turned.T)
    for i in range(len(d)):
        G[:, i] *= d[i]
    return G


@numba.njit(cache=True)
def eliminated(A: Array, B: Array) -> bool:
    """
    Put A^-1 B in the place of ``B`` (n, m); return whether ``A`` (n, n) allows it.

    ``A``, overwritten, is symmetric, its diagonal about 1. What is positive definite needs no
    pivots: Gauss's own elimination, by whole rows, is several times as fast as a general solver.
    """
    n, m = B.shape
    for k in range(n):
        if not A[k, k] > LEAST_PIVOT:
            return False
        for i in range(k + 1, n):
            share = A[k, i] / A[k, k]
            for c in range(i, n):
                A[i, c] -= share * A[k, c]
            for c in range(m):
                B[i, c] -= share * B[k, c]
    for k in range(n - 1, -1, -1):
        for i in range(k + 1, n):
            share = A[k, i]
            for c in range(m):
                B[k, c] -= share * B[i, c]
        for c in range(m):
            B[k, c] /= A[k, k]
    return True

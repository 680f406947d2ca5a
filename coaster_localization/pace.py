"""
Evening out a match by the train's pace.

A warping path is a staircase, and where the series say nothing (a straight lift) it puts all of a
ride's delay into one place. Real rides differ from the design by a pace that changes slowly. The
smoothest delay that the match allows is the minimum of

    sum w_i (x_i - z_i)^2 + sum k_i (x_(i-1) - 2 x_i + x_(i+1))^2

with z the match's delay (design time minus recording time), w its information and k that of the
pace's random walk: a fixed-interval smoother, solved as one band matrix, with its variances.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def even_pace(
    delay: Array, sigma: Array, walk: Array, dt: float, correlation_s: Array
) -> tuple[Array, Array]:
    """
    Return the smoothed delay (N,) [s] and its standard deviation (N,) [s].

    ``sigma`` (N,) [s] is the match's own, its errors last ``correlation_s`` (N,); ``walk`` (N,)
    [1/sqrt(s)] is how fast the pace may wander. Fewer than three samples come back unchanged.
    """
    if len(delay) < 3:
        return delay, sigma
    weight = np.minimum(1.0, dt / correlation_s) / sigma**2
    stiffness = 1.0 / (walk[1:-1] ** 2 * dt**3)
    start = float(delay[0])
    smooth, variance = _solve(weight, stiffness, weight * (delay - start))
    return smooth + start, np.sqrt(variance)


@numba.njit(cache=True)
def _solve(weight: Array, stiffness: Array, right: Array) -> tuple[Array, Array]:
    """Solve the five-band normal equations by L D L'; return x and the inverse's diagonal."""
    n = len(weight)
    diagonal, first, second = weight.copy(), np.zeros(n), np.zeros(n)
    for i in range(n - 2):
        k = stiffness[i]
        diagonal[i] += k
        diagonal[i + 1] += 4.0 * k
        diagonal[i + 2] += k
        first[i] -= 2.0 * k
        first[i + 1] -= 2.0 * k
        second[i] += k
    x = right.copy()
    for i in range(n):
        d = diagonal[i]
        if i + 1 < n:
            factor = first[i] / d
            diagonal[i + 1] -= factor * first[i]
            if i + 2 < n:
                first[i + 1] -= factor * second[i]
            x[i + 1] -= factor * x[i]
            first[i] = factor
        if i + 2 < n:
            factor = second[i] / d
            diagonal[i + 2] -= factor * second[i]
            x[i + 2] -= factor * x[i]
            second[i] = factor
    near, variance = 0.0, np.zeros(n)
    for i in range(n - 1, -1, -1):
        x[i] /= diagonal[i]
        variance[i] = 1.0 / diagonal[i]
        if i + 1 < n:
            l1, l2 = first[i], second[i]
            v1 = variance[i + 1]
            v2 = variance[i + 2] if i + 2 < n else 0.0
            x[i] -= l1 * x[i + 1] + (l2 * x[i + 2] if i + 2 < n else 0.0)
            variance[i] += l1 * l1 * v1 + 2.0 * l1 * l2 * near + l2 * l2 * v2
            near = -l1 * v1 - l2 * near
    return x, variance

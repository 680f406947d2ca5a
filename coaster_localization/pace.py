"""
Evening out a match by the train's pace.

A warping path is a staircase, and where the series say nothing (a straight lift) it puts all of a
ride's delay into one place. Real rides differ from the design by a pace that changes slowly. So
the match's delay (design time minus recording time) is smoothed with the model

    delay' = pace,  pace' = white noise,

forward by a Kalman filter and back by Rauch, Tung and Striebel's recursion.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FIRST_PACE = 0.3
"""Standard deviation of the pace, against the design's, where the match begins."""


def even_pace(
    delay: Array, sigma: Array, walk: Array, dt: float, correlation_s: Array
) -> tuple[Array, Array]:
    """
    Return the smoothed delay (N,) [s] and its standard deviation (N,) [s].

    ``sigma`` (N,) [s] is the match's own, its errors last ``correlation_s`` (N,); ``walk`` (N,)
    [1/sqrt(s)] is how fast the pace may wander.
    """
    noise = sigma**2 * np.maximum(1.0, correlation_s / dt)
    smooth, variance = _smooth(delay, noise, walk**2 * dt, dt)
    return smooth, np.sqrt(variance)


@numba.njit(cache=True)
def _smooth(z: Array, R: Array, Q: Array, dt: float) -> tuple[Array, Array]:
    """Return the smoothed first state (N,) and its variance; P = (a, b; b, c) at each row."""
    n = len(z)
    x, a, b, c = np.empty((n, 2)), np.empty(n), np.empty(n), np.empty(n)
    x[0], a[0], b[0], c[0] = (z[0], 0.0), R[0], 0.0, FIRST_PACE**2
    predicted = np.empty((n, 5))
    for k in range(1, n):
        x0, x1 = x[k - 1, 0] + dt * x[k - 1, 1], x[k - 1, 1]
        p00 = a[k - 1] + dt * (2.0 * b[k - 1] + dt * c[k - 1])
        p01, p11 = b[k - 1] + dt * c[k - 1], c[k - 1] + Q[k]
        predicted[k] = x0, x1, p00, p01, p11
        keep = R[k] / (p00 + R[k])
        gain0, gain1 = p00 / (p00 + R[k]), p01 / (p00 + R[k])
        x[k, 0], x[k, 1] = x0 + gain0 * (z[k] - x0), x1 + gain1 * (z[k] - x0)
        a[k], b[k], c[k] = keep * p00, keep * p01, p11 - gain1 * p01
    for k in range(n - 2, -1, -1):
        x0, x1, p00, p01, p11 = predicted[k + 1]
        det = p00 * p11 - p01 * p01
        u0, u1 = a[k] + dt * b[k], b[k] + dt * c[k]
        g00, g01 = (u0 * p11 - b[k] * p01) / det, (b[k] * p00 - u0 * p01) / det
        g10, g11 = (u1 * p11 - c[k] * p01) / det, (c[k] * p00 - u1 * p01) / det
        e0, e1 = x[k + 1, 0] - x0, x[k + 1, 1] - x1
        d00, d01, d11 = a[k + 1] - p00, b[k + 1] - p01, c[k + 1] - p11
        x[k, 0] += g00 * e0 + g01 * e1
        x[k, 1] += g10 * e0 + g11 * e1
        h00, h01 = g00 * d00 + g01 * d01, g00 * d01 + g01 * d11
        h10, h11 = g10 * d00 + g11 * d01, g10 * d01 + g11 * d11
        a[k] += h00 * g00 + h01 * g01
        b[k] += h00 * g10 + h01 * g11
        c[k] += h10 * g10 + h11 * g11
    return x[:, 0].copy(), a

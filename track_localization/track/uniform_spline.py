"""
Cubic splines on a uniform grid: constant-time look-up, exact derivatives.

Positions and quaternions along a line are tabled here. Because the first and second derivatives
are those of the very same polynomial, motion computed from them integrates back to the line.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]


class UniformSpline:
    """
    Cubic spline of K columns over ``[0, length]``.

    Args:
        values: (N, K) samples at ``linspace(0, length, N)``.
        length: end of the range, in the argument's unit.
        closed: the argument wraps at ``length``. ``values`` then still holds both ends; they may
            differ by a constant (quaternions after an odd number of rolls change sign).
        slopes: (2, K) first derivatives at both ends; needed when ``closed``.

    Outside ``[0, length]`` an open spline goes on along its end's slope.
    """

    def __init__(
        self, values: Array, length: float, closed: bool = False, slopes: Array | None = None
    ) -> None:
        values = np.ascontiguousarray(values, dtype=np.float64)
        self.length, self.closed = float(length), closed
        self.step = self.length / (len(values) - 1)
        grid = np.linspace(0.0, self.length, len(values))
        ends = 'not-a-knot' if slopes is None else ((1, slopes[0]), (1, slopes[1]))
        coefficients = CubicSpline(grid, values, bc_type=ends).c
        self.coefficients = np.ascontiguousarray(np.moveaxis(coefficients, 0, -1))
        self.grid = grid

    def __call__(self, s: float | Array, derivative: int = 0) -> Array:
        """Return the ``derivative``-th derivative (0, 1 or 2) at ``s`` (...,), shape (..., K)."""
        where = np.asarray(s, dtype=np.float64)
        flat = np.ascontiguousarray(where.reshape(-1))
        out = evaluate(self.coefficients, self.step, self.closed, flat, derivative)
        return out.reshape(*where.shape, self.coefficients.shape[1])


@njit(cache=True)
def evaluate(c: Array, step: float, closed: bool, s: Array, derivative: int) -> Array:
    """Return spline values (M, K) from coefficients (N - 1, K, 4), highest power first."""
    count, columns = c.shape[0], c.shape[1]
    length = count * step
    out = np.empty((len(s), columns))
    for j in range(len(s)):
        x = s[j]
        if closed:
            x -= np.floor(x / length) * length
        inside = min(max(x, 0.0), length)
        over = x - inside
        i = min(int(inside / step), count - 1)
        u = inside - i * step
        for k in range(columns):
            a, b, d, e = c[i, k, 0], c[i, k, 1], c[i, k, 2], c[i, k, 3]
            slope = (3.0 * a * u + 2.0 * b) * u + d
            if derivative == 0:
                out[j, k] = ((a * u + b) * u + d) * u + e + slope * over
            elif derivative == 1:
                out[j, k] = slope
            else:
                out[j, k] = 6.0 * a * u + 2.0 * b if over == 0.0 else 0.0
    return out

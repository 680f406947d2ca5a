"""What the rows of a line say at a chainage: attitude, acceleration, usual speed; see LineMap."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.so3 import exp_one

Array = NDArray[np.float64]

# Columns of a row of the line, see LineMap.
TURNING, TANGENT, STRETCH, LEVER, CLIMB = 9, 12, 15, 16, 17
SPEED, SPEED_SIGMA, SIGMA, RENEWAL = 18, 19, 20, 21
BACK = 22
SQRT3 = np.sqrt(3.0)
SLOWEST = 0.5
"""Below this no speed is usual: the vehicle stops, starts or waits [m/s]."""
ROLLBACK = -0.5
"""A vehicle slower than this runs backward [m/s]."""


@numba.njit(cache=True)
def row_of(rows: Array, step: float, closed: bool, s: float) -> tuple[int, float]:
    """Return the row below ``s`` and the share of the next one; ends hold on open lines."""
    last = len(rows) - 1
    at = s / step
    if closed:
        at -= last * np.floor(at / last)
    at = min(max(at, 0.0), float(last))
    i = min(int(at), last - 1)
    return i, at - i


@numba.njit(cache=True)
def attitude_at(rows: Array, step: float, closed: bool, s: float) -> Array:
    """Return the body's attitude (3, 3) at chainage ``s``."""
    i, share = row_of(rows, step, closed, s)
    R = rows[i, 0:9].copy().reshape((3, 3))
    return R @ exp_one(rows[i, TURNING : TURNING + 3] * (share * step))


@numba.njit(cache=True)
def acceleration(
    rows: Array, step: float, closed: bool, s: float, v: float, f0: float, f1: float, f2: float
) -> float:
    """Return s'' [m/s^2] under the specific force (f0, f1, f2) in body axes."""
    i, share = row_of(rows, step, closed, s)
    a, b = rows[i], rows[i + 1]
    rest = 1.0 - share
    along = (rest * a[TANGENT] + share * b[TANGENT]) * f0
    along += (rest * a[TANGENT + 1] + share * b[TANGENT + 1]) * f1
    along += (rest * a[TANGENT + 2] + share * b[TANGENT + 2]) * f2
    along -= rest * a[CLIMB] + share * b[CLIMB]
    if closed or 0.0 <= s <= (len(rows) - 1) * step:
        # Beyond the ends of an open line it goes on straight.
        along -= (rest * a[LEVER] + share * b[LEVER]) * v * v
    return along / (rest * a[STRETCH] + share * b[STRETCH])


@numba.njit(cache=True)
def usual_speed(
    rows: Array, step: float, closed: bool, s: float, v: float, sigma: float
) -> tuple[float, float, float]:
    """
    Return the usual speed at ``s`` [m/s], its slope [1/s] and spread; NaN where not known.

    That of running backward, which is negative, where ``v`` says that the vehicle does.
    """
    column = SPEED if v > ROLLBACK else BACK
    i, share = row_of(rows, step, closed, s)
    usual = (1.0 - share) * rows[i, column] + share * rows[i + 1, column]
    reach = min(max(SQRT3 * sigma, 0.5), 10.0)
    j, _ = row_of(rows, step, closed, s + reach)
    k, _ = row_of(rows, step, closed, s - reach)
    return usual, (rows[j, column] - rows[k, column]) / (2.0 * reach), rows[i, column + 1]


@numba.njit(cache=True)
def usual_slopes(
    rows: Array, step: float, closed: bool, s: float, v: float, sigma: float
) -> tuple[float, float]:
    """
    Return the usual speed's lesser and greater slope behind and ahead of ``s`` [1/s].

    Each side to the reach of ``usual_speed``: where the speed has a corner they differ.
    """
    column = SPEED if v > ROLLBACK else BACK
    reach = min(max(SQRT3 * sigma, 0.5), 10.0)
    i, share = row_of(rows, step, closed, s)
    j, _ = row_of(rows, step, closed, s + reach)
    k, _ = row_of(rows, step, closed, s - reach)
    usual = (1.0 - share) * rows[i, column] + share * rows[i + 1, column]
    ahead = (rows[j, column] - usual) / reach
    behind = (usual - rows[k, column]) / reach
    return min(ahead, behind), max(ahead, behind)

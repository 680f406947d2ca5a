"""
Measurements of the line filter: the line's attitude, the usual speed, a standstill.

See ``line_state`` for the state. Everything is compiled and changes ``x`` and ``P`` in place.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.estimation.line_rows import (
    SIGMA,
    SLOWEST,
    SQRT3,
    TURNING,
    attitude_at,
    row_of,
    usual_speed,
)
from track_localization.estimation.line_state import (
    ACCEL_BIAS,
    ERRORS,
    GYRO_BIAS,
    MOUNT,
    PACE,
    TILT,
    X_ACCEL_BIAS,
    X_GYRO_BIAS,
    X_PACE,
    S,
    V,
    correct,
    times,
)
from track_localization.estimation.so3 import (
    log_one,
)

Array = NDArray[np.float64]


@numba.njit(cache=True)
def residual(x: Array, s: float, rows: Array, step: float, closed: bool) -> Array:
    """Return the rotation vector (3,) from the line's attitude at ``s`` to the body's own."""
    C = x[2:11].copy().reshape((3, 3))
    M = x[11:20].copy().reshape((3, 3))
    R = attitude_at(rows, step, closed, s)
    return log_one(np.ascontiguousarray(R.T) @ C @ np.ascontiguousarray(M.T))


@numba.njit(cache=True)
def log_slope(r: Array) -> Array:
    """Return how log(exp(d) exp(r)) grows with d (3, 3), to the first order in ``r`` (3,)."""
    return np.array(
        [
            [1.0, 0.5 * r[2], -0.5 * r[1]],
            [-0.5 * r[2], 1.0, 0.5 * r[0]],
            [0.5 * r[1], -0.5 * r[0], 1.0],
        ]
    )


@numba.njit(cache=True)
def match_attitude(
    x: Array,
    P: Array,
    T: float,
    rows: Array,
    step: float,
    closed: bool,
    settings: Array,
    nis: Array,
) -> float:
    """
    Fuse the comparison of the body's attitude with the line's; return its log likelihood.

    ``settings`` (4,): correlation length of the line's errors [m], soft gate, sigma_s above which
    the line is linearised statistically [m], most that it looks ahead [m]. ``nis`` (3,) takes the
    squared innovation of each axis over its variance, errors that last not counted again.
    """
    s = x[0]
    i, _ = row_of(rows, step, closed, s)
    sigma = np.sqrt(P[0, 0])
    r = residual(x, s, rows, step, closed)
    slope = -(log_slope(r) @ rows[i, TURNING : TURNING + 3])
    moved = max(abs(x[1]) * T, 1e-4)
    spread, lasts = np.zeros(3), 1.0
    if sigma > settings[2]:
        # Three points carry the line's bends into the innovation (a statistical linearisation).
        # What they leave unexplained stays the same until the vehicle has moved as far.
        ahead = min(SQRT3 * sigma, settings[3])
        far = ahead / SQRT3
        plus = residual(x, s + ahead, rows, step, closed)
        minus = residual(x, s - ahead, rows, step, closed)
        mean = (4.0 * r + plus + minus) / 6.0
        slope = (plus - minus) / (2.0 * ahead)
        for j in range(3):
            square = (4.0 * (r[j] - mean[j]) ** 2) / 6.0
            square += ((plus[j] - mean[j]) ** 2 + (minus[j] - mean[j]) ** 2) / 6.0
            spread[j] = max(square - (slope[j] * far) ** 2, 0.0)
        lasts = max(1.0, far / moved)
        r = mean
    H = np.zeros((3, ERRORS))
    R = np.ascontiguousarray(attitude_at(rows, step, closed, s).T)
    half = log_slope(r)
    H[:, TILT : TILT + 3] = half @ R
    H[:, MOUNT : MOUNT + 3] = -np.ascontiguousarray(half.T)
    for j in range(3):
        H[j, S] = slope[j]
    variance = rows[i, SIGMA] ** 2 * max(1.0, settings[0] / moved)
    noise = np.empty(3)
    likelihood = 0.0
    for j in range(3):
        noise[j] = variance + lasts * spread[j]
        own = np.dot(H[j], times(P, H[j])) + noise[j]
        ratio = r[j] * r[j] / own
        spot = own - noise[j] + spread[j] + rows[i, SIGMA] ** 2
        nis[j] = r[j] * r[j] / spot
        likelihood -= 0.5 * (min(r[j] * r[j] / spot, 40.0) + np.log(spot))
        if ratio > settings[1]:
            noise[j] += own * (ratio / settings[1] - 1.0)
    correct(x, P, -r, H, noise)
    return likelihood


@numba.njit(cache=True)
def match_speed(
    x: Array, P: Array, T: float, rows: Array, step: float, closed: bool, settings: Array
) -> float:
    """
    Fuse the usual speed at this chainage times 1 + pace, if there is one; return the NIS.

    A vehicle that stands is not usual: its speed is left alone where even two sigmas more would
    be slow.

    ``settings`` (2,): what pace leaves unexplained, a share, and the distance over which that
    persists [m]. The row's own standard deviation comes on top.
    """
    usual, slope, spread = usual_speed(rows, step, closed, x[0], x[1], np.sqrt(P[0, 0]))
    fastest = abs(x[1]) + 2.0 * np.sqrt(P[V, V])
    if not (min(abs(usual), fastest) > SLOWEST and np.isfinite(slope + spread)):
        return 0.0
    pace = 1.0 + x[X_PACE]
    H = np.zeros((1, ERRORS))
    H[0, S], H[0, V], H[0, PACE] = -slope * pace, 1.0, -usual
    nu = np.array([usual * pace - x[1]])
    variance = spread**2 + (settings[0] * usual) ** 2
    moved = max(abs(x[1]), SLOWEST) * T
    R = np.array([variance * max(1.0, settings[1] / moved)])
    own = np.dot(H[0], times(P, H[0])) + R[0]
    ratio = nu[0] ** 2 / own
    if ratio > 9.0:
        R[0] += own * (ratio / 9.0 - 1.0)
    correct(x, P, nu, H, R)
    return ratio


@numba.njit(cache=True)
def hold(x: Array, P: Array, sigma: float) -> None:
    """Fuse a standstill: ds/dt is zero within ``sigma`` [m/s]."""
    H = np.zeros((1, ERRORS))
    H[0, V] = 1.0
    correct(x, P, np.array([-x[1]]), H, np.array([sigma * sigma]))


@numba.njit(cache=True)
def level(x: Array, P: Array, force: Array, sigma: float) -> None:
    """Fuse the mean specific force (3,) of a standstill: gravity and the bias."""
    C = x[2:11].copy().reshape((3, 3))
    Ct = np.ascontiguousarray(C.T)
    up = np.array([0.0, 0.0, GRAVITY])
    nu = force - Ct @ up - x[X_ACCEL_BIAS : X_ACCEL_BIAS + 3]
    # C' exp(-tilt) up = C' up + C' [up]x tilt
    skew = np.array([[0.0, -GRAVITY, 0.0], [GRAVITY, 0.0, 0.0], [0.0, 0.0, 0.0]])
    H = np.zeros((3, ERRORS))
    H[:, TILT : TILT + 3] = Ct @ skew
    for j in range(3):
        H[j, ACCEL_BIAS + j] = 1.0
    correct(x, P, nu, H, np.full(3, sigma * sigma))


@numba.njit(cache=True)
def still_gyro(x: Array, P: Array, rate: Array, sigma: float) -> None:
    """Fuse the mean angular rate (3,) of a standstill: the gyro's bias."""
    H = np.zeros((3, ERRORS))
    nu = np.empty(3)
    for j in range(3):
        H[j, GYRO_BIAS + j] = 1.0
        nu[j] = rate[j] - x[X_GYRO_BIAS + j]
    correct(x, P, nu, H, np.full(3, sigma * sigma))

"""
Prediction of the line filter: the IMU moves the vehicle on its line, and the pace follows drives.

See ``line_state`` for the state. Everything is compiled and changes ``x`` and ``P`` in place.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.estimation.line_rows import (
    CLIMB,
    LEVER,
    RENEWAL,
    SIGMA,
    SLOWEST,
    SQRT3,
    STRETCH,
    TANGENT,
    acceleration,
    row_of,
    usual_slopes,
    usual_speed,
)
from track_localization.estimation.line_state import (
    ACCEL_BIAS,
    ERRORS,
    GYRO_BIAS,
    GYRO_SCALE,
    MOUNT,
    PACE,
    TILT,
    X_ACCEL_BIAS,
    X_GYRO_BIAS,
    X_GYRO_SCALE,
    X_PACE,
    S,
    V,
)
from track_localization.estimation.so3 import (
    exp_one,
    normalised_one,
)

Array = NDArray[np.float64]

SUM_TIME, SUM_FORCE, SUM_TURN, SUM_SCALED, SUMS = 0, 1, 4, 13, 22
"""What is summed between two epochs: time, force (3), C dt (9), C diag(w) dt (9)."""

DRIVEN_ACCEL, DRIVEN_S = 0.25, 0.5
"""An unusual drive or brake is at least this strong [m/s^2], over this time [s]."""
DRIVE_S = 1.0
"""How long the force of a drive or brake keeps its strength [s]."""
SLOPE_SHARE = 0.5
"""How far the built line's slope is off, of how far a match of its attitude is: half of that is
the sensor's and the seat's."""
STOPPED = 0.3
"""A vehicle slower than this has stopped [m/s]."""
DRIVEN_PACE = 0.005
"""What is then left of the pace's uncertainty beside the speed's own."""
UNUSUAL, UNUSUAL_SIGMAS = 0.3, 4.0
"""A speed off the usual one by more than this share of it, and by so many of its own sigmas, is
no usual one at another pace. A train is seldom unusual: three sigmas are sooner an error."""


@numba.njit(cache=True)
def advance(
    x: Array, sums: Array, f: Array, w: Array, dt: float, rows: Array, step: float, closed: bool
) -> None:
    """Move the nominal state by one IMU step of mean force and rate ``f``, ``w`` (sensor axes)."""
    C = x[2:11].copy().reshape((3, 3))
    M = x[11:20].copy().reshape((3, 3))
    turn = np.empty(3)
    force = np.empty(3)
    for j in range(3):
        turn[j] = ((1.0 - x[X_GYRO_SCALE + j]) * w[j] - x[X_GYRO_BIAS + j]) * dt
        force[j] = f[j] - x[X_ACCEL_BIAS + j]
    middle = C @ exp_one(0.5 * turn)
    sums[SUM_TIME] += dt
    for i in range(3):
        sums[SUM_FORCE + i] += f[i] * dt
        for j in range(3):
            sums[SUM_TURN + 3 * i + j] += middle[i, j] * dt
            sums[SUM_SCALED + 3 * i + j] += middle[i, j] * w[j] * dt
    body = M @ force
    s, v = x[0], x[1]
    half = s + 0.5 * v * dt
    a = acceleration(rows, step, closed, half, v, body[0], body[1], body[2])
    x[0] = s + v * dt + 0.5 * a * dt * dt
    x[1] = v + a * dt
    x[2:11] = normalised_one(C @ exp_one(turn)).ravel()


@numba.njit(cache=True)
def predict(
    x: Array, P: Array, sums: Array, noise: Array, rows: Array, step: float, closed: bool
) -> Array:
    """
    Carry ``P`` over the epoch that ``sums`` describes, clear them, return the transition (18, 18).

    ``noise`` (6,): white acceleration along the line, white rate [(m/s^2)^2 s, (rad/s)^2 s], the
    walks of gyro bias, accelerometer bias and mount [units^2/s], standard deviation of the pace.
    """
    T = sums[SUM_TIME]
    F = np.eye(ERRORS)
    if T <= 0.0:
        return F
    M = x[11:20].copy().reshape((3, 3))
    force = np.empty(3)
    for j in range(3):
        force[j] = sums[SUM_FORCE + j] / T - x[X_ACCEL_BIAS + j]
    b = M @ force
    s, v = x[0], x[1]
    reach = min(max(SQRT3 * np.sqrt(P[0, 0]), 0.5), 10.0)
    ahead = acceleration(rows, step, closed, s + reach, v, b[0], b[1], b[2])
    behind = acceleration(rows, step, closed, s - reach, v, b[0], b[1], b[2])
    a_s = (ahead - behind) / (2.0 * reach)
    i, _ = row_of(rows, step, closed, s)
    row = rows[i]
    a_v = -2.0 * row[LEVER] * v / row[STRETCH]
    t = row[TANGENT : TANGENT + 3] / row[STRETCH]
    a = np.zeros(ERRORS)
    a[S], a[V] = a_s, a_v
    a[MOUNT] = b[1] * t[2] - b[2] * t[1]
    a[MOUNT + 1] = b[2] * t[0] - b[0] * t[2]
    a[MOUNT + 2] = b[0] * t[1] - b[1] * t[0]
    for j in range(3):
        a[ACCEL_BIAS + j] = -(M[0, j] * t[0] + M[1, j] * t[1] + M[2, j] * t[2])
    for j in range(ERRORS):
        F[S, j] += 0.5 * T * T * a[j]
        F[V, j] += T * a[j]
    F[S, V] += T
    for k in range(3):
        for j in range(3):
            F[TILT + k, GYRO_BIAS + j] = -sums[SUM_TURN + 3 * k + j]
            F[TILT + k, GYRO_SCALE + j] = -sums[SUM_SCALED + 3 * k + j]
    # A vehicle that has stopped, or turns back, starts with a pace of its own.
    keep = np.exp(-abs(v) * T * row[RENEWAL]) if abs(v) > STOPPED else 0.0
    F[PACE, PACE] = keep
    x[X_PACE] *= keep
    P[PACE, :] *= keep
    P[:, PACE] *= keep
    P[PACE, PACE] += noise[5] ** 2 * (1.0 - keep * keep)
    FP = np.zeros((5, ERRORS))
    for r in range(5):
        for k in range(ERRORS):
            if F[r, k] != 0.0:
                for c in range(ERRORS):
                    FP[r, c] += F[r, k] * P[k, c]
    P[0:5, :] = FP
    P[:, 0:5] = FP.T
    for r in range(5):
        for c in range(r, 5):
            total = 0.0
            for k in range(ERRORS):
                total += FP[r, k] * F[c, k]
            P[r, c] = total
            P[c, r] = total
    q = noise[0]
    P[S, S] += q * T**3 / 3.0
    P[S, V] += q * T**2 / 2.0
    P[V, S] += q * T**2 / 2.0
    P[V, V] += q * T
    for k in range(3):
        P[TILT + k, TILT + k] += noise[1] * T
        P[GYRO_BIAS + k, GYRO_BIAS + k] += noise[2] * T
        P[ACCEL_BIAS + k, ACCEL_BIAS + k] += noise[3] * T
        P[MOUNT + k, MOUNT + k] += noise[4] * T
    sums[:] = 0.0
    return F


@numba.njit(cache=True)
def lasting_noise(
    x: Array,
    force: Array,
    rows: Array,
    step: float,
    closed: bool,
    correlation_m: float,
    scale_sigma: float,
) -> float:
    """
    Return the white acceleration that stands for errors which last [(m/s^2)^2 s].

    The built line's slope is off by a share of the row's sigma over ``correlation_m``: gravity
    pulls so much more, the longer the slower the vehicle is. The accelerometer's scale is off by
    ``scale_sigma``, a share of the specific ``force`` (3,) in body axes along the line, for as
    long as a drive or brake lasts.
    """
    i, _ = row_of(rows, step, closed, x[0])
    row = rows[i]
    t = row[TANGENT : TANGENT + 3]
    level = GRAVITY**2 - row[CLIMB] ** 2
    sigma = SLOPE_SHARE * row[SIGMA]
    slope = sigma**2 * max(level, 0.0) * correlation_m / max(abs(x[1]), SLOWEST)
    along = force[0] * t[0] + force[1] * t[1] + force[2] * t[2]
    return float(slope + (scale_sigma * along) ** 2 * DRIVE_S)


@numba.njit(cache=True)
def follow_drive(
    x: Array,
    P: Array,
    F: Array,
    T: float,
    rows: Array,
    step: float,
    closed: bool,
    driven: Array,
    force: Array,
    shake: float,
    pace_sigma: float,
) -> bool:
    """
    Let the pace follow the speed where the vehicle is driven or braked as it usually is not.

    Part of the prediction: ``F`` is changed with ``P``. ``driven`` (1,) averages the unusual
    acceleration, from the specific ``force`` (3,) in body axes, whose noise is ``shake`` [m/s^2].
    Return whether the usual speed is to be left alone: where that is so, or the vehicle waits where
    others pass, or the other way round; then the pace is forgotten, known to ``pace_sigma``. Never
    where the vehicle rolls back.
    """
    usual, slope, _ = usual_speed(rows, step, closed, x[0], x[1], np.sqrt(P[0, 0]))
    if not (abs(usual) > SLOWEST and np.isfinite(slope)):
        driven[0] = 0.0
        return False
    if abs(x[1] - usual) > max(UNUSUAL * abs(usual), UNUSUAL_SIGMAS * np.sqrt(P[V, V])):
        driven[0] = x[X_PACE] = 0.0
        F[PACE, :] = 0.0
        P[PACE, :] = 0.0
        P[:, PACE] = 0.0
        P[PACE, PACE] = pace_sigma**2
        return True
    a = acceleration(rows, step, closed, x[0], x[1], force[0], force[1], force[2])
    # At a corner of the usual speed, what is usual on either side of it is no drive.
    low, high = usual_slopes(rows, step, closed, x[0], x[1], np.sqrt(P[0, 0]))
    rate = x[1] * (1.0 + x[X_PACE])
    low, high = min(rate * low, rate * high), max(rate * low, rate * high)
    unusual = a - min(max(a, low), high)
    driven[0] += T / (T + DRIVEN_S) * (unusual - driven[0])
    if abs(driven[0]) < DRIVEN_ACCEL + 0.3 * shake:
        return False
    x[X_PACE] = x[1] / usual - 1.0
    by_s = -x[1] * slope / usual**2
    F[PACE, :] = F[V, :] / usual + by_s * F[S, :]
    P[PACE, :] = P[V, :] / usual + by_s * P[S, :]
    own = P[PACE, V] / usual + by_s * P[PACE, S]
    P[:, PACE] = P[PACE, :]
    P[PACE, PACE] = own + DRIVEN_PACE**2
    return True

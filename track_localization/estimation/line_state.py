"""
State of a Kalman filter of a vehicle on a known line: its position is one number, the chainage.

The attitude integrated from the gyro is compared with the line's own: a line that turns tells
where on it the vehicle is, whatever its speed did. The specific force along the line drives the
speed, a usual speed by chainage may help, and standstill is a measurement. See ``line_motion``
for the prediction, ``line_updates`` for the measurements, ``line_rows`` for the line.

Nominal state x (30,): chainage s [m], its rate v [m/s], C (9, sensor to map), M (9, sensor to
body), gyro bias (3) [rad/s], gyro scale (3), accelerometer bias (3) [m/s^2] and pace (how much
faster than usual the vehicle is here, a share). Error state (18,): s, v, tilt (C = exp(tilt) C^),
mount (M = exp(mount) M^), biases, scale and pace. Everything is compiled and changes ``x`` and
``P`` in place.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.so3 import exp_one, log_one, normalised_one

Array = NDArray[np.float64]

NOMINAL, ERRORS = 30, 18
S, V, TILT, MOUNT, GYRO_BIAS, GYRO_SCALE, ACCEL_BIAS, PACE = 0, 1, 2, 5, 8, 11, 14, 17
X_ATTITUDE, X_MOUNT, X_GYRO_BIAS, X_GYRO_SCALE, X_ACCEL_BIAS, X_PACE = 2, 11, 20, 23, 26, 29


@numba.njit(cache=True)
def add_error(x: Array, e: Array) -> None:
    """Correct the nominal state by an error (18,)."""
    x[0] += e[S]
    x[1] += e[V]
    C = exp_one(e[TILT : TILT + 3]) @ x[2:11].copy().reshape((3, 3))
    M = exp_one(e[MOUNT : MOUNT + 3]) @ x[11:20].copy().reshape((3, 3))
    x[2:11] = normalised_one(C).ravel()
    x[11:20] = normalised_one(M).ravel()
    x[20:30] += e[GYRO_BIAS:ERRORS]


@numba.njit(cache=True)
def difference(x: Array, reference: Array) -> Array:
    """Return the error (18,) that takes ``reference`` to ``x``."""
    e = np.empty(ERRORS)
    e[S], e[V] = x[0] - reference[0], x[1] - reference[1]
    for first, k in ((2, TILT), (11, MOUNT)):
        A = x[first : first + 9].copy().reshape((3, 3))
        B = reference[first : first + 9].copy().reshape((3, 3))
        e[k : k + 3] = log_one(A @ np.ascontiguousarray(B.T))
    e[GYRO_BIAS:ERRORS] = x[20:30] - reference[20:30]
    return e


@numba.njit(cache=True)
def times(P: Array, h: Array) -> Array:
    """Return ``P h`` (18,) of a symmetric ``P`` (18, 18) and a ``h`` (18,) that is mostly zero."""
    out = np.zeros(ERRORS)
    for k in range(ERRORS):
        if h[k] != 0.0:
            for c in range(ERRORS):
                out[c] += h[k] * P[k, c]
    return out


@numba.njit(cache=True)
def correct(x: Array, P: Array, nu: Array, H: Array, R: Array) -> None:
    """
    Fuse a measurement of independent parts: ``nu`` (m,), ``H`` (m, 18), variances ``R`` (m,).

    One part at a time, which needs no inverse; then the nominal state takes the error over.
    """
    e = np.zeros(ERRORS)
    for i in range(len(nu)):
        h = H[i]
        Ph = times(P, h)
        missed, variance = nu[i], R[i]
        for c in range(ERRORS):
            missed -= h[c] * e[c]
            variance += h[c] * Ph[c]
        weight = 1.0 / variance
        for r in range(ERRORS):
            e[r] += Ph[r] * missed * weight
            for c in range(ERRORS):
                # This order keeps P symmetric to the last bit.
                P[r, c] -= Ph[r] * Ph[c] * weight
    add_error(x, e)
    # Tilt and mount are now measured from the corrected attitudes.
    for k in (TILT, MOUNT):
        angle = e[k : k + 3]
        if np.dot(angle, angle) < 1e-8:
            continue
        G = exp_one(0.5 * angle)
        block = G @ np.ascontiguousarray(P[k : k + 3, :])
        P[k : k + 3, :] = block
        P[:, k : k + 3] = np.ascontiguousarray(P[:, k : k + 3]) @ np.ascontiguousarray(G.T)

"""The compiled arithmetic of ``eskf``: see there for what the numbers of a state mean."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.so3 import (
    exp_one,
    log_one,
    normalised_one,
    product_one,
)
from track_localization.estimation.strapdown import reckon_into

Array = NDArray[np.float64]


@numba.njit(cache=True)
def box_minus(x: Array, reference: Array) -> Array:
    """Return the error (18,) from ``reference`` to ``x``."""
    out = np.empty(18)
    out[0:6] = x[0:6] - reference[0:6]
    R, R_ref = x[6:15].reshape((3, 3)), reference[6:15].reshape((3, 3))
    out[6:9] = log_one(product_one(R_ref.T, R))
    out[9:18] = x[15:24] - reference[15:24]
    return out


@numba.njit(cache=True)
def box_plus(x: Array, e: Array) -> Array:
    """Return ``x`` with an error (18,) added."""
    out = x.copy()
    out[0:6] += e[0:6]
    R = product_one(x[6:15].reshape((3, 3)), exp_one(e[6:9]))
    out[6:15] = normalised_one(R).ravel()
    out[15:24] += e[9:18]
    return out


@numba.njit(cache=True)
def process_noise(densities: Array, f: Array, w: Array, dt: float, extra_accel: float) -> Array:
    """Return what ``eskf.process_noise`` does."""
    q = densities[0].copy()
    q[0] += densities[1, 0] * (f[0] ** 2 + f[1] ** 2 + f[2] ** 2) + extra_accel**2
    q[1] += densities[1, 1] * (w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    return q * dt


@numba.njit(cache=True)
def transition(x: Array, f: Array, w: Array, dt: float) -> Array:
    """Return F (18, 18)."""
    return predict(x, np.eye(18), f, w, dt, np.zeros(4))[2]


@numba.njit(cache=True)
def fill_transition(R_mid: Array, half_turn: Array, a: Array, dt: float, F: Array) -> None:
    """
    Write into ``F``, which is the identity or an earlier F, what is not the identity's.

    ``R_mid``: attitude in the middle of the step; ``half_turn``: the rotation from its begin to
    there; ``a`` (3,): specific force without bias.
    """
    turn_back = product_one(half_turn, half_turn).T
    for i in range(3):
        for j in range(3):
            F[6 + i, 6 + j] = turn_back[i, j]
        F[i, 3 + i] = dt
        F[3 + i, 15 + i] = dt
        F[6 + i, 12 + i] = -dt
        # -R [a x] dt, row by row
        F[3 + i, 6] = (R_mid[i, 2] * a[1] - R_mid[i, 1] * a[2]) * dt
        F[3 + i, 7] = (R_mid[i, 0] * a[2] - R_mid[i, 2] * a[0]) * dt
        F[3 + i, 8] = (R_mid[i, 1] * a[0] - R_mid[i, 0] * a[1]) * dt
        for j in range(3):
            F[3 + i, 9 + j] = -R_mid[i, j] * dt
        # The position moves by half of what the velocity gains.
        F[i, 15 + i] = 0.5 * dt * dt
        for j in range(6, 12):
            F[i, j] = 0.5 * dt * F[3 + i, j]


@numba.njit(cache=True)
def predict(
    x: Array, P: Array, f: Array, w: Array, dt: float, q: Array
) -> tuple[Array, Array, Array]:
    """Return nominal state, covariance and F after a step."""
    x_new, P_new, F = np.empty(24), np.empty((18, 18)), np.eye(18)
    predict_into(x, P, f, w, dt, q, F, np.empty((18, 18)), x_new, P_new)
    return x_new, P_new, F


@numba.njit(cache=True)
def predict_into(
    x: Array,
    P: Array,
    f: Array,
    w: Array,
    dt: float,
    q: Array,
    F: Array,
    work: Array,
    x_new: Array,
    P_new: Array,
) -> None:
    """Write a step's F, nominal state and covariance; ``F`` as in ``fill_transition``."""
    a, half_angle = np.empty(3), np.empty(3)
    for i in range(3):
        a[i] = f[i] - x[15 + i]
        half_angle[i] = 0.5 * dt * (w[i] - x[18 + i])
    half_turn = exp_one(half_angle)
    R_mid = product_one(x[6:15].reshape((3, 3)), half_turn)
    fill_transition(R_mid, half_turn, a, dt, F)
    p, v, R_new = x_new[0:3], x_new[3:6], x_new[6:15].reshape((3, 3))
    reckon_into(x[0:3], x[3:6], R_mid, half_turn, a, x[21:24], dt, p, v, R_new)
    x_new[15:24] = x[15:24]
    # F P F', exactly symmetric
    rows_times(F, P, work)
    rows_times(F, work.T, P_new)
    for i in range(18):
        for j in range(i):
            P_new[i, j] = P_new[j, i]
    for i in range(3):
        P_new[i, i] += q[0] * dt * dt / 3.0
        P_new[i, 3 + i] += q[0] * dt / 2.0
        P_new[3 + i, i] += q[0] * dt / 2.0
        P_new[3 + i, 3 + i] += q[0]
        P_new[6 + i, 6 + i] += q[1]
        P_new[9 + i, 9 + i] += q[2]
        P_new[12 + i, 12 + i] += q[3]


@numba.njit(cache=True)
def rows_times(F: Array, M: Array, out: Array) -> None:
    """Set ``out`` to F M, block by block: most of F is nought, or part of the identity."""
    dt = F[0, 3]
    for j in range(18):
        for i in range(9, 18):
            out[i, j] = M[i, j]
        for i in range(3):
            gained = dt * M[15 + i, j]
            for k in range(6, 12):
                gained += F[3 + i, k] * M[k, j]
            out[3 + i, j] = M[3 + i, j] + gained
            out[i, j] = M[i, j] + dt * (M[3 + i, j] + 0.5 * gained)
            turned = -dt * M[12 + i, j]
            for k in range(6, 9):
                turned += F[6 + i, k] * M[k, j]
            out[6 + i, j] = turned


@numba.njit(cache=True)
def nis(P: Array, nu: Array, H: Array, R: Array) -> float:
    """Return the normalised innovation squared."""
    S = H @ P @ np.ascontiguousarray(H.T) + R
    return float(nu @ np.linalg.solve(S, nu))


@numba.njit(cache=True)
def update(x: Array, P: Array, nu: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Return nominal state and covariance after a measurement."""
    PHt = P @ np.ascontiguousarray(H.T)
    S = H @ PHt + R
    K = np.ascontiguousarray(np.linalg.solve(S, np.ascontiguousarray(PHt.T)).T)
    error = K @ nu
    A = np.eye(18) - K @ H
    P_new = A @ P @ np.ascontiguousarray(A.T) + K @ R @ np.ascontiguousarray(K.T)
    # Reset: the attitude error is now measured from the corrected attitude.
    e = error[6:9]
    G = np.eye(18)
    G[6:9, 6:9] = exp_one(-0.5 * e)
    P_new = G @ P_new @ np.ascontiguousarray(G.T)
    return box_plus(x, error), 0.5 * (P_new + P_new.T)


@numba.njit(cache=True)
def pose_covariance(x: Array, P: Array) -> Array:
    """Return what ``eskf.pose_covariance`` does."""
    T = np.zeros((6, 18))
    T[0:3, 0:3] = np.eye(3)
    T[3:6, 6:9] = x[6:15].reshape((3, 3))
    return T @ P @ np.ascontiguousarray(T.T)


@numba.njit(cache=True)
def twist_covariance(x: Array, P: Array, rate_sigma: float) -> Array:
    """Return what ``eskf.twist_covariance`` does."""
    R_bn = np.ascontiguousarray(x[6:15].reshape((3, 3)).T)
    v = R_bn @ x[3:6]
    J = np.zeros((6, 18))
    J[0:3, 3:6] = R_bn
    J[0:3, 6:9] = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    J[3:6, 12:15] = -np.eye(3)
    out = J @ P @ np.ascontiguousarray(J.T)
    for i in range(3, 6):
        out[i, i] += rate_sigma**2
    return out

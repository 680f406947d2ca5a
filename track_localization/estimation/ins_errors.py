"""
How the errors of an inertial navigator grow: transition, process noise, covariance; compiled.

The error state (15,) is position east, north, up [m], velocity [m/s], attitude [rad], gyro bias
[rad/s], accelerometer bias [m/s^2], each true minus estimated; the attitude's is a right
perturbation in the body. Position errors are differences of latitude and longitude in metres at
the navigator's own place.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import quaternion as quat
from track_localization.estimation.earth import EARTH_RATE, curvature_radii, gravity, gravity_slope

Array = NDArray[np.float64]

STATES = 15
MOVING = 9
"""Errors that change by themselves: all but the biases."""


@numba.njit(cache=True)
def error_transition(nav: Array, f: Array, w: Array, dt: float, Phi: Array) -> None:
    """
    Write the transition (15, 15) of the error over ``dt`` [s] into ``Phi``, to second order.

    ``nav`` (10,) is the state before the step, ``f`` and ``w`` (3,) are the step's mean force and
    rate, free of bias. Left out is how radii and gravity change with latitude: less than 1 % of
    what the frame's rotation does, and 8e-9 m/s^2 per metre.
    """
    F = np.zeros((MOVING, STATES))
    dynamics(nav, f, w, dt, F)
    half = 0.5 * dt * dt
    Phi[:, :] = 0.0
    for i in range(STATES):
        Phi[i, i] = 1.0
    for i in range(MOVING):
        for j in range(STATES):
            Phi[i, j] += dt * F[i, j]
        for k in range(MOVING):
            value = half * F[i, k]
            if value != 0.0:
                for j in range(STATES):
                    Phi[i, j] += value * F[k, j]


@numba.njit(cache=True)
def dynamics(nav: Array, f: Array, w: Array, dt: float, F: Array) -> None:
    """
    Fill ``F`` (9, 15), zero before: time derivatives of the first nine errors by all of them.

    Attitude and velocity are those in the middle of the step.
    """
    M, N = curvature_radii(nav[0])
    along, across = M + nav[2], N + nav[2]
    tan = np.tan(nav[0])
    north, up = EARTH_RATE * np.cos(nav[0]), EARTH_RATE * np.sin(nav[0])
    x, y = -nav[4] / along, nav[3] / across
    C = np.empty((3, 3))
    _middle_attitude(nav, (x, y + north, y * tan + up), w, dt, C)
    v = _middle_velocity(nav, f, C, dt)
    x, y = -v[1] / along, v[0] / across
    z = y * tan

    F[0, 0], F[0, 1], F[0, 2] = v[2] / across + x * tan, v[0] * tan / along, -y
    F[1, 1], F[1, 2] = v[2] / along, x
    for i in range(3):
        F[i, 3 + i] = 1.0
    # Gravity, and v x (2 w_ie + w_en) by velocity itself.
    F[5, 2] = -gravity_slope(nav[0], nav[2])
    F[3, 4], F[3, 5] = 2.0 * up + z, -2.0 * north - y
    F[4, 3], F[4, 5] = -2.0 * up - z, x
    F[5, 3], F[5, 4] = 2.0 * north + y, -x
    # Both frame rates by position and velocity: what they do to velocity and attitude.
    bend = y * (1.0 + tan * tan) / along
    _rate_column(F, C, 1, v, (0.0, -up / along, north / along), (0.0, 0.0, bend))
    none = (0.0, 0.0, 0.0)
    _rate_column(F, C, 2, v, none, (-x / along, -y / across, -z / across))
    _rate_column(F, C, 3, v, none, (0.0, 1.0 / across, tan / across))
    _rate_column(F, C, 4, v, none, (-1.0 / along, 0.0, 0.0))
    _body_columns(F, C, f, w)


@numba.njit(cache=True)
def _body_columns(F: Array, C: Array, f: Array, w: Array) -> None:
    """Fill in what attitude and biases do to velocity and attitude."""
    for i in range(3):
        F[3 + i, 6] = C[i, 2] * f[1] - C[i, 1] * f[2]
        F[3 + i, 7] = C[i, 0] * f[2] - C[i, 2] * f[0]
        F[3 + i, 8] = C[i, 1] * f[0] - C[i, 0] * f[1]
        for j in range(3):
            F[3 + i, 12 + j] = -C[i, j]
        F[6 + i, 9 + i] = -1.0
    F[6, 7], F[6, 8], F[7, 8] = w[2], -w[1], w[0]
    F[7, 6], F[8, 6], F[8, 7] = -w[2], w[1], -w[0]


@numba.njit(cache=True)
def _middle_attitude(nav: Array, turn: quat.Vector, w: Array, dt: float, C: Array) -> None:
    """Write R_nb (3, 3) half a step on into ``C``; ``turn`` is the frame's own rate [rad/s]."""
    h = 0.5 * dt
    level = quat.from_rotation_vector((-h * turn[0], -h * turn[1], -h * turn[2]))
    body = quat.from_rotation_vector((h * w[0], h * w[1], h * w[2]))
    x, y, z, s = quat.product(level, quat.product((nav[6], nav[7], nav[8], nav[9]), body))
    quat.matrix(x, y, z, s, C)


@numba.njit(cache=True)
def _middle_velocity(nav: Array, f: Array, C: Array, dt: float) -> quat.Vector:
    """Return the velocity half a step on [m/s]."""
    h = 0.5 * dt
    return (
        nav[3] + h * (C[0, 0] * f[0] + C[0, 1] * f[1] + C[0, 2] * f[2]),
        nav[4] + h * (C[1, 0] * f[0] + C[1, 1] * f[1] + C[1, 2] * f[2]),
        nav[5] + h * (C[2, 0] * f[0] + C[2, 1] * f[1] + C[2, 2] * f[2] - gravity(nav[0], nav[2])),
    )


@numba.njit(cache=True)
def _rate_column(
    F: Array, C: Array, column: int, v: quat.Vector, earth: quat.Vector, transport: quat.Vector
) -> None:
    """Add what a change of the Earth's and the transport rate by one error does to ``F``."""
    a = (earth[0] + transport[0], earth[1] + transport[1], earth[2] + transport[2])
    b = (earth[0] + a[0], earth[1] + a[1], earth[2] + a[2])
    c = quat.cross(v, b)
    for i in range(3):
        F[3 + i, column] += c[i]
        F[6 + i, column] -= C[0, i] * a[0] + C[1, i] * a[1] + C[2, i] * a[2]


@numba.njit(cache=True)
def process_noise(
    nav: Array,
    dt: float,
    gyro_psd: float,
    accel_psd: float,
    gyro_bias_psd: float,
    accel_bias_psd: float,
    Q: Array,
) -> None:
    """
    Write the covariance (15, 15) that white noise adds in one step into ``Q``.

    Densities are squared: gyro (rad/s)^2/Hz, accelerometer (m/s^2)^2/Hz, and the same per second
    for the walks of their biases. Each noise reaches the error it drives and the next one behind
    it; what it does further on in the same step is left to the next step's transition.
    """
    Q[:, :] = 0.0
    C = np.empty((3, 3))
    quat.matrix(nav[6], nav[7], nav[8], nav[9], C)
    half = 0.5 * dt * dt
    for i in range(3):
        Q[i, i] = accel_psd * dt * dt * dt / 3.0
        Q[i, 3 + i] = Q[3 + i, i] = accel_psd * half
        Q[3 + i, 3 + i] = accel_psd * dt
        Q[6 + i, 6 + i] = gyro_psd * dt
        Q[6 + i, 9 + i] = Q[9 + i, 6 + i] = -gyro_bias_psd * half
        Q[9 + i, 9 + i] = gyro_bias_psd * dt
        Q[12 + i, 12 + i] = accel_bias_psd * dt
        for j in range(3):
            Q[3 + i, 12 + j] = Q[12 + j, 3 + i] = -accel_bias_psd * half * C[i, j]


@numba.njit(cache=True)
def propagate(P: Array, Phi: Array, Q: Array) -> None:
    """
    Predict ``P`` (n, n), n at least 15, in place: Phi P Phi' + Q on its first 15 states.

    Rows 9:15 of ``Phi`` must be those of the identity, as ``error_transition`` and products of its
    results have them. States behind the first 15 stay as they are. ``P`` stays exactly symmetric.
    """
    states = len(P)
    ahead = np.zeros((MOVING, states))
    for i in range(MOVING):
        for k in range(STATES):
            value = Phi[i, k]
            if value != 0.0:
                for j in range(states):
                    ahead[i, j] += value * P[k, j]
    for i in range(MOVING):
        for j in range(MOVING, states):
            P[i, j] = ahead[i, j]
            P[j, i] = ahead[i, j]
        for j in range(i + 1):
            total = 0.0
            for k in range(STATES):
                total += ahead[i, k] * Phi[j, k]
            P[i, j] = total
            P[j, i] = total
    for i in range(STATES):
        for j in range(STATES):
            P[i, j] += Q[i, j]

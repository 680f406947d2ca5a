"""
Error-state Kalman filter of an inertial navigator: 18 states, any measurement.

The nominal state is one flat array of 24 numbers (see the slices), the error state has 18:
position, velocity, attitude, accelerometer bias, gyro bias, gravity (paper 1, eqs 15-27; the
kinematics are those of Sola, "Quaternion kinematics for the error-state Kalman filter", 2017).
The attitude error is a right perturbation in the body. States are values: every function returns
new arrays, so that a history of them can be kept and replayed.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.so3 import exp_one, log_one, normalised_one
from track_localization.estimation.strapdown import dead_reckon_one

Array = NDArray[np.float64]

ERROR_STATES = 18
# Error state: where each part stands in x_err, P, F and H.
POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
ACCEL_BIAS, GYRO_BIAS, GRAVITY_STATE = slice(9, 12), slice(12, 15), slice(15, 18)
# Nominal state: position 0:3, velocity 3:6, R_nb row by row 6:15, biases 15:18, 18:21, g 21:24.
NOMINAL_STATES = 24


class State(NamedTuple):
    """
    Nominal state and the covariance of its error.

    Attributes:
        time_s: stamp [s].
        x: (24,) nominal state.
        P: (18, 18) error covariance.
    """

    time_s: float
    x: Array
    P: Array

    @property
    def position(self) -> Array:
        """Position (3,) in ``map`` [m]."""
        return self.x[0:3]

    @property
    def velocity(self) -> Array:
        """Velocity (3,) in ``map`` [m/s]."""
        return self.x[3:6]

    @property
    def R_nb(self) -> Array:
        """Attitude (3, 3)."""
        return self.x[6:15].reshape(3, 3)

    @property
    def accel_bias(self) -> Array:
        """Accelerometer bias (3,) [m/s^2]."""
        return self.x[15:18]

    @property
    def gyro_bias(self) -> Array:
        """Gyro bias (3,) [rad/s]."""
        return self.x[18:21]

    @property
    def gravity(self) -> Array:
        """Gravity (3,) in ``map`` [m/s^2]."""
        return self.x[21:24]


@dataclasses.dataclass(frozen=True)
class ImuNoise:
    """
    What an IMU adds to the motion, as densities.

    Attributes:
        accel: velocity random walk [m/s^2/sqrt(Hz)].
        gyro: angle random walk [rad/s/sqrt(Hz)].
        accel_walk: bias walk [m/s^2/sqrt(s)].
        gyro_walk: bias walk [rad/s/sqrt(s)].
        accel_scale: scale error, a fraction of the force.
        gyro_scale: scale error, a fraction of the rate.
        scale_time_s: how long a manoeuvre keeps its direction: a scale error acts as noise with
            this correlation time [s].
    """

    accel: float
    gyro: float
    accel_walk: float
    gyro_walk: float
    accel_scale: float = 0.0
    gyro_scale: float = 0.0
    scale_time_s: float = 1.0


def make_state(
    time_s: float,
    position: Array,
    velocity: Array,
    R_nb: Array,
    gravity: Array,
    sigmas: tuple[Array, Array, Array, float, float, float],
    accel_bias: Array | None = None,
    gyro_bias: Array | None = None,
) -> State:
    """
    Return a state with a diagonal covariance.

    ``sigmas``: standard deviations of position (3,), velocity (3,), attitude (3,) in the body, and
    of accelerometer bias, gyro bias and gravity (scalars).
    """
    zero = np.zeros(3)
    ab = zero if accel_bias is None else accel_bias
    wb = zero if gyro_bias is None else gyro_bias
    x = np.concatenate([position, velocity, R_nb.ravel(), ab, wb, gravity])
    std = np.concatenate([*sigmas[:3], *(np.full(3, s) for s in sigmas[3:])])
    return State(time_s, x, np.diag(std**2))


def process_noise(noise: ImuNoise, f: Array, w: Array, dt: float, extra_accel: float) -> Array:
    """
    Return the variances (4,) that one step adds to velocity, attitude and the two biases.

    As eq. (20), with the walks growing by dt and not dt^2; ``f``, ``w`` are the sample's force and
    rate, ``extra_accel`` [m/s^2/sqrt(Hz)] is what vibration adds.
    """
    scale = 2.0 * noise.scale_time_s
    force2 = float(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    rate2 = float(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    return np.array(
        (
            (noise.accel**2 + extra_accel**2 + scale * noise.accel_scale**2 * force2) * dt,
            (noise.gyro**2 + scale * noise.gyro_scale**2 * rate2) * dt,
            noise.accel_walk**2 * dt,
            noise.gyro_walk**2 * dt,
        )
    )


def propagate(
    state: State, f: Array, w: Array, dt: float, q: Array, time_s: float | None = None
) -> State:
    """
    Predict over ``dt`` with mean measured force and rate (eqs 17-19).

    ``q`` (4,) as ``process_noise`` gives it; ``time_s`` is the new stamp where a sum of steps
    would be too coarse.
    """
    x, P = _propagate(state.x, state.P, f, w, dt, q)
    return State(state.time_s + dt if time_s is None else time_s, x, P)


def predict(
    x: Array, P: Array, f: Array, w: Array, dt: float, q: Array
) -> tuple[Array, Array, Array]:
    """Return nominal state, covariance and transition F of one step: what a smoother needs."""
    x_new, P_new = _propagate(x, P, f, w, dt, q)
    return x_new, P_new, _transition(x, f, w, dt)


def pose_covariance(state: State) -> Array:
    """Return the covariance (6, 6) of position [m] and of rotation about the map's axes [rad]."""
    out: Array = _pose_covariance(state.x, state.P)
    return out


def twist_covariance(state: State, rate_sigma: float) -> Array:
    """
    Return the covariance (6, 6) of the velocity [m/s] and angular rate [rad/s] in the body.

    ``rate_sigma``: standard deviation of a rate's noise [rad/s].
    """
    out: Array = _twist_covariance(state.x, state.P, rate_sigma)
    return out


def innovation_covariance(state: State, H: Array, R: Array) -> Array:
    """Return S = H P H' + R."""
    S: Array = H @ state.P @ H.T + R
    return S


def update(state: State, nu: Array, H: Array, R: Array) -> State:
    """
    Correct by a measurement: innovation ``nu`` (m,), Jacobian ``H`` (m, 18), noise ``R`` (m, m).

    Joseph form; the covariance is carried through the reset of the attitude error (eqs 23-27).
    """
    x, P = _update(state.x, state.P, nu, H, R)
    return State(state.time_s, x, P)


def transition(state: State, f: Array, w: Array, dt: float) -> Array:
    """Return F (18, 18), the error transition that ``propagate`` uses from ``state``."""
    F: Array = _transition(state.x, f, w, dt)
    return F


def box_plus(x: Array, error: Array) -> Array:
    """Return the nominal state (24,) with an error (18,) added."""
    out: Array = _box_plus(x, error)
    return out


def box_minus(x: Array, reference: Array) -> Array:
    """Return the error (18,) that takes ``reference`` (24,) to ``x``: the inverse of box_plus."""
    out: Array = _box_minus(x, reference)
    return out


@numba.njit(cache=True)
def _box_minus(x: Array, reference: Array) -> Array:
    out = np.empty(18)
    out[0:6] = x[0:6] - reference[0:6]
    R = np.ascontiguousarray(x[6:15]).reshape((3, 3))
    R_ref = np.ascontiguousarray(reference[6:15]).reshape((3, 3))
    out[6:9] = log_one(np.ascontiguousarray(R_ref.T) @ R)
    out[9:18] = x[15:24] - reference[15:24]
    return out


@numba.njit(cache=True)
def _box_plus(x: Array, e: Array) -> Array:
    out = x.copy()
    out[0:6] += e[0:6]
    R = np.ascontiguousarray(x[6:15]).reshape((3, 3)) @ exp_one(e[6:9])
    out[6:15] = normalised_one(R).ravel()
    out[15:24] += e[9:18]
    return out


@numba.njit(cache=True)
def _transition(x: Array, f: Array, w: Array, dt: float) -> Array:
    R = np.ascontiguousarray(x[6:15]).reshape((3, 3))
    a, rate = f - x[15:18], w - x[18:21]
    R_mid = R @ exp_one(rate * (0.5 * dt))
    F = np.eye(18)
    skew = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    v_theta = -(R_mid @ skew) * dt
    for i in range(3):
        F[i, 3 + i] = dt
        F[i, 15 + i] = 0.5 * dt * dt
        F[3 + i, 15 + i] = dt
        F[6 + i, 12 + i] = -dt
        for j in range(3):
            F[i, 6 + j] = 0.5 * dt * v_theta[i, j]
            F[i, 9 + j] = -0.5 * dt * dt * R_mid[i, j]
            F[3 + i, 6 + j] = v_theta[i, j]
            F[3 + i, 9 + j] = -R_mid[i, j] * dt
    F[6:9, 6:9] = exp_one(-rate * dt)
    return F


@numba.njit(cache=True)
def _propagate(x: Array, P: Array, f: Array, w: Array, dt: float, q: Array) -> tuple[Array, Array]:
    F = _transition(x, f, w, dt)
    out = x.copy()
    R = np.ascontiguousarray(x[6:15]).reshape((3, 3))
    p, v, R_new = dead_reckon_one(x[0:3], x[3:6], R, f - x[15:18], w - x[18:21], x[21:24], dt)
    out[0:3], out[3:6], out[6:15] = p, v, R_new.ravel()
    P_new = _sandwich(F, P)
    for i in range(3):
        P_new[i, i] += q[0] * dt * dt / 3.0
        P_new[i, 3 + i] += q[0] * dt / 2.0
        P_new[3 + i, i] += q[0] * dt / 2.0
        P_new[3 + i, 3 + i] += q[0]
        P_new[6 + i, 6 + i] += q[1]
        P_new[9 + i, 9 + i] += q[2]
        P_new[12 + i, 12 + i] += q[3]
    return out, P_new


@numba.njit(cache=True)
def _sandwich(F: Array, P: Array) -> Array:
    """Return F P F', exactly symmetric. Rows 9:18 of F are those of the identity."""
    FP = P.copy()
    for i in range(9):
        for j in range(18):
            FP[i, j] = 0.0
        for k in range(18):
            value = F[i, k]
            if value != 0.0:
                for j in range(18):
                    FP[i, j] += value * P[k, j]
    out = FP.copy()
    for j in range(9):
        for i in range(j, 18):
            total = 0.0
            for k in range(18):
                total += FP[i, k] * F[j, k]
            out[i, j] = total
            out[j, i] = total
    return out


@numba.njit(cache=True)
def _update(x: Array, P: Array, nu: Array, H: Array, R: Array) -> tuple[Array, Array]:
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
    return _box_plus(x, error), 0.5 * (P_new + P_new.T)


@numba.njit(cache=True)
def _pose_covariance(x: Array, P: Array) -> Array:
    T = np.zeros((6, 18))
    T[0:3, 0:3] = np.eye(3)
    T[3:6, 6:9] = x[6:15].reshape((3, 3))
    return T @ P @ np.ascontiguousarray(T.T)


@numba.njit(cache=True)
def _twist_covariance(x: Array, P: Array, rate_sigma: float) -> Array:
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

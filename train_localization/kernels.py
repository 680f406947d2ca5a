"""
The train's error-state filter, compiled: prediction over a stretch of IMU samples, and updates.

The error state (27,) is dr, dv (east, north, up), the attitude error in the body, gyro and
accelerometer biases (15, see ``estimation.ins``), then the odometer's scale error, yaw and pitch of
the car in the IMU's body, the fixes' slow error (3), the map's offset to the left and upward, and
what ``straights`` keeps: the mean courses of the last two chords, the straight's, and what is to
become that of the next chord [rad m]. ``nav`` (10,) holds the first nine, ``aux`` (18,) the others;
errors are true minus estimated.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization.estimation.ins import (
    curvature_radii,
    earth_rate,
    error_transition,
    inject,
    mechanise,
    process_noise,
)
from track_localization.estimation.sequential import update

Array = NDArray[np.float64]

SIZE, INERTIAL, AUX = 27, 15, 18
SCALE, YAW, PITCH, SLOW, MAP = 15, 16, 17, 18, 21
COURSE, EARLIER, LINE, MEAN = 23, 24, 25, 26
"""Places in the error state; those in ``aux`` are less by 9."""


class Noise(NamedTuple):
    """
    What drives the error state, as spectral densities.

    Attributes:
        gyro: [rad^2/s].
        accel: [m^2/s^3].
        gyro_bias: [rad^2/s^3].
        accel_bias: [m^2/s^5].
        slow: horizontal variance of the fixes' slow error [m^2].
        slow_up: vertical [m^2].
        slow_s: its correlation time [s].
    """

    gyro: float
    accel: float
    gyro_bias: float
    accel_bias: float
    slow: float
    slow_up: float
    slow_s: float


@njit(cache=True)
def predict(
    nav: Array,
    aux: Array,
    P: Array,
    time_s: float,
    stamps: Array,
    rates: Array,
    forces: Array,
    before: Array,
    noise: Noise,
    Phi: Array,
) -> None:
    """
    Carry the state over IMU samples, in place.

    Args:
        nav: (10,) navigation state.
        aux: (18,) the other states.
        P: (27, 27) covariance.
        time_s: stamp of the state [s].
        stamps: (m,) of the samples [s].
        rates: (m, 3) [rad/s].
        forces: (m, 3) [m/s^2].
        before: (6,) rate and force of the sample before; it becomes that of the last.
        noise: what drives the errors.
        Phi: (15, 15) is filled with the transition of the inertial errors.
    """
    m = len(stamps)
    w, f = np.empty(3), np.empty(3)
    w_before, f_before = before[:3] - aux[:3], before[3:] - aux[3:6]
    w_mean, f_mean = np.zeros(3), np.zeros(3)
    begin, first = time_s, nav.copy()
    for i in range(m):
        for k in range(3):
            w[k] = rates[i, k] - aux[k]
            f[k] = forces[i, k] - aux[3 + k]
        dt = stamps[i] - time_s
        mechanise(nav, w, f, w_before, f_before, dt)
        w_mean += 0.5 * (w + w_before) * dt
        f_mean += 0.5 * (f + f_before) * dt
        w_before[:] = w
        f_before[:] = f
        time_s = stamps[i]
    before[:3] = rates[m - 1]
    before[3:] = forces[m - 1]
    span = time_s - begin
    if span <= 0.0:
        return
    error_transition(first, f_mean / span, w_mean / span, span, Phi)
    Q = np.zeros((INERTIAL, INERTIAL))
    process_noise(first, span, noise.gyro, noise.accel, noise.gyro_bias, noise.accel_bias, Q)
    spread(P, Phi, Q, span, noise)
    if P.shape[0] == SIZE:
        for k in range(SLOW - 9, SLOW - 6):
            aux[k] *= math.exp(-span / noise.slow_s)


@njit(cache=True)
def longest_gap(time_s: float, stamps: Array) -> float:
    """Return the longest time between a stamp and the next ones [s]."""
    longest = 0.0
    for stamp in stamps:
        longest = max(longest, stamp - time_s)
        time_s = stamp
    return longest


@njit(cache=True)
def speed_of(nav: Array) -> float:
    """Return the speed of a navigation state [m/s]."""
    return math.sqrt(nav[3] ** 2 + nav[4] ** 2 + nav[5] ** 2)


@njit(cache=True)
def spread(P: Array, Phi: Array, Q: Array, span: float, noise: Noise) -> None:
    """Carry the covariance over ``span`` [s], in place."""
    P[:INERTIAL, :] = Phi @ np.ascontiguousarray(P[:INERTIAL, :])
    P[:, :INERTIAL] = np.ascontiguousarray(P[:, :INERTIAL]) @ np.ascontiguousarray(Phi.T)
    for i in range(INERTIAL):
        for j in range(INERTIAL):
            P[i, j] += Q[i, j]
    if P.shape[0] < SIZE:
        return
    keep = math.exp(-span / noise.slow_s)
    for k in range(SLOW, SLOW + 3):
        for j in range(SIZE):
            P[k, j] *= keep
        for j in range(SIZE):
            P[j, k] *= keep
        variance = noise.slow_up if k == SLOW + 2 else noise.slow
        P[k, k] += (1.0 - keep * keep) * variance


@njit(cache=True)
def give(nav: Array, aux: Array, dx: Array) -> None:
    """Put what an update found into the state, and the correction to nought, in place."""
    inject(nav, dx)
    for k in range(len(dx) - 9):
        aux[k] += dx[9 + k]
    dx[:] = 0.0


@njit(cache=True)
def rotation(nav: Array) -> Array:
    """Return R_nb (3, 3) of a navigation state."""
    x, y, z, w = nav[6], nav[7], nav[8], nav[9]
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return R


@njit(cache=True)
def apart(nav: Array, latitude: float, longitude: float, height: float) -> Array:
    """Return where a geodetic place is as seen from the state, east, north, up (3,) [m]."""
    meridian, normal = curvature_radii(nav[0])
    out = np.empty(3)
    out[0] = (longitude - nav[1]) * (normal + nav[2]) * math.cos(nav[0])
    out[1] = (latitude - nav[0]) * (meridian + nav[2])
    out[2] = height - nav[2]
    return out


@njit(cache=True)
def moved(geodetic: Array, way: Array) -> Array:
    """Return latitude, longitude [rad], height [m] (3,) a way (3,) east, north, up further."""
    meridian, normal = curvature_radii(geodetic[0])
    out = np.empty(3)
    out[0] = geodetic[0] + way[1] / (meridian + geodetic[2])
    out[1] = geodetic[1] + way[0] / ((normal + geodetic[2]) * math.cos(geodetic[0]))
    out[2] = geodetic[2] + way[2]
    return out


@njit(cache=True)
def antenna(nav: Array, lever: Array) -> tuple[Array, Array]:
    """Return where (3,) what is at ``lever`` (3,) in the body is from it; its rows by attitude."""
    R, H = rotation(nav), np.empty((3, 3))
    x, y, z = lever[0], lever[1], lever[2]
    for k in range(3):
        H[k, 0] = R[k, 2] * y - R[k, 1] * z
        H[k, 1] = R[k, 0] * z - R[k, 2] * x
        H[k, 2] = R[k, 1] * x - R[k, 0] * y
    return R @ lever, H


@njit(cache=True)
def fix(
    nav: Array,
    aux: Array,
    P: Array,
    ahead: Array,
    turned: Array,
    R: Array,
    axes: int,
    huber: float,
    gate: float,
) -> float:
    """
    Update with a fix ``ahead`` (3,) of the antenna [m], white variances ``R`` (3,), in place.

    Of the first ``axes`` axes; ``turned`` (3, 3) is how the attitude moves the antenna. Return the
    greatest NIS of an axis; above ``gate`` nothing was done, above ``huber`` it counts as if its
    innovation were expected to be as much greater (Huber).
    """
    n = P.shape[0]
    worst = 0.0
    expected, H = np.zeros(3), np.zeros((3, n))
    for k in range(axes):
        H[k, k], H[k, SLOW + k] = 1.0, 1.0
        H[k, 6:9] = turned[k]
        expected[k] = H[k] @ P @ H[k] + R[k]
        worst = max(worst, (ahead[k] - aux[SLOW + k - 9]) ** 2 / expected[k])
    if worst > gate:
        return worst
    more = max(worst / huber, 1.0) - 1.0
    dx = np.zeros(n)
    for k in range(axes):
        update(P, H[k], R[k] + more * expected[k], ahead[k] - aux[SLOW + k - 9], dx)
    give(nav, aux, dx)
    return worst


@njit(cache=True)
def _body_velocity(nav: Array, n: int) -> tuple[Array, Array]:
    """Return the velocity in the body (3,) and its Jacobian (3, n)."""
    R = rotation(nav)
    v = R.T @ nav[3:6]
    H = np.zeros((3, n))
    for i in range(3):
        for k in range(3):
            H[i, 3 + k] = R[k, i]
    H[0, 7], H[0, 8] = -v[2], v[1]
    H[1, 6], H[1, 8] = v[2], -v[0]
    H[2, 6], H[2, 7] = -v[1], v[0]
    return v, H


@njit(cache=True)
def wheel(
    nav: Array, aux: Array, P: Array, speed: float, gained: float, R: float, gate: float
) -> float:
    """
    Update with an odometer's speed [m/s], in place; return its NIS, above ``gate`` unused.

    ``gained`` is what the train has gained since the speed was measured [m/s].
    """
    v, H = _body_velocity(nav, P.shape[0])
    stretch = 1.0 + aux[SCALE - 9]
    h = H[0]
    h[SCALE] = speed / stretch**2
    nu = speed / stretch + gained - v[0]
    S = R + h @ P @ h
    nis = nu * nu / S
    if nis <= gate:
        dx = np.zeros(P.shape[0])
        update(P, h, R, nu, dx)
        give(nav, aux, dx)
    return nis


@njit(cache=True)
def rails(nav: Array, aux: Array, P: Array, R: float, w: Array, lever: float) -> None:
    """
    Tell that the car moves neither sideways nor off its rails, variance ``R``, in place.

    That holds ``lever`` [m] behind the IMU, which turns at ``w`` (3,) as its gyros show [rad/s].
    """
    v, H = _body_velocity(nav, P.shape[0])
    v[1] -= lever * (w[2] - aux[2])
    v[2] += lever * (w[1] - aux[1])
    dx = np.zeros(P.shape[0])
    H[1, YAW], H[2, PITCH] = -v[0], v[0]
    H[1, 11], H[2, 10] = lever, -lever
    update(P, H[1], R, aux[YAW - 9] * v[0] - v[1], dx)
    update(P, H[2], R, -aux[PITCH - 9] * v[0] - v[2], dx)
    give(nav, aux, dx)


@njit(cache=True)
def stand(nav: Array, aux: Array, P: Array, w_mean: Array, R_v: float, R_w: float) -> None:
    """Tell that the train stands: no velocity, and the gyros show the Earth alone; in place."""
    n = P.shape[0]
    dx, h, turning = np.zeros(n), np.zeros(n), np.empty(3)
    earth_rate(nav[0], turning)
    seen = rotation(nav).T @ turning
    for k in range(3):
        h[:] = 0.0
        h[3 + k] = 1.0
        update(P, h, R_v, -nav[3 + k], dx)
    for k in range(3):
        h[:] = 0.0
        h[9 + k] = 1.0
        update(P, h, R_w, w_mean[k] - aux[k] - seen[k], dx)
    give(nav, aux, dx)

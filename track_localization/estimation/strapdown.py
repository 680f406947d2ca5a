"""
Strapdown inertial navigation in a local level frame: levelling, rest, attitude, dead reckoning.

A ride lasts minutes, so the frame is flat and does not turn; gravity is a constant vector.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from track_localization import GRAVITY
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.so3 import exp_one, normalised_one, product_one, turned_one

Array = NDArray[np.float64]

REST_FORCE_STD = 0.15
"""Standard deviation of the specific force over a window, per axis, below which it may rest."""
REST_RATE_STD = 0.015
"""The same for the angular rate [rad/s]."""


def level(specific_force: Array, yaw: float = 0.0) -> Array:
    """
    Return ``R_nb`` (3, 3) of a body at rest: its mean specific force (3,) points up.

    Roll and pitch come from the force, ``yaw`` [rad] from elsewhere: it is the heading of the
    body's x axis. Raise ValueError for a force of no length.
    """
    norm = float(np.linalg.norm(specific_force))
    if not np.isfinite(norm) or norm < 1e-6:
        raise ValueError('a specific force of no length has no direction')
    up = specific_force / norm
    forward = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.99 else np.array([0.0, 0.0, -up[0]])
    forward = forward - up * (forward @ up)
    forward /= np.linalg.norm(forward)
    level_axes = np.stack([forward, np.cross(up, forward), up])
    c, s = np.cos(yaw), np.sin(yaw)
    R: Array = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level_axes
    return R


def find_rest(imu: ImuSeries, window_s: float = 1.0) -> list[tuple[int, int]]:
    """
    Return the index intervals [start, stop) in which the sensor stands still, in order.

    Still means: over every window of ``window_s`` inside the interval, force and rate vary less
    than ``REST_FORCE_STD`` and ``REST_RATE_STD``, the rate's mean is small and the force's mean
    stays where the interval began (a smooth chain lift shakes as little as a station).
    """
    n = len(imu)
    if n < 3 or not np.isfinite(imu.rate_hz):
        return []
    size = max(3, min(n, round(window_s * imu.rate_hz)))
    still = _quiet(imu.specific_force, size, REST_FORCE_STD)
    mean_force = uniform_filter1d(imu.specific_force, size, axis=0, mode='nearest')
    if imu.has_gyro:
        still &= _quiet(imu.angular_rate, size, REST_RATE_STD)
        mean_rate = uniform_filter1d(imu.angular_rate, size, axis=0, mode='nearest')
        still &= np.linalg.norm(mean_rate, axis=1) < 0.05
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    intervals = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        reference = mean_force[start + min(size // 2, stop - start - 1)]
        away = np.abs(mean_force[start:stop] - reference).max(axis=1) > 0.1
        stop = start + int(np.argmax(away)) if away.any() else stop
        if stop - start >= size // 2:
            intervals.append((int(start), int(stop)))
    return intervals


def _quiet(values: Array, size: int, limit: float) -> NDArray[np.bool_]:
    """Return where the standard deviation over a centred window stays below ``limit``."""
    mean = uniform_filter1d(values, size, axis=0, mode='nearest')
    square = uniform_filter1d(values * values, size, axis=0, mode='nearest')
    quiet: NDArray[np.bool_] = (square - mean * mean).max(axis=1) < limit * limit
    return quiet


def integrate_attitude(imu: ImuSeries, R0: Array, gyro_bias: Array) -> Array:
    """
    Return ``R_nb`` (N, 3, 3) at every sample from the angular rate, trapezoidal rule.

    ``R0`` is the attitude at the first sample, ``gyro_bias`` (3,) [rad/s] is subtracted.
    """
    return _integrate_attitude(
        imu.time_s, np.ascontiguousarray(imu.angular_rate), np.ascontiguousarray(R0), gyro_bias
    )


@numba.njit(cache=True)
def _integrate_attitude(time: Array, rate: Array, R0: Array, bias: Array) -> Array:
    out = np.empty((len(time), 3, 3))
    R = R0.copy()
    out[0] = R
    for k in range(1, len(time)):
        half = 0.5 * (rate[k - 1] + rate[k]) - bias
        R = normalised_one(R @ exp_one(half * (time[k] - time[k - 1])))
        out[k] = R
    return out


@numba.njit(cache=True)
def dead_reckon_one(
    p: Array, v: Array, R: Array, f: Array, w: Array, g: Array, dt: float
) -> tuple[Array, Array, Array]:
    """
    Advance position, velocity and attitude by ``dt`` under constant force and rate.

    ``f`` and ``w`` are the bias-free means over the interval (paper 1, eq. 17, with the attitude
    taken at the interval's middle, which makes the rule second order). ``g`` (3,) points down.
    """
    p_new, v_new, R_new = np.empty(3), np.empty(3), np.empty((3, 3))
    half_turn = exp_one(w * (0.5 * dt))
    reckon_into(p, v, product_one(R, half_turn), half_turn, f, g, dt, p_new, v_new, R_new)
    return p_new, v_new, R_new


@numba.njit(cache=True)
def reckon_into(
    p: Array,
    v: Array,
    R_mid: Array,
    half_turn: Array,
    f: Array,
    g: Array,
    dt: float,
    p_new: Array,
    v_new: Array,
    R_new: Array,
) -> None:
    """Write what ``dead_reckon_one`` returns, from the interval's middle and half its turn."""
    a = turned_one(R_mid, f)
    for i in range(3):
        dv = (a[i] + g[i]) * dt
        p_new[i] = p[i] + (v[i] + 0.5 * dv) * dt
        v_new[i] = v[i] + dv
    R_new[:] = normalised_one(product_one(R_mid, half_turn))


def gravity_vector(magnitude: float = GRAVITY) -> Array:
    """Return gravity (3,) in ``map`` [m/s^2]: down."""
    return np.array([0.0, 0.0, -magnitude])

"""What an IMU makes of true motion: bias, walk, scale, noise, clipping, its mount, its clock."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.estimation import so3
from track_localization.settings import setting

Array = NDArray[np.float64]

MOUNTS = ('gauss', 'angle', 'any')


@dataclasses.dataclass(frozen=True)
class ImuErrors:
    """Errors of an IMU; N(0, s) means drawn once per run and axis."""

    rate_hz: float = setting(100.0, 'Hz', 'sampling rate', 5.0, 2000.0)
    accel_bias: float = setting(0.04, 'm/s^2', 'bias, N(0, this)', 0.0, 5.0)
    accel_walk: float = setting(0.002, 'm/s^2/sqrt(s)', 'bias random walk', 0.0, 1.0)
    accel_scale: float = setting(0.004, '', 'scale factor error, N(0, this)', 0.0, 0.5)
    accel_noise: float = setting(0.012, 'm/s^2', 'white noise per sample', 0.0, 5.0)
    gyro_bias: float = setting(0.004, 'rad/s', 'bias, N(0, this)', 0.0, 1.0)
    gyro_walk: float = setting(1e-4, 'rad/s/sqrt(s)', 'bias random walk', 0.0, 0.1)
    gyro_scale: float = setting(0.003, '', 'scale factor error, N(0, this)', 0.0, 0.5)
    gyro_noise: float = setting(0.0012, 'rad/s', 'white noise per sample', 0.0, 1.0)
    clip_g: float = setting(0.0, 'g', 'range of the accelerometer; 0 does not clip', 0.0, 100.0)
    clip_dps: float = setting(0.0, 'deg/s', 'range of the gyro; 0 does not clip', 0.0, 1e4)
    jitter_s: float = setting(0.0005, 's', 'jitter of the stamps, N(0, this)', 0.0, 0.1)
    mount: str = setting('gauss', '', 'how the mount is drawn', choices=MOUNTS)
    mount_sigma_deg: float = setting(2.5, 'deg', 'gauss: N(0, this) about each axis', 0.0, 60.0)
    mount_angle_deg: float = setting(0.0, 'deg', 'angle: by this about a random axis', 0.0, 180.0)


def draw_mount(rng: Generator, errors: ImuErrors) -> Array:
    """Return R_bm (3, 3), sensor to body: small angles, a fixed angle or any, by ``mount``."""
    if errors.mount == 'gauss':
        return so3.exp(np.radians(errors.mount_sigma_deg) * rng.standard_normal(3))
    if errors.mount == 'angle':
        axis = rng.standard_normal(3)
        return so3.exp(np.radians(errors.mount_angle_deg) * axis / np.linalg.norm(axis))
    return so3.matrix_from_quat(rng.standard_normal(4))


def corrupt(
    rng: Generator, specific_force: Array, angular_rate: Array, errors: ImuErrors
) -> tuple[Array, Array]:
    """
    Return what the sensor reports for the true motion in its own axes, (N, 3) each.

    ``specific_force`` and ``angular_rate`` hold vibration already.
    """
    e = errors
    force = _one(rng, specific_force, e.accel_bias, e.accel_walk, e.accel_scale, e.accel_noise, e)
    rate = _one(rng, angular_rate, e.gyro_bias, e.gyro_walk, e.gyro_scale, e.gyro_noise, e)
    if e.clip_g > 0.0:
        force = np.clip(force, -e.clip_g * GRAVITY, e.clip_g * GRAVITY)
    if e.clip_dps > 0.0:
        rate = np.clip(rate, -np.radians(e.clip_dps), np.radians(e.clip_dps))
    return force, rate


def _one(
    rng: Generator, true: Array, bias: float, walk: float, scale: float, noise: float, e: ImuErrors
) -> Array:
    steps = walk / np.sqrt(e.rate_hz) * rng.standard_normal(true.shape)
    drift = bias * rng.standard_normal(3) + np.cumsum(steps, axis=0)
    factor = 1.0 + scale * rng.standard_normal(3)
    return np.asarray(factor * true + drift + noise * rng.standard_normal(true.shape))


def jitter(rng: Generator, time_s: Array, sigma: float) -> Array:
    """Return stamps (N,) with white jitter, kept strictly increasing (0.45 steps at most)."""
    if len(time_s) < 2:
        return time_s
    most = 0.45 * float(np.diff(time_s).min())
    return np.asarray(time_s + np.clip(sigma * rng.standard_normal(len(time_s)), -most, most))

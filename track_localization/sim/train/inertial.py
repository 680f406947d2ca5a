"""What an IMU of a grade makes of ideal specific force and angular rate."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.train import noise
from track_localization.sim.train.config import AS_GRADE, ImuErrors, Start
from track_localization.sim.train.grades import DPH, GRADES, MG, ROOT_HOUR

Array = NDArray[np.float64]


class Figures(NamedTuple):
    """Errors in SI: constant bias, wandering part of it, white noise density."""

    bias: float
    wander: float
    density: float


def figures_of(config: ImuErrors) -> tuple[Figures, Figures]:
    """Return the figures of accelerometer [m/s^2] and gyro [rad/s], the grade's where not set."""
    accel = Figures(
        MG * _of(config, 'accel_bias_mg'),
        MG * _of(config, 'accel_in_run_mg'),
        _of(config, 'velocity_walk') / ROOT_HOUR,
    )
    gyro = Figures(
        DPH * _of(config, 'gyro_bias_dph'),
        DPH * _of(config, 'gyro_in_run_dph'),
        np.radians(_of(config, 'angle_walk')) / ROOT_HOUR,
    )
    return accel, gyro


def start_sigmas(start: Start, imu: ImuErrors) -> tuple[float, float]:
    """Return sigma of roll and pitch, and of yaw, of an aligned start [rad]."""
    grade = GRADES[imu.grade]
    level = grade.level_deg if start.level_deg == AS_GRADE else start.level_deg
    yaw = grade.yaw_deg if start.yaw_deg == AS_GRADE else start.yaw_deg
    return float(np.radians(max(level, 0.0))), float(np.radians(max(yaw, 0.0)))


def corrupt(
    rng: Generator, config: ImuErrors, specific_force: Array, angular_rate: Array
) -> tuple[Array, Array, dict[str, Any]]:
    """Return what the sensor tells, (N, 3) each, and its constant biases."""
    accel, gyro = figures_of(config)
    f, accel_bias = _one(rng, config, accel, specific_force)
    w, gyro_bias = _one(rng, config, gyro, angular_rate)
    return f, w, {'accel_bias': accel_bias.tolist(), 'gyro_bias': gyro_bias.tolist()}


def _one(rng: Generator, config: ImuErrors, e: Figures, true: Array) -> tuple[Array, Array]:
    """Return a sensor's samples, and its constant bias (3,)."""
    n = len(true)
    bias = e.bias * rng.standard_normal(3)
    wander = e.wander * noise.correlated(rng, n, config.in_run_s * config.rate_hz, 3)
    white = e.density * np.sqrt(config.rate_hz) * rng.standard_normal((n, 3))
    return np.asarray(true + bias + wander + white), bias


def _of(config: ImuErrors, name: str) -> float:
    value = float(getattr(config, name))
    return float(getattr(GRADES[config.grade], name)) if value < 0.0 else value

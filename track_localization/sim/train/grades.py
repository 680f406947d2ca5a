"""Grades of inertial measurement units: what each costs in accuracy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from track_localization import GRAVITY

DPH = np.radians(1.0) / 3600.0
"""One degree per hour [rad/s]."""

MG = 1e-3 * GRAVITY
"""A thousandth of standard gravity [m/s^2]."""

ROOT_HOUR = 60.0
"""Square root of an hour [sqrt(s)]."""


class Grade(NamedTuple):
    """
    Errors of a grade; N(0, this) drawn once per run and axis unless said otherwise.

    Attributes:
        gyro_bias_dph: [deg/h].
        angle_walk: white noise of the gyro [deg/sqrt(h)].
        accel_bias_mg: [mg].
        velocity_walk: white noise of the accelerometer [m/s/sqrt(h)].
        level_deg: roll and pitch of an aligned start [deg].
        yaw_deg: yaw of an aligned start [deg].
        gyro_in_run_dph: rms of the part of the bias that wanders [deg/h].
        accel_in_run_mg: the accelerometer's [mg].
    """

    gyro_bias_dph: float
    angle_walk: float
    accel_bias_mg: float
    velocity_walk: float
    level_deg: float
    yaw_deg: float
    gyro_in_run_dph: float
    accel_in_run_mg: float


GRADES = {
    'navigation': Grade(0.01, 0.003, 0.05, 0.01, 0.01, 0.05, 0.005, 0.02),
    'tactical': Grade(0.5, 0.05, 0.3, 0.03, 0.05, 0.3, 0.3, 0.05),
    'industrial': Grade(5.0, 0.2, 1.0, 0.06, 0.1, 0.6, 2.0, 0.1),
    'mems': Grade(50.0, 0.5, 3.0, 0.15, 0.3, 1.5, 10.0, 0.3),
}
"""By name, best first."""

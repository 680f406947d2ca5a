"""Whether a measurement can be used at all."""

from __future__ import annotations

import math

import numpy as np

from track_localization.estimation.imu import ImuSample
from train_localization.measurements import GnssFix, GnssQuality, Measurement, WheelSpeed

MAX_FORCE, MAX_RATE, MAX_SPEED_MPS = 200.0, 20.0, 300.0
"""Beyond any train [m/s^2], [rad/s], [m/s]."""
MAX_HEIGHT_M = 2e4


def problem(measurement: Measurement) -> str | None:
    """Return why a measurement's numbers cannot be used, or None."""
    if not math.isfinite(measurement.time_s):
        return 'not_finite'
    if isinstance(measurement, ImuSample):
        fx, fy, fz = measurement.specific_force.tolist()
        wx, wy, wz = measurement.angular_rate.tolist()
        if not math.isfinite(fx + fy + fz + wx + wy + wz):
            return 'not_finite'
        far = max(abs(fx), abs(fy), abs(fz)) > MAX_FORCE
        return 'implausible' if far or max(abs(wx), abs(wy), abs(wz)) > MAX_RATE else None
    if isinstance(measurement, WheelSpeed):
        if not math.isfinite(measurement.speed):
            return 'not_finite'
        if not 0.0 <= measurement.variance < math.inf:
            return 'bad_variance'
        return 'implausible' if abs(measurement.speed) > MAX_SPEED_MPS else None
    if isinstance(measurement, GnssQuality):
        return 'not_finite' if math.isinf(measurement.hdop) else None
    return _fix_problem(measurement)


def _fix_problem(fix: GnssFix) -> str | None:
    if not fix.valid:
        return 'no_fix'
    if not np.isfinite([fix.latitude, fix.longitude, fix.height]).all():
        return 'not_finite'
    if abs(fix.latitude) > 0.5 * math.pi or abs(fix.longitude) > 2.0 * math.pi:
        return 'implausible'
    if abs(fix.height) > MAX_HEIGHT_M:
        return 'implausible'
    if np.isinf(fix.covariance).any() or (np.diag(fix.covariance) < 0.0).any():
        return 'bad_variance'
    return None

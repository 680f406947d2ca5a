"""What the train's sensors tell, besides ``ImuSample``; times are header stamps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.imu import ImuSample

Array = NDArray[np.float64]


class GnssFix(NamedTuple):
    """
    A position fix.

    Attributes:
        time_s: stamp [s].
        latitude: geodetic, WGS 84 [rad].
        longitude: [rad].
        height: above the ellipsoid [m].
        covariance: (3, 3) east, north, up [m^2].
        valid: whether the receiver says that it has a fix.
    """

    time_s: float
    latitude: float
    longitude: float
    height: float
    covariance: Array
    valid: bool = True


class GnssQuality(NamedTuple):
    """
    How good the constellation is.

    Attributes:
        time_s: stamp, that of the fix it belongs to [s].
        satellites: in use.
        hdop: horizontal dilution of precision; NaN where it is not told.
    """

    time_s: float
    satellites: int
    hdop: float


class WheelSpeed(NamedTuple):
    """
    Speed from the odometer, positive forward.

    Attributes:
        time_s: stamp [s].
        speed: mean over the interval since the one before [m/s].
        variance: claimed by the sender [m^2/s^2]; 0 where it does not tell.
    """

    time_s: float
    speed: float
    variance: float


Measurement = ImuSample | GnssFix | GnssQuality | WheelSpeed

IMU, GNSS, QUALITY, WHEEL = 'imu', 'gnss', 'quality', 'wheel'
"""Sensors by name, as counts and diagnostics call them."""


def sensor_of(measurement: Measurement) -> str:
    """Return the name of the sensor that a measurement comes from."""
    if isinstance(measurement, ImuSample):
        return IMU
    if isinstance(measurement, GnssFix):
        return GNSS
    return QUALITY if isinstance(measurement, GnssQuality) else WHEEL

"""
Between a receiver's messages and numbers; the reasons are those of ``convert``, and:

- ``no_satellites``: what is told of a fix does not say how many satellites it used.
"""

from __future__ import annotations

import math

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from sensor_msgs.msg import NavSatFix

from track_localization.io.gnss import fix_row, quality_row
from track_localization.ros import convert

Array = NDArray[np.float64]


def fix(msg: NavSatFix, frame: str) -> tuple[float, float, float, Array, bool] | str:
    """
    Return latitude, longitude [rad], height [m], covariance (3, 3) [m^2], whether there is a fix.

    Or the reason why the message cannot be used. The covariance is NaN where it is not told; what
    a receiver without a fix repeats is not judged.
    """
    problem = convert.header_problem(msg.header, frame)
    if problem is not None:
        return problem
    row = fix_row(msg)
    place = math.radians(row[0]), math.radians(row[1]), row[2]
    covariance = np.array(row[3:12]).reshape(3, 3)
    if row[12] < 0.5:
        return (*place, np.full((3, 3), np.nan), False)
    if not (abs(row[0]) <= 90.0 and abs(row[1]) <= 360.0 and abs(row[2]) < convert.MAX_POSITION):
        return convert.why_not(row[:3])
    if msg.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN or not covariance.any():
        return (*place, np.full((3, 3), np.nan), True)
    return convert.covariance_problem(covariance) or (*place, covariance, True)


def fix_quality(msg: DiagnosticArray) -> tuple[int, float] | str:
    """Return satellites in use and HDOP (NaN where not told), or the reason why not."""
    problem = convert.header_problem(msg.header, '')
    if problem is not None:
        return problem
    satellites, hdop = quality_row(msg)
    return 'no_satellites' if satellites < 0.0 else (int(satellites), hdop)


def fill_fix(msg: NavSatFix, time_s: float, geodetic: Array, covariance: Array) -> None:
    """
    Write a place into ``msg``; its frame stays.

    ``geodetic`` (3,) is latitude, longitude [rad], height [m]; ``covariance`` (3, 3) of east,
    north, up [m^2].
    """
    convert.set_stamp(msg.header.stamp, time_s)
    msg.latitude, msg.longitude = math.degrees(geodetic[0]), math.degrees(geodetic[1])
    msg.altitude = float(geodetic[2])
    msg.position_covariance = covariance.ravel()
    msg.position_covariance_type = NavSatFix.COVARIANCE_TYPE_KNOWN

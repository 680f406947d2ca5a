"""Whether a measurement can be used at all."""

from __future__ import annotations

import math

from maglev_localization.measurements import BalisePassing, LoopPosition, Measurement

MAX_READING_M, MAX_SPEED_MPS, MAX_VARIANCE = 1e7, 300.0, 1e8
"""Beyond any line, any train, any doubt."""
LEAST_VARIANCE = 1e-8
"""No sensor is surer, 0.1 mm or 0.1 mm/s; less would be lost in rounding."""


def problem(measurement: Measurement) -> str | None:
    """Return why a measurement's numbers cannot be used, or None."""
    if isinstance(measurement, LoopPosition):
        value, most = measurement.reading, MAX_READING_M
    elif isinstance(measurement, BalisePassing):
        value, most = measurement.offset, MAX_READING_M
    else:
        value, most = measurement.speed, MAX_SPEED_MPS
    if not (math.isfinite(value) and math.isfinite(measurement.time_s)):
        return 'not_finite'
    if not 0.0 < measurement.variance < MAX_VARIANCE:
        return 'bad_variance'
    return None if abs(value) < most else 'implausible'


def believed(measurement: Measurement) -> Measurement:
    """Return the measurement, no surer than any sensor is."""
    if measurement.variance >= LEAST_VARIANCE:
        return measurement
    return measurement._replace(variance=LEAST_VARIANCE)

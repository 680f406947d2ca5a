"""Whether a measurement can be used at all: its numbers and its stamp."""

from __future__ import annotations

import math

from maglev_localization.measurements import BalisePassing, LoopPosition, Measurement

LONG_GAP_S = 30.0
"""A stamp so far ahead must be confirmed by the next [s]."""
CONFIRMED_WITHIN_S = 1.0
MAX_READING_M, MAX_SPEED_MPS, MAX_VARIANCE = 1e7, 300.0, 1e8
"""Beyond any line, any train, any doubt."""


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


class Stamps:
    """
    Judges stamps in order of arrival.

    Attributes:
        gap_s: time that the measurement judged last left out, where that was a long gap; else 0.
    """

    def __init__(self, horizon_s: float) -> None:
        self._horizon_s = horizon_s
        self._latest: dict[str, float] = {}
        self._ahead_s = math.nan
        self.gap_s = 0.0

    def refuse(self, sensor: str, time_s: float) -> str | None:
        """Return why a stamp cannot be used, or None, and then keep it in mind."""
        self.gap_s = 0.0
        if self._latest.get(sensor) == time_s:
            return 'repeated_time'
        newest = max(self._latest.values(), default=time_s)
        if time_s - newest > LONG_GAP_S:
            if not abs(time_s - self._ahead_s) < CONFIRMED_WITHIN_S:
                self._ahead_s = time_s
                return 'time_jump'
            self.gap_s = time_s - newest
            self._latest.clear()
        elif time_s < newest - self._horizon_s:
            return 'too_late'
        self._latest[sensor] = max(time_s, self._latest.get(sensor, time_s))
        return None

"""Judging the stamps of measurements in order of arrival, before any filter sees them."""

from __future__ import annotations

import math

LONG_GAP_S = 30.0
"""A stamp so far ahead must be confirmed by the next [s]."""
CONFIRMED_WITHIN_S = 1.0


class Stamps:
    """
    Refuses what repeats, comes too late, or jumps ahead alone.

    Attributes:
        gap_s: time that the measurement judged last left out, where that was a long gap; else 0.
    """

    def __init__(self, horizon_s: float, ordered: tuple[str, ...] = ()) -> None:
        """
        Make it.

        Args:
            horizon_s: how far behind the newest a stamp may be [s].
            ordered: sensors whose stamps must not go back at all.
        """
        self._horizon_s, self._ordered = horizon_s, ordered
        self._latest: dict[str, float] = {}
        self._ahead_s = math.nan
        self.gap_s = 0.0

    def refuse(self, sensor: str, time_s: float) -> str | None:
        """Return why a stamp cannot be used, or None, and then keep it in mind."""
        self.gap_s = 0.0
        own = self._latest.get(sensor, -math.inf)
        if own == time_s:
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
        elif sensor in self._ordered and time_s < own:
            return 'backward_time'
        self._latest[sensor] = max(time_s, self._latest.get(sensor, time_s))
        return None

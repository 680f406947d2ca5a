"""Judging the stamps of measurements in order of arrival, before any filter sees them."""

from __future__ import annotations

import math

LONG_GAP_S = 30.0
"""What happened in a time so long is told to the filter [s]."""
CONFIRMED_WITHIN_S = 2.5
"""Stamps nearer than that go on from each other [s]."""


class Stamps:
    """
    Refuses what repeats, comes too late, or jumps ahead alone.

    Attributes:
        gap_s: time that the measurement judged last left out, where that was a long gap; else 0.
        restarted: whether time began anew, earlier, with the measurement judged last.
    """

    def __init__(
        self,
        horizon_s: float,
        ordered: tuple[str, ...] = (),
        jump_s: float = LONG_GAP_S,
        restart_s: float = math.inf,
    ) -> None:
        """
        Make it.

        Args:
            horizon_s: how far behind the newest a stamp may be [s].
            ordered: sensors whose stamps must not go back at all.
            jump_s: a stamp so far ahead must be confirmed by the next [s].
            restart_s: when nothing but stamps too late has come for so long, from two sensors at
                least, a recording has started over, or the newest stamp was wrong [s].
        """
        self._horizon_s, self._ordered = horizon_s, ordered
        self._jump_s, self._restart_s = jump_s, restart_s
        self.gap_s, self.restarted = 0.0, False
        self._begin()

    def _begin(self) -> None:
        self._latest: dict[str, float] = {}
        self._recent: dict[str, dict[float, None]] = {}
        self._ahead_s = math.nan
        self._behind: dict[str, float] = {}
        self._behind_from_s = math.nan

    def refuse(self, sensor: str, time_s: float) -> str | None:
        """Return why a stamp cannot be used, or None, and then keep it in mind."""
        self.gap_s, self.restarted = 0.0, False
        if time_s in self._recent.get(sensor, ()):
            return 'repeated_time'
        newest = max(self._latest.values(), default=time_s)
        if time_s - newest > self._jump_s:
            if not abs(time_s - self._ahead_s) < CONFIRMED_WITHIN_S:
                self._ahead_s = time_s
                return 'time_jump'
            self.gap_s = time_s - newest if time_s - newest > LONG_GAP_S else 0.0
            self._latest.clear()
        elif time_s < newest - self._horizon_s:
            if not self._starts_over(sensor, time_s):
                return 'too_late'
            self._begin()
            self.restarted = True
        elif sensor in self._ordered and time_s < self._latest.get(sensor, -math.inf):
            return 'backward_time'
        self._remember(sensor, time_s)
        return None

    def _starts_over(self, sensor: str, time_s: float) -> bool:
        """Whether stamps too late have gone on from each other for long enough."""
        last = max(self._behind.values(), default=math.nan)
        if not abs(time_s - last) < CONFIRMED_WITHIN_S:
            self._behind, self._behind_from_s = {}, time_s
        self._behind[sensor] = time_s
        return len(self._behind) > 1 and time_s - self._behind_from_s >= self._restart_s

    def _remember(self, sensor: str, time_s: float) -> None:
        self._behind.clear()
        self._latest[sensor] = max(time_s, self._latest.get(sensor, time_s))
        recent = self._recent.setdefault(sensor, {})
        recent[time_s] = None
        while next(iter(recent)) < self._latest[sensor] - self._horizon_s:
            del recent[next(iter(recent))]

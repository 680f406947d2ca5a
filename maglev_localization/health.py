"""Whether each sensor of a train is to be believed, told from what became of its readings."""

from __future__ import annotations

import math

from maglev_localization.counting import ALIVE_S
from maglev_localization.measurements import BALISE, LOOP, RADAR

WAITING, FINE, SILENT, ISOLATED = 'waiting', 'ok', 'silent', 'isolated'

SILENT_AFTER, MOST_USUAL_S = 3.0, 10.0
"""A sensor slower than ``ALIVE_S`` is silent after so many of its usual intervals, which are no
longer than that [s]."""
MEMORY_S = 1.0
"""Over so long the share of refused readings is taken [s]."""
MOST_REFUSED, FEW_REFUSED = 0.5, 0.1
"""A sensor is isolated when more are refused, and believed again when less are."""
BLIND_M = 5.0
"""A loop whose count stands while the train goes further is not counting [m]."""


class SensorHealth:
    """
    States of the loop, the radar and the balise reader, and when they changed.

    Attributes:
        states: sensor -> state.
        changes: (stamp [s], sensor, new state), oldest first.
        nis: sensor -> mean normalised innovation squared of late.
    """

    def __init__(self) -> None:
        self.states = dict.fromkeys((LOOP, RADAR, BALISE), WAITING)
        self.changes: list[tuple[float, str, str]] = []
        self.nis = dict.fromkeys(self.states, math.nan)
        self._heard = dict.fromkeys(self.states, -math.inf)
        self._refused = dict.fromkeys(self.states, 0.0)
        self._usual = dict.fromkeys(self.states, 0.0)

    def heard(self, sensor: str, time_s: float, refused: bool, nis: float) -> None:
        """Note a reading, whether it was refused, and its NIS (NaN when it has none)."""
        elapsed = max(time_s - self._heard[sensor], 0.0)
        if 0.0 < elapsed < MOST_USUAL_S:
            self._usual[sensor] += 0.1 * (elapsed - self._usual[sensor])
        elapsed = min(elapsed, MEMORY_S)
        keep = math.exp(-elapsed / MEMORY_S)
        self._refused[sensor] = keep * self._refused[sensor] + (1.0 - keep) * refused
        self._heard[sensor] = max(time_s, self._heard[sensor])
        if math.isfinite(nis):
            before = self.nis[sensor]
            self.nis[sensor] = nis if math.isnan(before) else before + 0.05 * (nis - before)

    def judge(self, time_s: float, unseen_m: float) -> None:
        """Set the states at ``time_s``; ``unseen_m``: travelled while the loop's count stood."""
        for sensor, state in self.states.items():
            now = self._state(sensor, state, time_s)
            if sensor == LOOP and now == FINE and unseen_m > BLIND_M:
                now = ISOLATED
            if now != state:
                self.states[sensor] = now
                self.changes.append((time_s, sensor, now))

    def _state(self, sensor: str, state: str, time_s: float) -> str:
        if self._heard[sensor] == -math.inf:
            return WAITING
        if sensor == BALISE:
            return FINE
        if time_s - self._heard[sensor] > max(ALIVE_S, SILENT_AFTER * self._usual[sensor]):
            return SILENT
        limit = FEW_REFUSED if state == ISOLATED else MOST_REFUSED
        return ISOLATED if self._refused[sensor] > limit else FINE

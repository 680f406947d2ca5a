"""Where the paper's filter starts: it takes a place, and a speed to go with it."""

from __future__ import annotations

from typing import NamedTuple

from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import BalisePassing, LoopPosition, Measurement

RADAR_WAIT_S = 1.0
"""How long a place waits for the radar to tell the speed; how old a speed may be [s]."""


class Begin(NamedTuple):
    """
    A start, complete.

    Attributes:
        time_s: when [s].
        chainage: where [m].
        variance: of the chainage [m^2].
        speed: how fast [m/s].
        set_counter: the loop's zero is not known, the place shall tell it.
    """

    time_s: float
    chainage: float
    variance: float
    speed: float
    set_counter: bool


class Start:
    """
    Gathers what it takes to start.

    The place is the first loop reading where ``motion.start_known``, else the first balise. The
    speed is the radar's; without one within a second it is the loop's own, over that second.
    """

    def __init__(self, config: MaglevConfig) -> None:
        self._known = config.motion.start_known
        self._variance = config.motion.start_sigma_m**2
        self._first_loop: LoopPosition | None = None
        self._place: Begin | None = None
        self._speed: tuple[float, float] | None = None

    def take_balise(self, measurement: BalisePassing, chainage: float) -> Begin | None:
        """Take a balise passed at ``chainage`` [m]; return the start if it is complete."""
        time_s = measurement.time_s
        self._place = Begin(time_s, chainage, self._variance, 0.0, set_counter=True)
        if self._speed is not None and time_s - self._speed[0] <= RADAR_WAIT_S:
            return self._place._replace(speed=self._speed[1])
        return None

    def take(self, measurement: Measurement) -> Begin | None:
        """Take a reading of loop or radar; return the start if it is complete."""
        if isinstance(measurement, LoopPosition):
            return self._take_loop(measurement)
        if isinstance(measurement, BalisePassing):
            return None
        time_s, speed = measurement.time_s, measurement.speed
        self._speed = (time_s, speed)
        if self._place is None:
            return None
        moved = self._place.chainage + speed * (time_s - self._place.time_s)
        return self._place._replace(time_s=time_s, chainage=moved, speed=speed)

    def _take_loop(self, measurement: LoopPosition) -> Begin | None:
        time_s, reading = measurement.time_s, measurement.reading
        first = self._first_loop = self._first_loop or measurement
        since = time_s - first.time_s
        if self._place is not None and self._place.set_counter:
            return None
        if not self._known:
            return None
        self._place = Begin(time_s, reading, self._variance, 0.0, set_counter=False)
        if since < RADAR_WAIT_S:
            return None
        return self._place._replace(speed=(reading - first.reading) / since)

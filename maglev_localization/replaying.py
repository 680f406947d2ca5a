"""``robust`` and ``kalman`` on a history: late data goes where it belongs, what came after anew."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np

from maglev_localization import bank, hearing
from maglev_localization.config import MaglevConfig
from maglev_localization.counting import ALIVE_S, Counting
from maglev_localization.estimate import Estimate
from maglev_localization.health import SensorHealth
from maglev_localization.kalman_filter import KalmanFilter
from maglev_localization.measurements import (
    BALISE,
    LOOP,
    RADAR,
    BalisePassing,
    LoopPosition,
    Measurement,
    sensor_of,
)
from maglev_localization.robust_filter import CYCLE_S, Bank, RobustFilter
from track_localization.estimation.gating import Rejections
from track_localization.estimation.history import History, TooLateError
from track_localization.track.balise_table import BaliseTable

RANK = {BALISE: 0, LOOP: 1, RADAR: 2}
"""Order of measurements with the same stamp: fusion comes with the radar's."""
START_WITHIN_S = 2.0
"""So long a start waits for the first loop reading [s]."""
SPEED_MARGIN_MPS = 10.0
"""A train may have gone so much faster than it was known to in a gap."""

SPEED_UNKNOWN_MPS = 10.0
"""Nothing is given out while the speed is not even known to this: a filter's first readings."""

REFUSED = {hearing.IGNORED: 'gate', hearing.NEARBY: 'wrong_id'}
EVENTS = {
    hearing.SHIFT: 'miscounts',
    hearing.UNKNOWN: 'jumps',
    hearing.SLIP: 'slips',
    hearing.MOVED: 'moves',
}

Heard = tuple[Measurement, float]


class ReplayingCore:
    """
    A filter, its history and its start.

    Attributes:
        rejections: refused measurements by sensor and reason.
        health: of the sensors.
        events: what the sensors seem to have done, counted.
    """

    def __init__(self, config: MaglevConfig, balises: BaliseTable, length: float) -> None:
        self._config, self._balises, self._length = config, balises, length
        make: Any = RobustFilter if config.method == 'robust' else KalmanFilter
        self._filter = make(config, balises, length)
        self.rejections, self.health = Rejections(), SensorHealth()
        self.events: Counter[str] = Counter()
        self._rng = np.random.default_rng(config.seed)
        self._history: History[Any, Heard] | None = None
        self._told: tuple[float, float] | None = None
        self._first_s = math.nan
        self._latest: Estimate | None = None
        self._published_s = -math.inf
        self._memory, self._unseen_m = Counting.begin(math.nan), 0.0

    def set_start(self, chainage: float, variance: float) -> None:
        """Start at the next measurement, from a chainage [m] and its variance [m^2]."""
        self._told, self._history = (chainage, variance), None

    def after_gap(self, gap_s: float) -> None:
        """
        Start again where the train was, with all that it may have travelled as doubt.

        Where nothing was given out yet there is nothing to go on from: then start anew.
        """
        if self._latest is None:
            self._history, self._first_s = None, math.nan
        else:
            speed = abs(self._latest.speed) + SPEED_MARGIN_MPS
            reach = min(speed * gap_s + self._latest.sigma_along, self._length)
            self.set_start(self._latest.chainage, reach**2)

    def take(self, measurement: Measurement) -> Estimate | None:
        """Take a measurement; return the estimate that it makes, if it makes one."""
        sensor, time_s = sensor_of(measurement), measurement.time_s
        if self._history is None:
            self._history = self._begin(measurement)
            if self._history is None:
                return None
        try:
            replayed = self._history.add(
                time_s, (measurement, float(self._rng.random())), RANK[sensor]
            )
        except TooLateError:
            self.rejections.add(sensor, 'too_late')
            return None
        if replayed:
            self.events[f'{sensor}.late'] += 1
        state = self._history.state_before(replayed)
        self._note(sensor, measurement, state)
        return None if time_s < self._published_s else self._publish(sensor, time_s, state)

    def figures(self) -> dict[str, float | str]:
        """Return what diagnostics should tell of the filter itself."""
        out: dict[str, float | str] = {}
        if self._history is not None and isinstance(self._history.state, Bank):
            state = self._history.state
            weight = np.exp(state.log_w)
            out['hypotheses'] = len(weight)
            out['n_eff'] = round(float(1.0 / np.sum(weight**2)), 2)
            out['elsewhere'] = round(bank.moments(state.log_w, state.x, state.P)[2], 4)
        return out | {f'events.{name}': float(n) for name, n in sorted(self.events.items())}

    @property
    def started(self) -> bool:
        """Whether the filter runs."""
        return self._history is not None

    def _begin(self, measurement: Measurement) -> History[Any, Heard] | None:
        """Return the history of a start at this measurement; None while it waits for the loop."""
        time_s = measurement.time_s
        anywhere = (0.5 * self._length, (0.5 * self._length) ** 2)
        if self._told is not None:
            place = self._told
        elif not self._config.motion.start_known:
            place = anywhere
        elif isinstance(measurement, LoopPosition):
            middle = measurement.reading + 0.5 * self._config.loop.pitch_m
            place = (middle, self._config.motion.start_sigma_m**2)
        else:
            self._first_s = time_s if math.isnan(self._first_s) else self._first_s
            if time_s - self._first_s < START_WITHIN_S:
                return None
            place = anywhere
        state = self._filter.start(time_s, *place)
        return History(self._filter.apply, state, time_s, self._config.horizon_s)

    def _note(self, sensor: str, measurement: Measurement, state: Any) -> None:
        """Count what became of a measurement; ``state`` is that just after it."""
        if isinstance(state, Bank):
            reason = REFUSED.get(state.says, '')
            if isinstance(measurement, BalisePassing):
                known = self._balises.index(measurement.balise) is not None
                reason = reason if known else 'unknown_id'
            if state.says in EVENTS:
                self.events[f'{sensor}.{EVENTS[state.says]}'] += 1
            refused = state.says in (hearing.IGNORED, hearing.SHIFT, hearing.UNKNOWN)
        else:
            reason = state.reason
            refused = reason == 'gate'
        if reason:
            self.rejections.add(sensor, reason)
        self.health.heard(sensor, measurement.time_s, refused, state.nis)

    def _publish(self, sensor: str, time_s: float, state: Any) -> Estimate | None:
        quiet = time_s - self._published_s > 2.0 * CYCLE_S
        if sensor == LOOP and not (quiet and state.fused_s == time_s):
            return None
        estimate: Estimate = self._filter.estimate(state)
        if estimate.sigma_speed > SPEED_UNKNOWN_MPS:
            return None
        self._watch_count(state.memory, abs(estimate.speed))
        self.health.judge(time_s, self._unseen_m)
        self._published_s, self._latest = estimate.time_s, estimate
        return estimate

    def _watch_count(self, memory: Counting, speed: float) -> None:
        """Add up how far the train went while readings came that repeat the count."""
        before, self._memory = self._memory, memory
        heard_s = memory.sampled_s - before.sampled_s
        if memory.changed_s != before.changed_s:
            self._unseen_m = 0.0
        elif heard_s > 0.0:
            self._unseen_m += speed * min(heard_s, ALIVE_S)

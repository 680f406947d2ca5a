"""The estimator as a plain object: measurements in as they arrive, estimates out."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np

from maglev_localization import bank
from maglev_localization.config import MaglevConfig
from maglev_localization.estimate import Estimate
from maglev_localization.health import ISOLATED, SILENT, SensorHealth
from maglev_localization.kalman_filter import KalmanFilter
from maglev_localization.measurements import (
    BALISE,
    LOOP,
    RADAR,
    BalisePassing,
    LoopPosition,
    Measurement,
    RadarSpeed,
    sensor_of,
)
from maglev_localization.robust_filter import CYCLE_S, Bank, RobustFilter
from track_localization.estimation.gating import Rejections
from track_localization.estimation.history import History, TooLateError
from track_localization.track.balise_table import BaliseTable

RANK = {BALISE: 0, LOOP: 1, RADAR: 2}
"""Order of measurements with the same stamp: fusion comes with the radar's."""
BEYOND_M = 1000.0
"""How far the line goes on behind the last balise, where its length is not told [m]."""
LONG_GAP_S = 30.0
"""A stamp so far ahead must be confirmed by the next; then the filter starts again there [s]."""
START_WITHIN_S = 2.0
"""So long a start waits for the first loop reading [s]."""
MAX_READING_M, MAX_SPEED_MPS, MAX_VARIANCE = 1e7, 300.0, 1e8
EXCUSES = {
    bank.IGNORED: 'gate',
    bank.NEARBY: 'wrong_id',
}
EVENTS = {bank.SHIFT: 'miscounts', bank.UNKNOWN: 'jumps', bank.SLIP: 'slips', bank.MOVED: 'moves'}


class FilterPipeline:
    """
    ``robust`` and ``kalman``: a filter on a history, so that late data goes where it belongs.

    Driven by stamps only. Nothing that is pushed can raise: what cannot be used is counted.

    Attributes:
        rejections: counts by sensor and reason.
        health: of the sensors.
        events: what the sensors seem to have done, by name, counted.
    """

    def __init__(
        self, config: MaglevConfig, balises: BaliseTable, line_length_m: float = 0.0
    ) -> None:
        self._config, self._balises = config, balises
        last = float(balises.chainage[-1]) if len(balises) else 0.0
        self._length = line_length_m if line_length_m > 0.0 else last + BEYOND_M
        make: Any = RobustFilter if config.method == 'robust' else KalmanFilter
        self._filter = make(config, balises, self._length)
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next measurement starts anew."""
        self.rejections, self.health = Rejections(), SensorHealth()
        self.events: Counter[str] = Counter()
        self._rng = np.random.default_rng(self._config.seed)
        self._history: History[Any, tuple[Measurement, float]] | None = None
        self._told: tuple[float, float] | None = None
        self._first_s = self._ahead_s = math.nan
        self._published_s = -math.inf
        self._stamps: dict[str, float] = {}
        self._latest: Estimate | None = None
        self._late = 0
        self._unseen_m = 0.0

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """Refused measurements: sensor -> reason -> count."""
        return self.rejections.as_dict()

    @property
    def latest(self) -> Estimate | None:
        """The newest estimate."""
        return self._latest

    def set_start(self, chainage: float, variance: float) -> str | None:
        """Say where the train is [m], known to ``variance`` [m^2]; return why not, or None."""
        if not math.isfinite(chainage) or not math.isfinite(variance):
            return 'not_finite'
        if variance <= 0.0:
            return 'bad_variance'
        if not -BEYOND_M <= chainage <= self._length + BEYOND_M:
            return 'off_the_line'
        self._told = (chainage, variance)
        self._history = None
        return None

    def push(self, measurement: Measurement) -> list[Estimate]:
        """Take a measurement; return the estimates that it makes possible, at most one."""
        sensor = sensor_of(measurement)
        reason = problem(measurement) or self._untimely(sensor, measurement.time_s)
        if reason is not None:
            self.rejections.add(sensor, reason)
            return []
        if self._history is None:
            self._history = self._begin(measurement)
            if self._history is None:
                return []
        heard = (measurement, float(self._rng.random()))
        newest = self._history.newest_s
        try:
            replayed = self._history.add(measurement.time_s, heard, RANK[sensor])
        except TooLateError:
            self.rejections.add(sensor, 'too_late')
            return []
        if replayed:
            self._late += 1
        else:
            self._note(sensor, measurement, self._history.state)
        if measurement.time_s < newest:
            return []
        return self._publish(sensor, measurement.time_s)

    def diagnostics(self) -> dict[str, float | str]:
        """Return what a user wants to see of the filter's state."""
        out: dict[str, float | str] = {'method': self._config.method, 'status': self._status()}
        if self._latest is not None:
            out |= {
                'chainage_m': round(self._latest.chainage, 3),
                'sigma_along_m': round(self._latest.sigma_along, 4),
                'speed_mps': round(self._latest.speed, 3),
            }
        if self._history is not None and isinstance(self._history.state, Bank):
            weight = np.exp(self._history.state.log_w)
            out |= {
                'hypotheses': len(weight),
                'n_eff': round(float(1.0 / np.sum(weight**2)), 2),
            }
        for sensor, state in self.health.states.items():
            out[f'health.{sensor}'] = state
            if math.isfinite(self.health.nis[sensor]):
                out[f'nis.{sensor}'] = round(self.health.nis[sensor], 3)
        out |= {f'events.{name}': count for name, count in sorted(self.events.items())}
        out['late'] = self._late
        return out

    def _status(self) -> str:
        if self._history is None:
            return 'waiting for a start'
        bad = [f'{s} {state}' for s, state in self.health.states.items() if state in (SILENT, ISOLATED)]
        return ', '.join(bad)

    def _untimely(self, sensor: str, time_s: float) -> str | None:
        """Return why a stamp cannot be used, or None."""
        if self._stamps.get(sensor) == time_s:
            return 'repeated_time'
        newest = max(self._stamps.values(), default=time_s)
        if time_s - newest > LONG_GAP_S:
            if not abs(time_s - self._ahead_s) < 1.0:
                self._ahead_s = time_s
                return 'time_jump'
            self._after_gap(time_s - newest)
        if time_s < newest - self._config.horizon_s:
            return 'too_late'
        self._stamps[sensor] = max(time_s, self._stamps.get(sensor, time_s))
        return None

    def _after_gap(self, gap_s: float) -> None:
        """Start again where the train was, with all that it may have travelled as doubt."""
        if self._history is not None and self._latest is not None:
            reach = (abs(self._latest.speed) + 10.0) * gap_s + self._latest.sigma_along
            self._told = (self._latest.chainage, min(reach, self._length) ** 2)
            self._history = None
        self._stamps.clear()

    def _begin(self, measurement: Measurement) -> History[Any, tuple[Measurement, float]] | None:
        """Return the history of a start at this measurement; None while it waits for the loop."""
        time_s = measurement.time_s
        if self._told is not None:
            place = self._told
        elif not self._config.motion.start_known:
            place = (0.5 * self._length, (0.5 * self._length) ** 2)
        elif isinstance(measurement, LoopPosition):
            middle = measurement.reading + 0.5 * self._config.loop.pitch_m
            place = (middle, self._config.motion.start_sigma_m**2)
        else:
            self._first_s = time_s if math.isnan(self._first_s) else self._first_s
            if time_s - self._first_s < START_WITHIN_S:
                return None
            place = (0.5 * self._length, (0.5 * self._length) ** 2)
        state = self._filter.start(time_s, *place)
        return History(self._filter.apply, state, time_s - 1e-9, self._config.horizon_s)

    def _note(self, sensor: str, measurement: Measurement, state: Any) -> None:
        """Count what became of the newest measurement."""
        if isinstance(state, Bank):
            reason = EXCUSES.get(state.says, '')
            if isinstance(measurement, BalisePassing) and reason != 'gate':
                unknown = self._balises.index(measurement.balise) is None
                reason = 'unknown_id' if unknown else reason
            if state.says in EVENTS:
                self.events[f'{sensor}.{EVENTS[state.says]}'] += 1
            refused = state.says in (bank.IGNORED, bank.SHIFT, bank.UNKNOWN)
        else:
            reason = state.reason
            refused = reason == 'gate'
        if reason:
            self.rejections.add(sensor, reason)
        self.health.heard(sensor, measurement.time_s, refused, state.nis)

    def _publish(self, sensor: str, time_s: float) -> list[Estimate]:
        assert self._history is not None
        state = self._history.state
        quiet = time_s - self._published_s > 2.0 * CYCLE_S
        if sensor == LOOP and not (quiet and state.fused_s == time_s):
            return []
        estimate: Estimate = self._filter.estimate(state)
        elapsed = min(max(estimate.time_s - self._published_s, 0.0), 1.0)
        counted = state.memory.changed_s >= self._published_s
        self._unseen_m = 0.0 if counted else self._unseen_m + abs(estimate.speed) * elapsed
        self.health.judge(time_s, self._unseen_m)
        self._published_s, self._latest = estimate.time_s, estimate
        return [estimate]


def problem(measurement: Measurement) -> str | None:
    """Return why a measurement cannot be used whatever the filter thinks, or None."""
    value, most = {
        LoopPosition: lambda z: (z.reading, MAX_READING_M),
        RadarSpeed: lambda z: (z.speed, MAX_SPEED_MPS),
        BalisePassing: lambda z: (z.offset, MAX_READING_M),
    }[type(measurement)](measurement)
    if not (math.isfinite(value) and math.isfinite(measurement.time_s)):
        return 'not_finite'
    if not (0.0 < measurement.variance < MAX_VARIANCE):
        return 'bad_variance'
    return None if abs(value) < most else 'implausible'

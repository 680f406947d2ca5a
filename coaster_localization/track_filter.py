"""
The track filter: where a coaster train is on its line, live, from one IMU.

The vehicle is on a known line, so its position is one number. See
``track_localization.estimation.line_state`` for the method and ``line_bank`` for the doubtful
cases; here is what a coaster adds: the start in the station, standstill, gaps and clocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from coaster_localization.start import Rest, is_quiet
from coaster_localization.track_conditions import GAP_S, process_noise, settings_of
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_crooked import Crookedness
from coaster_localization.track_departure import TURN_AT_REST, TURN_UNDER_WAY, Departure
from coaster_localization.track_mixture import figures, mixture, opened
from coaster_localization.track_sought import sought
from coaster_localization.track_start import Hypotheses, placed
from coaster_localization.track_states import Doubt, Epoch, Origin, TrackState
from track_localization.estimation import line_bank, line_motion
from track_localization.estimation.gating import Rejections
from track_localization.estimation.imu import ImuSample
from track_localization.estimation.imu_monitor import ClockGuard, ImuMonitor, ImuStep
from track_localization.track.line_map import LineMap

Array = NDArray[np.float64]

LEVEL_INTERVAL_S = 0.5
MERGE_INTERVAL_S, LEAST_WEIGHT, MOST = 0.25, 1e-7, 400
"""How often hypotheses are merged, how light one may be, and how many there may be."""
SURE = 0.999
"""One hypothesis of this weight is followed alone, once the line has turned enough to tell."""
FASTEST_MPS = 100.0
"""A hypothesis faster than this has run away."""
BEYOND_M, BEYOND_SIGMAS = 5.0, 3.0
"""So far beyond the end of an open line no train can be."""
EARLY = 0.3
"""What is seen of a doubtful start while a few places look alike tells less than it seems: the
share of its likelihood that counts."""
NEW_FORCE = 2.0
"""What the force shows is news again when it has changed so much [m/s^2]."""
WRONG_WAY_MPS, WRONG_WAY = 0.5, 2.0
"""A train leaves the station as its design does: one faster than this [m/s] the other way becomes
less likely by so much, as a logarithm, every second."""
TURNING = 0.15
"""What the sensor turns faster than this is the line's doing [rad/s]."""
LOST = 0.9
"""Probability of being lost above which the train is looked for."""


class CoasterTrackFilter:
    """
    Follow one ride on a line.

    ``push`` takes IMU samples in the order they come and returns a state for each, once there is
    something to start from: a rest, or three seconds without one. ``on_epoch`` is called with
    every comparison with the line while a single hypothesis is followed: what smoothing needs.
    """

    def __init__(
        self,
        line: LineMap,
        start_m: float,
        config: TrackFilterConfig,
        on_epoch: Callable[[Epoch], None] | None = None,
        rest: Rest | None = None,
        origin: Origin | None = None,
    ) -> None:
        """
        Prepare to start at chainage ``start_m`` of ``line``.

        ``rest`` is one seen elsewhere in the recording, for a ride that shows none at its begin.
        ``origin`` is that of an earlier run over the same recording: nothing is then in doubt.
        """
        self.line, self.config = line, config
        self._start_m, self._start_sigma = start_m, config.start_sigma_m
        self._on_epoch, self._known_rest = on_epoch, rest
        self._origin = origin
        self._settings = settings_of(config)
        self._table = (line.rows, line.step_m, line.closed)
        self._nis = np.zeros(3)
        self.reset()

    def reset(self) -> None:
        """Forget the ride and wait for a start again; a start that was set is kept."""
        self._rejections = Rejections()
        self._clock = ClockGuard()
        self.accepted = {'imu': 0}
        self._crooked = Crookedness()
        self._restart()

    def _restart(self) -> None:
        self._monitor = ImuMonitor()
        place = (self._start_m, self._start_sigma)
        self._departure = Departure(self.line, place, self.config, self._known_rest)
        self._rest, self._hasty = self._known_rest, False
        self._running = False
        self.doubts: list[Doubt] = []
        self.relocations = 0
        self.lost = 0.0

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """Refused measurements: sensor -> reason -> count."""
        return self._rejections.as_dict()

    @property
    def hypotheses(self) -> int:
        """How many places are thought possible."""
        return len(self.X) if self._running else 0

    @property
    def widened(self) -> float:
        """By how much variances are too small, the line being more crooked than expected."""
        return self._crooked.factor

    def set_start(self, chainage_m: float, sigma_m: float) -> None:
        """Say where the train is now, or, before there was a rest, where it will start [m]."""
        self._start_m, self._start_sigma = chainage_m, max(sigma_m, 1e-3)
        self._departure.place = (self._start_m, self._start_sigma)
        if not self._running or not math.isfinite(self._monitor_s):
            return
        h = int(np.argmax(self._log_weight))
        place = (self._start_m, self._start_sigma)
        self._begin(self._monitor_s, placed(self.X[h], self.P[h], self.line, place, self.config))

    def diagnostics(self) -> dict[str, float | str]:
        """Return figures for a health report."""
        if not self._running:
            standing = self._departure.standing is not None
            return {'status': 'standing' if standing else 'waiting for a rest, or a ride under way'}
        h = int(np.argmax(self._log_weight))
        found = figures(self.X[h], self.P[h], self._nis, self.lost, len(self.X))
        return found | {'relocations': float(self.relocations)}

    def push(self, sample: ImuSample) -> list[TrackState]:
        """Take one sample; return the states that it makes possible."""
        f, w = sample.specific_force, sample.angular_rate
        if not math.isfinite(f @ f + w @ w):
            self._rejections.add('imu', 'not_finite')
            return []
        verdict = self._clock.check(sample.time_s)
        if verdict == 'restart':
            self._restart()
        if verdict is not None:
            self._rejections.add('imu', verdict)
        if verdict not in (None, 'restart'):
            return []
        self.accepted['imu'] += 1
        if not self._running and self._origin is not None:
            if sample.time_s < self._origin.time_s:
                if not self._origin.fresh:
                    self._monitor.push(sample)
                return []
            self._begin_as_before(self._origin)
        return [self._follow(sample)] if self._running else self._wait(sample)

    def _wait(self, sample: ImuSample) -> list[TrackState]:
        """Wait for the ride; when it begins, follow what was kept of it."""
        waited = self._departure.standing is not None
        begin = self._departure.push(sample)
        if begin is None:
            standing = self._departure.standing
            return [] if standing is None else [standing]
        self._rest, self._hasty = begin.rest, begin.hasty
        self._begin(begin.time_s, begin.start, begin.turn)
        self._way = begin.way
        states = [self._follow(earlier) for earlier in begin.samples]
        return states[-1:] if waited else states

    def _begin(self, time_s: float, start: Hypotheses, turn: float = TURN_AT_REST) -> None:
        self._turn_left = turn
        fresh = not self._running
        self.X, self.P = start.X, start.P
        self._log_weight = start.log_weight
        self._roots = [
            Origin(time_s, x.copy(), P.copy(), self._rest, fresh)
            for x, P in zip(self.X, self.P, strict=True)
        ]
        count = len(self.X)
        self._sums, self._driven = np.zeros((count, line_motion.SUMS)), np.zeros((count, 1))
        self._log_lost = math.log(1e-4)
        self._told = np.zeros(3)
        self._way = 0.0
        self.lost, self._lost_since = 0.0, math.inf
        self._running = self._first = True
        self._epoch_s = self._leveled_s = self._merged_s = self._monitor_s = time_s

    def _begin_as_before(self, origin: Origin) -> None:
        self._rest = origin.rest
        start = Hypotheses(origin.x.copy()[None], origin.P.copy()[None], np.zeros(1))
        self._begin(origin.time_s, start)

    def _follow(self, sample: ImuSample) -> TrackState:
        step = self._monitor.push(sample)
        self._monitor_s = step.time_s
        if step.dt > 0.0:
            line_bank.advance_all(self.X, self._sums, step.f, step.w, step.dt, *self._table)
        if self._turn_left > 0.0:
            rate = math.sqrt(float(step.w_mean @ step.w_mean))
            self._turn_left -= rate * step.dt if rate > TURNING else 0.0
        if step.time_s - self._epoch_s >= self.config.epoch_s - 1e-6 or step.dt > GAP_S:
            self._close_epoch(step)
        if len(self.X) == 1:
            P = opened(self.P[0], self.lost, self.line.length)
            return TrackState(step.time_s, self.X[0].copy(), P, self.lost, self.widened)
        h, P = mixture(self.X, self.P, self._log_weight)
        P = opened(P, math.exp(self._log_lost), self.line.length)
        return TrackState(step.time_s, self.X[h].copy(), P, self.lost, self.widened)

    def _close_epoch(self, step: ImuStep) -> None:
        T = step.time_s - self._epoch_s
        self._epoch_s = step.time_s
        level = step.time_s - self._leveled_s >= LEVEL_INTERVAL_S
        if level:
            self._leveled_s = step.time_s
        share = line_bank.news(T, step.w_mean, self.X, self._log_weight, *self._table)
        force_news, change = share, step.f_mean - self._told
        if change @ change > NEW_FORCE**2:
            force_news, self._told = 1.0, step.f_mean
        share *= 1.0 if self._turn_left <= 0.0 else EARLY
        force_news *= 1.0 if self._turn_left <= 0.0 else EARLY
        quiet = is_quiet(step, self._rest) and not (self._hasty and self._turn_left > 0.0)
        shaken = (step.mean, step.shake, step.w_std)
        about = (self._settings, process_noise(self.config, step.dt), *shaken, quiet, level)
        if len(self.X) == 1:
            x, P = self.X[0], self.P[0].copy()
            F, x_before, P_before, likelihood, _ = line_bank.close_epoch(
                x, P, self._sums[0], self._driven[0], *self._table, *about, self._nis
            )
            self.P = P[None]
            self._crooked.push(self._nis, float(x[1]), math.sqrt(max(float(P_before[0, 0]), 0.0)))
            self._log_weight[0] += share * likelihood
            if self._on_epoch is not None:
                if self._first:
                    # Nothing that comes after a start tells of what was before it.
                    F[:] = 0.0
                self._on_epoch(Epoch(step.time_s, x_before, P_before, F, x.copy(), P))
            self._first = False
            self._weigh_alone(step.time_s, T, share)
        else:
            sigma = 0.7 + math.sqrt(float(step.shake[0:3].max()))
            line_bank.close_all(
                *(self.X, self.P, self._sums, self._driven, self._log_weight),
                *(*self._table, *about, sigma, share, force_news),
            )
            self._log_lost += force_news * line_bank.LOST_FORCE_LIKELIHOOD
            self._weigh(step.time_s, T, share)

    def _weigh_alone(self, time_s: float, T: float, share: float) -> None:
        """Compare the one hypothesis with being lost; look for the train when it is, for long."""
        weight, variance = float(self._log_weight[0]), float(self.P[0, 0, 0])
        # Not a number is not less either.
        if not (abs(weight) < math.inf and abs(self.X[0, 1]) < FASTEST_MPS):
            return self._seek(time_s)
        if not 0.0 < variance < math.inf:
            return self._seek(time_s)
        self._log_lost += share * line_bank.LOST_LIKELIHOOD
        odds = self._log_lost - weight
        self._missed(1.0 / (1.0 + math.exp(-odds)) if odds > -700.0 else 0.0, T)
        self._log_weight[0] = math.log1p(-self.lost)
        if self.lost < LOST:
            self._lost_since = math.inf
        elif self._origin is None:
            self._lost_since = min(self._lost_since, time_s)
            if time_s - self._lost_since >= self.config.lost_after_s:
                self._seek(time_s)
        return None

    def _missed(self, probability: float, T: float) -> None:
        """Take over the probability that no hypothesis is right, and what time adds to it."""
        missed = min(probability, 0.9999)
        self.lost = missed + (1.0 - missed) * line_bank.LOST_RATE * T
        self._log_lost = math.log(max(self.lost, 1e-6))

    def _weigh(self, time_s: float, T: float, share: float) -> None:
        """Compare the hypotheses with each other and with being lost."""
        sound = np.isfinite(self._log_weight) & (np.abs(self.X[:, 1]) < FASTEST_MPS)
        sound &= np.isfinite(self.P[:, 0, 0]) & (self.P[:, 0, 0] > 0.0)
        if not self.line.closed:
            beyond = np.maximum(-self.X[:, 0], self.X[:, 0] - self.line.length)
            sound &= beyond < BEYOND_M + BEYOND_SIGMAS * np.sqrt(self.P[:, 0, 0])
        if not sound.any():
            self._seek(time_s)
            return
        if not sound.all():
            self._keep(np.flatnonzero(sound))
        if self._turn_left > 0.0:
            self._log_weight[self.X[:, 1] * self._way < -WRONG_WAY_MPS] -= WRONG_WAY * T
        self._log_lost += share * line_bank.LOST_LIKELIHOOD
        total = float(np.logaddexp.reduce(np.append(self._log_weight, self._log_lost)))
        self._log_weight -= total
        self._missed(math.exp(self._log_lost - total), T)
        missed = self.lost
        if time_s - self._merged_s >= MERGE_INTERVAL_S:
            self._merged_s = time_s
            self._keep(self._merged())
        best = float(np.exp(self._log_weight.max()))
        self.lost = 1.0 - best
        if len(self.X) == 1 or (best > SURE and self._turn_left <= 0.0):
            self._keep(np.array([int(np.argmax(self._log_weight))]))
            self.doubts.append(Doubt(self._roots[0], time_s))
            self._first = True
        elif missed > LOST and time_s - self._roots[0].time_s > 10.0:
            self._seek(time_s)

    def _merged(self) -> NDArray[np.int64]:
        lap = self.line.length if self.line.closed else math.inf
        least = LEAST_WEIGHT if self._turn_left <= 0.0 else LEAST_WEIGHT**2
        return line_bank.merge(self.X, self.P, self._log_weight, least, lap)[:MOST]

    def _seek(self, time_s: float) -> None:
        h = int(np.argmax(self._log_weight))
        found = sought(self.X[h], self.P[h], self.line, self._start_m, self.config)
        self.relocations += 1
        self._begin(time_s, found, TURN_UNDER_WAY)

    def _keep(self, rows: NDArray[np.int64]) -> None:
        self.X, self.P = self.X[rows], self.P[rows]
        self._sums, self._driven = self._sums[rows], self._driven[rows]
        self._log_weight = self._log_weight[rows]
        self._roots = [self._roots[k] for k in rows]

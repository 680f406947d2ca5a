"""Match a ride against the design ride while it goes on: samples in, places out a second later."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from coaster_localization.config import MatcherConfig
from coaster_localization.observation import MatchObservation
from coaster_localization.planned import Features, PlannedRows
from coaster_localization.rest import RestWatch
from coaster_localization.sensed import shortest_turn
from coaster_localization.stamps import GAP, RESTART, StampCheck
from coaster_localization.station import Station
from coaster_localization.ticks import Ticker
from coaster_localization.tracker import Tracker
from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample, largest_part
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

WAITING, RIDING = 'waiting', 'riding'
LIVE_MATCHER = 'dtw_penalised'
ONLY_LIVE = (
    f'live matching is an open-end alignment, the live form of {LIVE_MATCHER}; the others are for '
    'whole recordings'
)
CROSS_SIGMA_M = 0.05
LARGEST_VALUE = 1e4
"""No force [m/s^2] or rate [rad/s] that a sensor means is larger."""
STATION_M = 3.0
"""How near the ride's begin or end a standing train is taken to be in the station."""
NO_RATE = np.zeros(3)


class OnlineMatcher:
    """
    Places on the design line from a stream of IMU samples.

    It waits for a rest, levels the sensor and learns the gyro bias from it, and follows the ride
    from the station on. A stream that does not begin at rest is sought on the whole line. Work
    per sample is bounded by the design's length, memory by that and the lag.

    Attributes:
        rejected: samples that were not used, and leaps of the clock, by reason.
    """

    def __init__(self, design: DesignRide, config: MatcherConfig) -> None:
        """Prepare; raise DataError for channels that cannot be followed live."""
        if config.channel not in ('multi', 'z'):
            raise DataError(
                f'matcher.channel {config.channel!r}: live matching has multi and z; the Euler '
                'angles are for whole recordings'
            )
        self._design, self._config = design, config
        self._station = Station(design)
        self._start_R_nb = so3.matrix_from_quat(design.quaternion[0])
        self._plans: dict[str, PlannedRows] = {}
        self._lag = round(config.lag_s * config.online_rate_hz)
        self.rejected: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """Forget the ride, wait for a new one."""
        config = self._config
        self._stamps = StampCheck(config.gap_s)
        self._ticker = Ticker(config.online_rate_hz, config.gap_s)
        self._rest = RestWatch(config.online_rate_hz, self._station.is_elsewhere)
        self._has_gyro: bool | None = None
        self._phase = WAITING
        self._ticks = 0
        self._tracker: Tracker | None = None
        self._misfit = 0.0
        self._last: MatchObservation | None = None
        self._sigma = float('nan')
        self._due_s = -math.inf

    def push(self, sample: ImuSample) -> list[MatchObservation]:
        """Take a sample; return the matches that are due, stamped with the sample matched."""
        force, rate = largest_part(sample.specific_force), largest_part(sample.angular_rate)
        has_gyro = not math.isnan(rate)
        if has_gyro and self._has_gyro is False:
            self.reset()
        if self._has_gyro is None:
            self._has_gyro = has_gyro
        if math.isnan(force) or (self._has_gyro and not has_gyro):
            self.rejected['not_finite'] += 1
            return []
        if force > LARGEST_VALUE or rate > LARGEST_VALUE:
            self.rejected['out_of_range'] += 1
            return []
        verdict = self._stamps(sample.time_s)
        if verdict == RESTART:
            self.rejected['restart'] += 1
            self.reset()
            return self.push(sample)
        if verdict == GAP:
            self.rejected['gap'] += 1
            self._lose()
        elif verdict != 'good':
            self.rejected[verdict] += 1
            return []
        measured = sample.angular_rate if self._has_gyro else NO_RATE
        found = []
        for time_s, row in self._ticker.push(sample.time_s, sample.specific_force, measured):
            match = self._tick(time_s, row)
            if match is not None:
                found.append(match)
        return found

    def diagnostics(self) -> dict[str, float | str]:
        """Return figures that tell how the match stands."""
        return {
            'match_phase': self._phase,
            'match_sigma_m': self._sigma,
            'match_misfit': self._misfit,
            'match_chainage_m': self._last.chainage if self._last else float('nan'),
            'match_rows_in_doubt': float(self._tracker.width) if self._tracker else 0.0,
        }

    def _tick(self, time_s: float, row: Array) -> MatchObservation | None:
        """Take one tick; return a match if one is due."""
        self._ticks += 1
        held = self._rest.push(row)
        if held and (self._phase == WAITING or self._in_station()):
            self._level()
        tracker = self._tracker
        if tracker is None:
            waited = self._ticks > self._config.seek_after_s * self._config.online_rate_hz
            if not (self._rest.known or waited):
                return None
            tracker = self._begin('multi' if self._rest.known else 'no_vertical')
        waiting = self._phase == WAITING and held
        if not waiting:
            self._phase = RIDING
            held = held and not self._rest.smooth
        features = self._features(self._ticker.in_body(row)[None], np.array([waiting]))[0]
        tracker.advance(features, held)
        self._watch_misfit(tracker.fit)
        return self._match(time_s, tracker)

    def _level(self) -> None:
        """Take mount, attitude and gyro bias from the rest that goes on, and wait for the ride."""
        ticker = self._ticker
        ticker.R_bm = shortest_turn(self._rest.gravity, self._start_R_nb[2])
        ticker.gyro_bias = self._rest.gyro_bias.copy() if self._has_gyro else np.zeros(3)
        ticker.R_nb[:] = self._start_R_nb
        if self._phase != WAITING:
            self._phase, self._tracker = WAITING, None
            self._rest.arrived()

    def _begin(self, which: str) -> Tracker:
        """Start to follow: from the station while waiting there, else from anywhere."""
        if self._config.channel == 'z' or not self._has_gyro:
            which = 'z'
        config = self._config
        if which not in self._plans:
            self._plans[which] = PlannedRows(self._design, which, config)
        plan = self._plans[which]
        self._plan, self._features = plan, Features(which, config)
        tracker = Tracker(
            plan.features, self._lag, config.online_noise, config.pace_change, config.jump
        )
        known = self._rest.known and self._phase == WAITING
        tracker.start(0, plan.departure + 1 if known else len(plan.time_s))
        self._tracker, self._misfit = tracker, 0.0
        return tracker

    def _lose(self) -> None:
        """Seek the whole line: time has passed of which nothing is known."""
        self._ticker.restart()
        self._phase = RIDING
        if self._tracker is not None:
            self._begin('no_vertical')

    def _watch_misfit(self, fit: float) -> None:
        """Seek anew when the place that is followed has not fitted for seconds."""
        config = self._config
        share = 1.0 / (config.lost_after_s * config.online_rate_hz)
        self._misfit += share * (fit - self._misfit)
        if self._misfit > config.lost_misfit and self._phase == RIDING:
            self.rejected['lost'] += 1
            self._begin('no_vertical')

    def _in_station(self) -> bool:
        """Tell whether a train that stands for seconds has not left yet, or has come back."""
        if self._tracker is None or self._last is None or self._rest.held_s < self._config.rest_s:
            return False
        chainage, plan = self._last.chainage, self._plan
        ends = (plan.chainage[plan.departure], plan.chainage[-1])
        return min(abs(chainage - end) for end in ends) < STATION_M

    def _match(self, time_s: float, tracker: Tracker) -> MatchObservation | None:
        """Return the match of the sample ``lag_s`` ago if one is due and can be told."""
        if time_s < self._due_s or tracker.rows < self._lag:
            return None
        config, plan = self._config, self._plan
        chance, first = tracker.look_back(self._lag)
        rows = slice(first, first + len(chance))
        mean_s = float(chance @ plan.time_s[rows])
        chainage = float(chance @ plan.chainage[rows])
        variance = float(chance @ (plan.chainage[rows] - chainage) ** 2)
        self._sigma = math.sqrt(variance + config.sigma_floor_m**2)
        self._due_s = time_s + 1.0 / config.observation_rate_hz - 0.5 / config.online_rate_hz
        if self._sigma > config.unsure_m:
            return None
        position, quaternion, chainage = plan.place(mean_s)
        across = min(CROSS_SIGMA_M, self._sigma) ** 2
        R_nb = so3.matrix_one(quaternion)
        V = (R_nb * (self._sigma**2, across, across)) @ R_nb.T
        stamp = time_s - self._lag / config.online_rate_hz
        self._last = MatchObservation(stamp, position, quaternion, V, chainage)
        return self._last

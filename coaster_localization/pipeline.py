"""
The coaster's filter as a plain object: IMU samples and matches in, estimates out.

Driven by header stamps only. The live node feeds it from topics, an evaluation feeds it from a
recording; both get the same numbers. A match is fused at its own stamp, however late it comes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coaster_localization.config import EskfConfig
from coaster_localization.estimate import Estimate, FusedState, Prediction
from coaster_localization.match_update import MatchUpdate, usual_speeds
from coaster_localization.observation import MatchObservation, problem
from coaster_localization.replaying import SAME_S, ZUPT_INTERVAL_S, plain_steps, repeat_steps
from coaster_localization.start import (
    Rest,
    StartPose,
    is_quiet,
    observe_rest,
    state_at_rest,
    state_from_match,
)
from coaster_localization.station import Station
from coaster_localization.zupt import standstill
from track_localization.estimation import eskf, so3
from track_localization.estimation.gating import Rejections
from track_localization.estimation.history import History, Run, TooLateError
from track_localization.estimation.imu import ImuSample, largest_part
from track_localization.estimation.imu_monitor import ClockGuard, ImuMonitor, ImuStep
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.line_table import LineTable

Array = NDArray[np.float64]

GAP_S = 0.1
"""A step longer than this was not measured: what the train did in it is unknown."""
AHEAD_S, EARLY_MATCHES = 30.0, 500
"""How far ahead of the IMU a match may come [s], and how many wait for their sample."""
GAP_ACCEL, GAP_RATE = 15.0, 1.5
"""How a train may accelerate [m/s^2] and turn [rad/s] unseen."""
IN_DOUBT_AFTER_S = 1.0
"""Matches beyond the gate for so long put the position in doubt, not one alone [s]."""


class CoasterEskf:
    """
    Error-state Kalman filter of one ride.

    ``push`` takes IMU samples (in the body: apply the mount before) and matches, in any order of
    arrival, and returns the new estimates: one for every IMU sample once the start is known.
    """

    def __init__(
        self, design: DesignRide, config: EskfConfig, line: LineTable | None = None
    ) -> None:
        self.config = config
        self.design = design
        self.line = line or LineTable(Centreline.from_design_ride(design))
        self._noise = eskf.ImuNoise(
            config.accel_noise,
            config.gyro_noise,
            config.accel_bias_walk,
            config.gyro_bias_walk,
            config.accel_scale,
            config.gyro_scale,
        )
        self._station = Station(design)
        self._usual_speed = usual_speeds(self.line, design)
        self._start = StartPose(
            design.position[0],
            np.eye(3) * config.start_sigma_m**2,
            so3.matrix_from_quat(design.quaternion[0]),
        )
        self.reset()

    def reset(self) -> None:
        """Forget the ride and wait for a start again; a start pose that was set is kept."""
        self._rejections = Rejections()
        self._clock = ClockGuard()
        self._restart()

    def _restart(self) -> None:
        self._monitor = ImuMonitor()
        self._match_update = MatchUpdate(self.line, self.config, self._usual_speed)
        self._waiting: deque[ImuSample] = deque()
        self._rest: Rest | None = None
        self._early: list[MatchObservation] = []
        self._tried_s = -math.inf
        self.history: History[FusedState, Prediction | MatchObservation] | None = None
        self.accepted = {'imu': 0, 'match': 0}

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """Refused measurements: sensor -> reason -> count."""
        counts = self._rejections.as_dict()
        if self._match_update.refused:
            counts.setdefault('match', {})['gate'] = len(self._match_update.refused)
        return counts

    def set_start(self, position: Array, covariance: Array, R_nb: Array | None = None) -> None:
        """
        Set where the vehicle is, at the newest stamp (or at the start, before there is one).

        ``position`` (3,) in ``map`` [m], ``covariance`` (3, 3) [m^2], ``R_nb`` for the attitude.
        """
        if R_nb is None:
            nearest = int(np.argmin(np.linalg.norm(self.design.position - position, axis=1)))
            R_start = so3.matrix_from_quat(self.design.quaternion[nearest])
        else:
            R_start = R_nb
        self._start = StartPose(position, covariance, R_start)
        if self.history is None:
            return
        state = self.history.state
        x, P = state.nav.x.copy(), state.nav.P.copy()
        x[0:3] = position
        P[0:3, :] = 0.0
        P[:, 0:3] = 0.0
        P[0:3, 0:3] = covariance
        if R_nb is not None:
            x[6:15] = R_nb.ravel()
        nav = eskf.State(state.nav.time_s, x, P)
        self._begin(state._replace(nav=nav, chainage=self.line.nearest(position)))

    def push(self, measurement: ImuSample | MatchObservation) -> list[Estimate]:
        """Take one measurement; return the estimates that it makes possible."""
        if isinstance(measurement, MatchObservation):
            self._push_match(measurement)
            return []
        return self._push_imu(measurement)

    def diagnostics(self) -> dict[str, float | str]:
        """Return figures for a health report."""
        if self.history is None:
            return {'status': 'waiting for a standstill or a match in motion'}
        state = self.history.state
        doubted = state.nav.time_s - state.doubted_since_s > IN_DOUBT_AFTER_S
        return {
            'status': 'matches disagree: position in doubt' if doubted else 'running',
            'position_sigma_m': float(np.sqrt(np.trace(state.nav.P[0:3, 0:3]))),
            'speed_mps': float(np.linalg.norm(state.nav.velocity)),
            'chainage_m': state.chainage,
            'last_match_age_s': state.nav.time_s - state.last_match_s,
            'match_nis': self._match_update.last_nis,
            'relocations': float(len(self._match_update.relocated)),
        }

    def _push_imu(self, sample: ImuSample) -> list[Estimate]:
        parts = largest_part(sample.specific_force) + largest_part(sample.angular_rate)
        if math.isnan(parts):
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
        if self.history is None:
            estimates = self._wait_for_rest(sample)
            self._begin_with_held(sample.time_s)
        else:
            estimates = [self._predict(self.history, sample)]
        if self._early and self.history is not None:
            early, self._early = self._early, []
            for match in early:
                self._count(self._place(match))
        return estimates

    def _begin_with_held(self, time_s: float) -> None:
        """Begin with a match that came before its sample, now that this one has come."""
        due = [match for match in self._early if self._tried_s < match.time_s <= time_s]
        self._tried_s = time_s
        for match in due:
            if self.history is None:
                self._early.remove(match)
                self._count(self._start_from_match(match))

    def _push_match(self, match: MatchObservation) -> None:
        self._count(problem(match) or self._place(match))

    def _count(self, reason: str | None) -> None:
        if reason is not None:
            self._rejections.add('match', reason)

    def _place(self, match: MatchObservation) -> str | None:
        """Fuse a match, keep it for later or begin with it; return why not."""
        newest = self._clock.latest_s
        if newest is not None and match.time_s > newest:
            # The matcher was quicker with the samples: wait for them.
            return 'ahead_of_imu' if match.time_s > newest + AHEAD_S else self._hold(match)
        return self._start_from_match(match) if self.history is None else self._fuse(match)

    def _fuse(self, match: MatchObservation) -> str | None:
        """Put a match in its place in the history; return why not, if it is too old for it."""
        assert self.history is not None
        try:
            self.history.add(match.time_s, match, rank=1)
        except TooLateError:
            return 'too_late'
        self.accepted['match'] += 1
        return None

    def _hold(self, match: MatchObservation) -> str | None:
        """Keep a match until its time comes; return why not, where too many are kept already."""
        if len(self._early) >= EARLY_MATCHES:
            return 'too_early'
        self._early.append(match)
        return None

    def _wait_for_rest(self, sample: ImuSample) -> list[Estimate]:
        """Keep samples until they show a standstill long enough to level by."""
        waiting = self._waiting
        waiting.append(sample)
        if sample.time_s - waiting[0].time_s < self.config.rest_s:
            return []
        rest = observe_rest(waiting)
        if rest is None or self._station.is_elsewhere(rest.force):
            while sample.time_s - waiting[0].time_s >= self.config.rest_s:
                waiting.popleft()
            return []
        self._rest = rest
        time_s = waiting[0].time_s
        nav = state_at_rest(time_s, rest, self._start, self.config)
        chainage = self.line.nearest(nav.position)
        self._begin(FusedState(nav, chainage, float('nan'), float('nan'), time_s))
        return self._replay_waiting()

    def _start_from_match(self, match: MatchObservation) -> str | None:
        """Begin in mid-ride; return why not, where the match does not allow it."""
        if not self._waiting or not 0.0 <= self._waiting[-1].time_s - match.time_s < 5.0:
            return 'before_start'
        nav = state_from_match(match, self.design, self.config)
        if nav is None:
            in_reach = match.time_s >= self._waiting[0].time_s
            return self._hold(match) if in_reach else 'before_start'
        while self._waiting and self._waiting[0].time_s <= match.time_s:
            self._waiting.popleft()
        chainage = self.line.nearest(match.position)
        self._begin(FusedState(nav, chainage, match.time_s, float('nan'), match.time_s))
        self._replay_waiting()
        self.accepted['match'] += 1
        return None

    def _replay_waiting(self) -> list[Estimate]:
        estimates = []
        while self._waiting and self.history is not None:
            estimates.append(self._predict(self.history, self._waiting.popleft()))
        return estimates

    def _predict(
        self, history: History[FusedState, Prediction | MatchObservation], sample: ImuSample
    ) -> Estimate:
        """Add a sample to the history; return the estimate there."""
        step = self._monitor.push(sample)
        prediction = Prediction(step, self.noise(step, step.dt), self._quiet(step))
        history.add(step.time_s, prediction)
        state = history.state
        return Estimate(step, state.nav, state.chainage, self.line, self.config.gyro_noise)

    def _begin(self, state: FusedState) -> None:
        self.history = History(
            self.apply, state, state.nav.time_s, self.config.history_s, self.apply_all
        )

    def apply(self, state: FusedState, measurement: Prediction | MatchObservation) -> FusedState:
        """Return the state after one measurement: a pure function, so it can be replayed."""
        if isinstance(measurement, MatchObservation):
            return self._match_update(state, measurement)
        step, nav = measurement.step, state.nav
        dt = step.time_s - nav.time_s
        if dt > 0.0:
            # Right after a start the step to the first sample is shorter than the sample's own.
            q = measurement.q if abs(dt - step.dt) < SAME_S else self.noise(step, dt)
            nav = eskf.propagate(nav, step.f, step.w, dt, q, step.time_s)
            chainage = self.line.project(nav.position, state.chainage)
            state = state._replace(nav=nav, chainage=chainage)
        if measurement.quiet and step.time_s - state.last_zupt_s >= ZUPT_INTERVAL_S:
            usual = float(self._usual_speed[self.line.index(state.chainage)])
            return standstill(state, step, usual)
        return state

    def apply_all(
        self, state: FusedState, measurements: Sequence[Prediction | MatchObservation]
    ) -> list[Run[FusedState]]:
        """Return the states after each measurement, as ``apply`` on one after the other does."""
        runs: list[Run[FusedState]] = []
        done = 0
        while done < len(measurements):
            steps = plain_steps(state, measurements, done)
            run: Run[FusedState]
            if steps:
                run = repeat_steps(state, steps, self.line)
            else:
                run = (self.apply(state, measurements[done]),)
            runs.append(run)
            done += len(run)
            state = run[-1]
        return runs

    def noise(self, step: ImuStep, dt: float) -> Array:
        """Return a step's process noise (4,): IMU, vibration, and what a gap leaves unknown."""
        extra = self.config.vibration_gain * step.vibration * math.sqrt(dt)
        q = eskf.process_noise(self._noise, step.f, step.w, dt, extra)
        if dt > GAP_S:
            q[0] += (GAP_ACCEL * dt) ** 2
            q[1] += (GAP_RATE * dt) ** 2
        return q

    def _quiet(self, step: ImuStep) -> bool:
        """Whether the sensor shakes no more than it did in the station, under 1 g."""
        if self._rest is None or self.config.preset == 'paper':
            return False
        return is_quiet(step, self._rest)

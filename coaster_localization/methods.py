"""Every coaster method by name, run over one recording: what an evaluation compares."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coaster_localization.config import PAPER_MATCHER, CoasterConfig
from coaster_localization.matching import Match, match_ride
from coaster_localization.observation import MatchObservation, observation_covariance
from coaster_localization.online import LIVE_MATCHER, ONLY_LIVE, OnlineMatcher
from coaster_localization.pipeline import CoasterEskf
from coaster_localization.smoothing import estimates_to_trajectory, run_filter, smooth
from coaster_localization.track_map import line_map
from coaster_localization.track_rides import FilteredRide, filter_ride
from track_localization import garbage
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.settings import override
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.learned_line import LearnedLine
from track_localization.track.line_table import LineTable

Array = NDArray[np.float64]

MATCHING = {
    'srdtw_paper': ('srdtw', 'z'),
    'dtw_z': ('dtw', 'z'),
    'dtw_penalised': ('dtw_penalised', 'multi'),
    'srdtw_z': ('srdtw', 'z'),
    'srdtw_pitch': ('srdtw', 'pitch'),
    'srdtw_yaw': ('srdtw', 'yaw'),
    'srdtw_roll': ('srdtw', 'roll'),
    'srdtw_multi': ('srdtw', 'multi'),
}
"""Matching methods: name -> (algorithm, channel)."""

TRACK_METHODS = ('track_filter', 'track_filter_lag', 'track_filter_smoothed')
METHODS = (
    *('imu', *MATCHING, 'eskf_paper', 'eskf_live', 'eskf', 'eskf_smoothed', 'eskf_srdtw'),
    *TRACK_METHODS,
)
PAPER_FRONT_END = 'srdtw_paper'
"""SRDTW on Z with the paper's own settings; the other methods have the tuned defaults."""
SEGMENT_FRONT_END = 'srdtw_multi'
"""What ``eskf_srdtw`` is fed by, whatever the configuration's matcher: SRDTW at its best."""
WHOLE_RIDE_S = 1e9
"""A history that never forgets: what a recording allows."""


@dataclasses.dataclass(frozen=True)
class MethodResult:
    """
    What one method made of a recording.

    Attributes:
        name: of the method.
        trajectory: its estimates.
        match: the match it is, or was fed; None without one.
        fed_by: name of the matching method whose matches it fused.
        rejected: refused measurements, sensor -> reason -> count.
        runtime_s: seconds spent by stage.
        notes: what a reader should know (fallbacks, doubts).
        mount: how the sensor sits in the body as found (``mount_rpy_deg`` as given included):
            R_bm (3, 3) and its standard deviation per axis [rad]; None where it is not estimated.
    """

    name: str
    trajectory: Trajectory
    match: Match | None
    fed_by: str | None
    rejected: dict[str, dict[str, int]]
    runtime_s: dict[str, float]
    notes: tuple[str, ...] = ()
    mount: tuple[Array, float] | None = None


def run_methods(
    imu: ImuSeries,
    design: DesignRide,
    config: CoasterConfig,
    methods: Sequence[str],
    progress: Callable[[str], None] = lambda _: None,
    learned: LearnedLine | None = None,
) -> Iterator[MethodResult]:
    """
    Run ``methods`` (names of METHODS) over a recording; yield each result as it is ready.

    ``learned`` is what earlier rides taught of the line, for the track filter.
    """
    runner = _Runner(imu, design, config, learned)
    for name in methods:
        progress(name)
        with garbage.paused():
            result = runner.run(name)
        yield result


def apply_mount(imu: ImuSeries, mount_rpy_deg: tuple[float, float, float]) -> ImuSeries:
    """Return the series in body axes: the sensor sits in the body at roll, pitch, yaw [deg]."""
    R_bm = so3.matrix_from_rpy(*np.deg2rad(mount_rpy_deg))
    return ImuSeries(imu.time_s, imu.specific_force @ R_bm.T, imu.angular_rate @ R_bm.T)


def observations(match: Match, rate_hz: float) -> list[MatchObservation]:
    """Return the matches at ``rate_hz`` as observations (eq. 21 with the match's own quality)."""
    spacing = float(np.median(np.diff(match.time_s)))
    stride = max(1, round(1.0 / (rate_hz * spacing)))
    rows = np.flatnonzero(np.isfinite(match.sigma_along))[::stride]
    R_nb = so3.matrix_from_quat(match.quaternion[rows])
    across = np.minimum(0.05, match.sigma_along[rows]) ** 2
    V = observation_covariance(R_nb, match.sigma_along[rows] ** 2, across, across)
    return [
        MatchObservation(
            float(match.time_s[i]),
            match.position[i],
            match.quaternion[i],
            V[k],
            float(match.chainage[i]),
        )
        for k, i in enumerate(rows)
    ]


class _Runner:
    """Runs methods over one recording and keeps what several of them share."""

    def __init__(
        self,
        imu: ImuSeries,
        design: DesignRide,
        config: CoasterConfig,
        learned: LearnedLine | None = None,
    ) -> None:
        self.imu = apply_mount(imu, config.mount_rpy_deg)
        self.design = design
        self.line = LineTable(Centreline.from_design_ride(design))
        self.config = config
        self.learned = learned
        self._matches: dict[str, tuple[Match, float]] = {}
        self._filtered: dict[str, tuple[CoasterEskf, Trajectory, float]] = {}
        self._tracked: FilteredRide | None = None

    def run(self, name: str) -> MethodResult:
        """Run one method; raise KeyError for a name that is not a method's."""
        if name in MATCHING:
            return self._matching(name)
        if name in TRACK_METHODS:
            return self._track_filter(name)
        fed_by = {'eskf_smoothed': self.front_end, 'eskf_srdtw': SEGMENT_FRONT_END}
        if name in fed_by:
            return self._smoothed(name, fed_by[name])
        return {
            'imu': self._imu_only,
            'eskf_paper': self._paper,
            'eskf_live': self._live,
            'eskf': self._default,
        }[name]()

    @property
    def front_end(self) -> str:
        """The matching method that the configuration feeds to the filter."""
        wanted = (self.config.matcher.method, self.config.matcher.channel)
        names = [n for n, pair in MATCHING.items() if pair == wanted and n != PAPER_FRONT_END]
        return names[0] if names else '_'.join(wanted)

    def match(self, name: str) -> tuple[Match, float]:
        """Return a match and the seconds it took (once)."""
        if name not in self._matches:
            config = self.config.matcher
            method, channel = MATCHING.get(name, (config.method, config.channel))
            begin = time.perf_counter()
            if name == PAPER_FRONT_END:
                config = override(config, PAPER_MATCHER)
            match = match_ride(self.imu, self.design, method, channel, config)
            self._matches[name] = (match, time.perf_counter() - begin)
        return self._matches[name]

    def _matching(self, name: str) -> MethodResult:
        match, seconds = self.match(name)
        R_nb = so3.matrix_from_quat(match.quaternion)
        across = np.minimum(0.05, match.sigma_along) ** 2
        dt = np.gradient(match.time_s)
        velocity = np.gradient(match.position, axis=0) / dt[:, None]
        trajectory = Trajectory(
            time_s=match.time_s,
            position=match.position,
            quaternion=match.quaternion,
            velocity=velocity,
            chainage=match.chainage,
            speed=np.linalg.norm(velocity, axis=1),
            covariance=observation_covariance(R_nb, match.sigma_along**2, across, across),
            sigma_along=match.sigma_along,
        )
        runtime = {'matching': seconds}
        return MethodResult(name, trajectory, match, None, {}, runtime, match.notes)

    def _filter(self, **changes: Any) -> CoasterEskf:
        config = dataclasses.replace(self.config.eskf, **changes)
        return CoasterEskf(self.design, config, self.line)

    def _imu_only(self) -> MethodResult:
        begin = time.perf_counter()
        filter_ = self._filter(preset='paper')
        trajectory = estimates_to_trajectory(run_filter(filter_, self.imu, []), self.line)
        seconds = time.perf_counter() - begin
        return MethodResult('imu', trajectory, None, None, filter_.rejected, {'filter': seconds})

    def _paper(self) -> MethodResult:
        match, match_s = self.match(PAPER_FRONT_END)
        begin = time.perf_counter()
        filter_ = self._filter(preset='paper')
        feed = observations(match, self.config.matcher.rate_hz)
        trajectory = estimates_to_trajectory(run_filter(filter_, self.imu, feed), self.line)
        runtime = {'matching': match_s, 'filter': time.perf_counter() - begin}
        return MethodResult(
            'eskf_paper', trajectory, match, PAPER_FRONT_END, filter_.rejected, runtime
        )

    def _live(self) -> MethodResult:
        begin = time.perf_counter()
        matcher = OnlineMatcher(self.design, self.config.matcher)
        filter_ = self._filter()
        estimates = []
        for i in range(len(self.imu)):
            sample = self.imu.sample(i)
            estimates += filter_.push(sample)
            for observation in matcher.push(sample):
                filter_.push(observation)
        trajectory = estimates_to_trajectory(estimates, self.line)
        runtime = {'matching and filter': time.perf_counter() - begin}
        rejected = filter_.rejected | {'matcher': dict(matcher.rejected)}
        method = self.config.matcher.method
        notes = () if method == LIVE_MATCHER else (f'matcher.method {method}: {ONLY_LIVE}',)
        return MethodResult('eskf_live', trajectory, None, None, rejected, runtime, notes)

    def _run_default(self, fed_by: str) -> tuple[CoasterEskf, Trajectory, float]:
        if fed_by not in self._filtered:
            match, _ = self.match(fed_by)
            begin = time.perf_counter()
            filter_ = self._filter(history_s=WHOLE_RIDE_S)
            feed = observations(match, self.config.matcher.observation_rate_hz)
            trajectory = estimates_to_trajectory(run_filter(filter_, self.imu, feed), self.line)
            self._filtered[fed_by] = (filter_, trajectory, time.perf_counter() - begin)
        return self._filtered[fed_by]

    def _default(self) -> MethodResult:
        filter_, trajectory, seconds = self._run_default(self.front_end)
        match, match_s = self.match(self.front_end)
        runtime = {'matching': match_s, 'filter': seconds}
        return MethodResult('eskf', trajectory, match, self.front_end, filter_.rejected, runtime)

    def _smoothed(self, name: str, fed_by: str) -> MethodResult:
        filter_, _, filter_s = self._run_default(fed_by)
        match, match_s = self.match(fed_by)
        begin = time.perf_counter()
        trajectory = smooth(filter_)
        runtime = {
            'matching': match_s,
            'filter': filter_s,
            'smoothing': time.perf_counter() - begin,
        }
        return MethodResult(name, trajectory, match, fed_by, filter_.rejected, runtime)

    def _track_filter(self, name: str) -> MethodResult:
        config = self.config.track_filter
        if self._tracked is None:
            line, start_m = (
                line_map(self.design, config, self.learned),
                float(self.design.chainage[0]),
            )
            self._tracked = filter_ride(self.imu, line, start_m, config)
        ride = self._tracked
        begin = time.perf_counter()
        trajectory = {
            'track_filter': ride.live,
            'track_filter_lag': ride.lagged,
            'track_filter_smoothed': ride.smoothed,
        }[name]()
        stage = 'output' if name == 'track_filter' else 'smoothing'
        runtime = {'filter': ride.runtime_s, stage: time.perf_counter() - begin}
        R_left, sigma = ride.mount
        mount = R_left @ so3.matrix_from_rpy(*np.deg2rad(self.config.mount_rpy_deg)), sigma
        return MethodResult(name, trajectory, None, None, ride.rejected, runtime, mount=mount)

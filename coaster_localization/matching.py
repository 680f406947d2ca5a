"""Match a whole recorded ride against the design ride (paper 1, sections 1 and 2.1)."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from coaster_localization import dtw, srdtw
from coaster_localization.channels import Grid, comparable, mount_heading, sample_channels
from coaster_localization.config import CHANNELS, MATCHERS, MatcherConfig
from coaster_localization.pace import even_pace
from coaster_localization.quality import match_spread
from coaster_localization.segments import matched_cut_points
from coaster_localization.sensed import Motion, design_motion, measured_motion
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

SPREAD_HZ = 10.0
"""Rate at which a match's spread is judged."""
FLAG_ABOVE = 0.05
"""Probability of a gross mismatch above which a sample is flagged."""
SLOWEST_MPS = 0.3
"""Speed below which a delay is no longer told from a distance."""


@dataclasses.dataclass(frozen=True)
class Match:
    """
    Where on the design ride each sample of the recording belongs.

    Attributes:
        method: matching algorithm, a name of MATCHERS.
        channel: what was compared, a name of CHANNELS.
        time_s: (N,) recording's clock, on the matching grid, from rest to rest [s].
        design_time_s: (N,) the design ride's clock there [s].
        position: (N, 3) on the design line, in ``map`` [m].
        chainage: (N,) [m].
        quaternion: (N, 4) x, y, z, w, of the design, body to map.
        sigma_along: (N,) standard deviation along the track [m].
        flagged: (N,) bool, suspected of a gross mismatch.
        path: (L, 2) int, pairs of rows of ``measured`` and ``design``.
        cuts: (K, 2) int, limits of the groups that SRDTW chose, likewise; None for the others.
        measured: (N, C) series compared.
        design: (M, C) series compared.
        design_grid_s: (M,) the design ride's clock at rows of ``design`` [s].
        held: (N,) bool, where the train stood still.
        notes: what a reader should know: fallbacks, missing rests.
        as_matched: the same by the paper's rule alone, before it was evened; None if it was not.
    """

    method: str
    channel: str
    time_s: Array
    design_time_s: Array
    position: Array
    chainage: Array
    quaternion: Array
    sigma_along: Array
    flagged: NDArray[np.bool_]
    path: IntArray
    cuts: IntArray | None
    measured: Array
    design: Array
    design_grid_s: Array
    held: NDArray[np.bool_]
    notes: tuple[str, ...] = ()
    as_matched: Match | None = None


@dataclasses.dataclass(frozen=True)
class _Pair:
    """
    The two rides made comparable.

    Attributes:
        measured, planned: their grids.
        a, b: (N, C), (M, C) their channels, scaled alike.
        open_begin, open_end: whether the recording may be cut off there.
    """

    measured: Grid
    planned: Grid
    a: Array
    b: Array
    open_begin: bool
    open_end: bool

    def features(self, config: MatcherConfig, rate_hz: float) -> tuple[Array, Array]:
        """Return channels, weighted derivatives, and whether the train stands, as columns."""
        kd, weight = config.derivative_weight, config.standing_weight
        a, b = (
            np.hstack([dtw.with_derivative(x, rate_hz, kd), weight * grid.standing[:, None]])
            for x, grid in ((self.a, self.measured), (self.b, self.planned))
        )
        return a, b


def match_ride(
    imu: ImuSeries, design: DesignRide, method: str, channel: str, config: MatcherConfig
) -> Match:
    """
    Match a recording, in about the body's axes, against the design ride.

    ``method`` is a name of MATCHERS, ``channel`` of CHANNELS; they stand above those in
    ``config``. A recording that does not rest at an end is matched openly there: it may begin or
    end anywhere in the design ride. Raise DataError for data that cannot be matched at all.
    """
    if method not in MATCHERS or channel not in CHANNELS:
        raise DataError(
            f'matcher {method!r} on {channel!r}: methods are {", ".join(MATCHERS)}, '
            f'channels {", ".join(CHANNELS)}'
        )
    sensed, planned = measured_motion(imu, design), design_motion(design)
    notes = sensed.notes
    if channel == 'multi' and config.heading and sensed.has_gyro:
        heading = _find_heading(sensed, planned, config)
        sensed = sensed.turned(heading)
        notes += (f'mount heading corrected by {np.rad2deg(heading):+.1f} deg',)
    cut_hz = config.segment_low_pass_hz if method == 'srdtw' else config.low_pass_hz
    pair = _pair(sensed, planned, channel, config.rate_hz, cut_hz, config)
    path, cuts = None, None
    if method == 'srdtw':
        path, cuts, more = _segments(pair, config)
        notes += more
    elif method in ('dtw', 'dtw_derivative'):
        path = _plain(pair, method, config)
    if path is None:
        path = _penalised(pair, config, config.rate_hz)
    match = _matched(method, channel, pair, path, cuts, design, config, notes)
    return evened(match, design, config) if method == 'srdtw' and config.pace_walk else match


def _pair(
    sensed: Motion,
    planned: Motion,
    channel: str,
    rate_hz: float,
    cut_hz: float,
    config: MatcherConfig,
) -> _Pair:
    grids = [
        sample_channels(motion, channel, rate_hz, cut_hz, config.rest_s)
        for motion in (sensed, planned)
    ]
    a, b = comparable(grids[0].values, grids[1].values, channel)
    begin, end = (mine < design for mine, design in zip(sensed.rests, planned.rests, strict=True))
    return _Pair(grids[0], grids[1], a, b, begin, end)


def _find_heading(sensed: Motion, planned: Motion, config: MatcherConfig) -> float:
    """Match by what no heading changes, coarsely; return the heading that the rest shows [rad]."""
    rate = min(25.0, config.rate_hz)
    path = _penalised(
        _pair(sensed, planned, 'heading_free', rate, config.low_pass_hz, config), config, rate
    )
    across = [
        sample_channels(motion, 'across', rate, config.low_pass_hz, config.rest_s).values
        for motion in (sensed, planned)
    ]
    return mount_heading(across[0][path[:, 0]], across[1][path[:, 1]])


def _plain(pair: _Pair, method: str, config: MatcherConfig) -> IntArray:
    """Run DTW without penalties, on the series or on their derivatives."""
    a, b = pair.a, pair.b
    if method == 'dtw_derivative':
        a, b = dtw.derivative(a, config.rate_hz), dtw.derivative(b, config.rate_hz)
    return dtw.align(a, b, open_begin=pair.open_begin, open_end=pair.open_end).path


def _penalised(pair: _Pair, config: MatcherConfig, rate_hz: float) -> IntArray:
    """Run DTW with derivatives and a price for every step that is not diagonal."""
    a, b = pair.features(config, rate_hz)
    ends = pair.open_begin, pair.open_end
    return dtw.align(a, b, config.step_penalty, pair.measured.held, *ends).path


def _segments(
    pair: _Pair, config: MatcherConfig
) -> tuple[IntArray | None, IntArray | None, tuple[str, ...]]:
    """Run SRDTW; return path, limits of the groups, notes. No path: no recombination fits."""
    first, stop = 0, len(pair.b)
    notes: tuple[str, ...] = ()
    if pair.open_begin or pair.open_end:
        path = _penalised(pair, config, config.rate_hz)
        first, stop = int(path[0, 1]), int(path[-1, 1]) + 1
        notes = (f'recording cut off: matched rows {first} to {stop} of the design only',)
    a, b = pair.a, pair.b[first:stop]
    cuts_a, cuts_b = matched_cut_points(a[:, 0], b[:, 0], config.prominence, config.plateau)
    found = srdtw.align_segments(
        dtw.with_derivative(a, config.rate_hz, config.derivative_weight),
        dtw.with_derivative(b, config.rate_hz, config.derivative_weight),
        cuts_a,
        cuts_b,
        config.rate_hz,
        srdtw.GlobalPenalty(config.penalty_form, config.penalty_value),
        config.segment_step_penalty,
    )
    if found is None:
        notes += (
            f'srdtw: {len(cuts_a) - 1} measured segments cannot be recombined with '
            f'{len(cuts_b) - 1} of the design; matched by dtw_penalised instead',
        )
        return None, None, notes
    shift = np.array([0, first])
    return found.path + shift, found.corners + shift, notes


def _matched(
    method: str,
    channel: str,
    pair: _Pair,
    path: IntArray,
    cuts: IntArray | None,
    design: DesignRide,
    config: MatcherConfig,
    notes: tuple[str, ...],
) -> Match:
    """Turn a path into positions: the mean of a sample's first and last partner (section 2.1)."""
    rows = np.arange(len(pair.a))
    first = path[np.searchsorted(path[:, 0], rows, side='left'), 1]
    last = path[np.searchsorted(path[:, 0], rows, side='right') - 1, 1]
    on_grid = design.at(pair.planned.time_s)
    tau = 0.5 * (pair.planned.time_s[first] + pair.planned.time_s[last])
    chainage = 0.5 * (on_grid.chainage[first] + on_grid.chainage[last])
    a, b = pair.features(config, config.rate_hz)
    step = max(1, round(config.rate_hz / SPREAD_HZ))
    spread, doubt = match_spread(
        a[::step],
        b[::step],
        chainage[::step],
        on_grid.chainage[::step],
        pair.measured.held[::step],
        config.doubt_m,
        (pair.open_begin, pair.open_end),
    )
    t = pair.measured.time_s
    spread, doubt = (np.interp(t, t[::step], x) for x in (spread, doubt))
    return Match(
        method=method,
        channel=channel,
        time_s=t,
        design_time_s=tau,
        position=0.5 * (on_grid.position[first] + on_grid.position[last]),
        chainage=chainage,
        quaternion=design.at(tau).quaternion,
        sigma_along=np.hypot(spread, config.sigma_floor_m),
        flagged=doubt > FLAG_ABOVE,
        path=path,
        cuts=cuts,
        measured=pair.a,
        design=pair.b,
        design_grid_s=pair.planned.time_s,
        held=pair.measured.held,
        notes=notes,
    )


def evened(match: Match, design: DesignRide, config: MatcherConfig) -> Match:
    """
    Return the match with its delay against the design evened out by the train's pace.

    The paper has nothing like it. The result's errors are smaller and last longer.
    """
    speed = np.maximum(design.at(match.design_time_s).speed, SLOWEST_MPS)
    walk = np.hypot(config.pace_walk, config.accel_walk / speed)
    walk = np.where(maximum_filter1d(match.held, 2 * round(config.rate_hz) + 1), 1.0, walk)
    delay, sigma_s = even_pace(
        match.design_time_s - match.time_s,
        match.sigma_along / speed,
        walk,
        1.0 / config.rate_hz,
        np.maximum(config.match_correlation_s, config.match_correlation_m / speed),
    )
    tau = np.maximum.accumulate(match.time_s + delay)
    at = design.at(tau)
    return dataclasses.replace(
        match,
        design_time_s=tau,
        position=at.position,
        chainage=at.chainage,
        quaternion=at.quaternion,
        sigma_along=np.hypot(sigma_s * np.maximum(at.speed, SLOWEST_MPS), config.sigma_floor_m),
        as_matched=match,
    )

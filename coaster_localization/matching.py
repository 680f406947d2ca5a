"""Match a whole recorded ride against the design ride (paper 1, sections 1 and 2.1)."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from coaster_localization import dtw, srdtw
from coaster_localization.channels import Grid, comparable, mount_heading, sample_channels
from coaster_localization.config import CHANNELS, MATCHERS, MatcherConfig
from coaster_localization.quality import sigma_along
from coaster_localization.segments import matched_cut_points
from coaster_localization.sensed import Motion, design_motion, measured_motion
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
        notes: what a reader should know: fallbacks, missing rests.
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
    notes: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class _Warp:
    """A path over the grids, the groups' limits if any, and what was noted."""

    path: IntArray
    cuts: IntArray | None
    notes: tuple[str, ...] = ()


def match_ride(
    imu: ImuSeries,
    design: DesignRide,
    method: str,
    channel: str,
    config: MatcherConfig,
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
    grids = tuple(
        sample_channels(motion, channel, config.rate_hz, cut_hz, config.rest_s)
        for motion in (sensed, planned)
    )
    a, b = comparable(grids[0].values, grids[1].values, channel)
    ends = _open_ends(sensed, planned)
    warp = _warp(method, a, b, grids[0].held, ends, config)
    return _result(method, channel, warp, grids, (a, b), ends, design, config, notes)


def _open_ends(sensed: Motion, planned: Motion) -> tuple[bool, bool]:
    """Return at which ends the recording may be cut off."""
    begin, end = (mine < design for mine, design in zip(sensed.rests, planned.rests, strict=True))
    return begin, end


def _find_heading(sensed: Motion, planned: Motion, config: MatcherConfig) -> float:
    """Match by what no heading changes, coarsely; return the heading that the rest shows [rad]."""
    rate = min(25.0, config.rate_hz)
    grids = [
        sample_channels(motion, 'heading_free', rate, config.low_pass_hz, config.rest_s)
        for motion in (sensed, planned)
    ]
    a, b = comparable(grids[0].values, grids[1].values, 'heading_free')
    path = _penalised(a, b, grids[0].held, _open_ends(sensed, planned), rate, config)
    across = [
        sample_channels(motion, 'across', rate, config.low_pass_hz, config.rest_s).values
        for motion in (sensed, planned)
    ]
    return mount_heading(across[0][path[:, 0]], across[1][path[:, 1]])


def _warp(
    method: str,
    a: Array,
    b: Array,
    held: NDArray[np.bool_],
    ends: tuple[bool, bool],
    config: MatcherConfig,
) -> _Warp:
    """Run the algorithm on comparable series."""
    if method == 'srdtw':
        return _segments(a, b, held, ends, config)
    if method == 'dtw_penalised':
        return _Warp(_penalised(a, b, held, ends, config.rate_hz, config), None)
    if method == 'dtw_derivative':
        a, b = (dtw.derivative(x, config.rate_hz) for x in (a, b))
    return _Warp(dtw.align(a, b, open_begin=ends[0], open_end=ends[1]).path, None)


def _penalised(
    a: Array,
    b: Array,
    held: NDArray[np.bool_],
    ends: tuple[bool, bool],
    rate_hz: float,
    config: MatcherConfig,
) -> IntArray:
    a, b = (dtw.with_derivative(x, rate_hz, config.derivative_weight) for x in (a, b))
    return dtw.align(a, b, config.step_penalty, held, *ends).path


def _segments(
    a: Array,
    b: Array,
    held: NDArray[np.bool_],
    ends: tuple[bool, bool],
    config: MatcherConfig,
) -> _Warp:
    """Run SRDTW; where it has no answer, the penalised DTW, and say so."""
    first, stop = 0, len(b)
    notes: tuple[str, ...] = ()
    if any(ends):
        path = _penalised(a, b, held, ends, config.rate_hz, config)
        first, stop = int(path[0, 1]), int(path[-1, 1]) + 1
        notes = (f'recording cut off: matched rows {first} to {stop} of the design only',)
    piece = b[first:stop]
    cuts_a, cuts_b = matched_cut_points(a[:, 0], piece[:, 0], config.prominence)
    found = srdtw.align_segments(
        dtw.with_derivative(a, config.rate_hz, config.derivative_weight),
        dtw.with_derivative(piece, config.rate_hz, config.derivative_weight),
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
        return _Warp(_penalised(a, b, held, ends, config.rate_hz, config), None, notes)
    shift = np.array([0, first])
    return _Warp(found.path + shift, found.corners + shift, notes)


def _result(
    method: str,
    channel: str,
    warp: _Warp,
    grids: tuple[Grid, ...],
    series: tuple[Array, Array],
    ends: tuple[bool, bool],
    design: DesignRide,
    config: MatcherConfig,
    notes: tuple[str, ...],
) -> Match:
    """Turn a path into positions: the mean of a sample's first and last partner (section 2.1)."""
    measured, planned = grids
    rows = np.arange(len(measured))
    first = warp.path[np.searchsorted(warp.path[:, 0], rows, side='left'), 1]
    last = warp.path[np.searchsorted(warp.path[:, 0], rows, side='right') - 1, 1]
    tau = 0.5 * (planned.time_s[first] + planned.time_s[last])
    if config.smooth_s > 0.0:
        late = gaussian_filter1d(
            tau - measured.time_s, config.smooth_s * config.rate_hz, mode='nearest'
        )
        tau = np.maximum.accumulate(measured.time_s + late)
    at = design.at(tau)
    position, chainage = at.position, at.chainage
    if config.smooth_s == 0.0:
        on_grid = design.at(planned.time_s)
        position = 0.5 * (on_grid.position[first] + on_grid.position[last])
        chainage = 0.5 * (on_grid.chainage[first] + on_grid.chainage[last])
    sigma, flagged = sigma_along(series, tau, at, measured, planned, design, ends, config)
    return Match(
        method=method,
        channel=channel,
        time_s=measured.time_s,
        design_time_s=tau,
        position=position,
        chainage=chainage,
        quaternion=at.quaternion,
        sigma_along=sigma,
        flagged=flagged,
        path=warp.path,
        cuts=warp.cuts,
        measured=series[0],
        design=series[1],
        design_grid_s=planned.time_s,
        notes=notes + warp.notes,
    )

"""Figures of the coaster's methods: from results, truth and markers to metrics.json."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coaster_localization.matching import Match
from coaster_localization.methods import MethodResult
from track_localization.estimation import so3
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.clock import fit_clock_offset
from track_localization.evaluation.metrics import (
    GROSS_M,
    MarkerErrors,
    RideErrors,
    marker_errors,
    marker_figures,
    moving,
    present,
    ride_errors,
    ride_figures,
)
from track_localization.evaluation.tabulate import Table
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

CLOCK_OFFSET_WORTH_S = 0.02
"""A fitted offset of the markers' clock above this is told [s]."""


@dataclasses.dataclass(frozen=True)
class Reference:
    """
    What estimates are held against; either may be absent.

    Attributes:
        truth: where the vehicle was, its chainage along the design line.
        floor: the point of the design line nearest to the truth, the best that a map can give.
        marker_time_s: (K,) times of passing markers [s]; empty without markers.
        marker_position: (K, 3) their design positions [m].
    """

    truth: Trajectory | None
    floor: Trajectory | None
    marker_time_s: Array
    marker_position: Array

    @classmethod
    def of(
        cls,
        truth: Trajectory | None,
        design: DesignRide,
        time_s: Array | None = None,
        position: Array | None = None,
    ) -> Reference:
        """Make it from the truth, the design ride, and the markers' times and positions."""
        floor = None
        if truth is not None:
            line = Centreline.from_design_ride(design)
            s = line.nearest(truth.position)
            floor = Trajectory(truth.time_s, line.position(s))
            if line.closed:
                s = np.unwrap(s, period=line.length)
            truth = dataclasses.replace(truth, chainage=s)
        if time_s is None or position is None:
            time_s, position = np.empty(0), np.empty((0, 3))
        return cls(truth, floor, time_s, position)

    def ride(self, estimate: Trajectory) -> RideErrors | None:
        """Return the errors over the ride, None without a truth."""
        return None if self.truth is None else ride_errors(estimate, self.truth)

    def markers(self, estimate: Trajectory) -> MarkerErrors:
        """Return the errors at the markers, empty without markers."""
        return marker_errors(estimate, self.marker_time_s, self.marker_position, self.truth)


def figures(result: MethodResult, reference: Reference, duration_s: float) -> dict[str, Any]:
    """Return what metrics.json says about one method; see ARCHITECTURE.md for the names."""
    out: dict[str, Any] = {}
    ride = reference.ride(result.trajectory)
    if ride is not None:
        out |= ride_figures(ride)
    floor = reference.markers(reference.floor) if reference.floor is not None else None
    at_markers = reference.markers(result.trajectory)
    out |= marker_figures(at_markers, floor)
    if len(at_markers.design):
        out |= _clock(result.trajectory, reference)
    if result.mount is not None:
        R_bm, sigma = result.mount
        out['mount_rpy_deg'] = list(rpy_deg(R_bm))
        out['mount_sigma_deg'] = float(np.rad2deg(sigma))
    if result.match is not None:
        out |= {'match': _match_figures(result.match, reference)}
        if result.fed_by is not None:
            out['fed_by'] = result.fed_by
            fed = _fed_figures(result.match, reference)
            out['fed'] = fed
            out['ratio_to_matching'] = _ratios(out, fed)
    seconds = sum(result.runtime_s.values())
    out['runtime_s'], out['stages'] = seconds, dict(result.runtime_s)
    out['real_time_factor'] = seconds / duration_s if duration_s > 0.0 else None
    out = present(out)
    out['rejected'] = {sensor: dict(counts) for sensor, counts in result.rejected.items()}
    return out


def floor_figures(reference: Reference) -> dict[str, Any]:
    """Return the figures of the nearest point of the design line: the floor under all methods."""
    if reference.floor is None:
        return {}
    out: dict[str, Any] = {}
    ride = reference.ride(reference.floor)
    if ride is not None:
        out['position_m'] = ride_figures(ride).get('position_m')
    return present(out | marker_figures(reference.markers(reference.floor)))


def table(metrics: dict[str, dict[str, Any]], title: str) -> Table:
    """Return the methods' figures as a table; columns that no method fills are left out."""
    columns: list[tuple[str, tuple[str, ...]]] = [
        ('mean', ('position_m', 'mean')),
        ('median', ('position_m', 'median')),
        ('95 %', ('position_m', 'p95')),
        ('max', ('position_m', 'max')),
        ('along 95 %', ('along_m', 'p95')),
        ('cross 95 %', ('cross_m', 'p95')),
        ('markers mean', ('markers_m', 'mean')),
        ('markers max', ('markers_m', 'max')),
        ('fused/match', ('ratio_to_matching', 'markers_m')),
        ('speed mean [m/s]', ('speed_mps', 'mean')),
        ('NEES/3', ('nees_position_over_3',)),
        ('in 2 sigma', ('inside_2_sigma',)),
        ('run time [s]', ('runtime_s',)),
    ]
    used = [(c, path) for c, path in columns if any(_dig(m, path) for m in metrics.values())]
    rows = [[name, *(_dig(m, path) for _, path in used)] for name, m in metrics.items()]
    return Table(title, ['method', *(c for c, _ in used)], rows)


def match_trajectory(match: Match) -> Trajectory:
    """Return where a match puts the vehicle, with its own sigma."""
    return Trajectory(
        match.time_s, match.position, chainage=match.chainage, sigma_along=match.sigma_along
    )


def rpy_deg(R_bm: Array) -> tuple[float, float, float]:
    """
    Return roll, pitch, yaw [deg] of a mount (3, 3) as ``mount_rpy_deg`` takes them.

    At a pitch of +-90 deg roll and yaw turn about one axis: all of it is given as roll.
    """
    yaw, pitch, roll = (float(angle) for angle in so3.euler_zyx(R_bm))
    if np.hypot(R_bm[0, 0], R_bm[1, 0]) < 1e-6:
        yaw, roll = 0.0, float(np.arctan2(-R_bm[1, 2], R_bm[1, 1]))
    return float(np.rad2deg(roll)), float(np.rad2deg(pitch)), float(np.rad2deg(yaw))


def _match_figures(match: Match, reference: Reference) -> dict[str, float]:
    """Return how gross mismatches were flagged and covered, over the moving ride."""
    out = {'flagged_share': float(match.flagged.mean())}
    if reference.truth is None:
        return out
    truth = reference.truth[moving(reference.truth)]
    if len(truth) < 2:
        return out
    i = np.searchsorted(truth.time_s, match.time_s)
    near = np.abs(truth.time_s[np.minimum(i, len(truth) - 1)] - match.time_s) < 0.1
    error = np.linalg.norm(match.position - truth.position_at(match.time_s), axis=1)
    used = near & np.isfinite(error)
    gross = used & (error > GROSS_M)
    out['gross_share'] = float(gross[used].mean()) if used.any() else float('nan')
    if gross.any():
        covered = error <= 3.0 * match.sigma_along
        out['gross_flagged'] = float(match.flagged[gross].mean())
        out['gross_inside_3_sigma'] = float(covered[gross].mean())
        out['gross_flagged_or_covered'] = float((match.flagged | covered)[gross].mean())
    return out


def _fed_figures(match: Match, reference: Reference) -> dict[str, Any]:
    """Return the figures of the match that a filter was fed, with which its own are compared."""
    fed = match_trajectory(match)
    out = marker_figures(reference.markers(fed))
    ride = reference.ride(fed)
    if ride is not None:
        out |= ride_figures(ride)
    return {name: out[name] for name in ('markers_m', 'position_m') if name in out}


def _ratios(own: dict[str, Any], fed: dict[str, Any]) -> dict[str, float]:
    ratios = {}
    for name in ('markers_m', 'position_m'):
        mine, other = _dig(own, (name, 'mean')), _dig(fed, (name, 'mean'))
        if mine is not None and other:
            ratios[name] = mine / other
    return ratios


def _clock(estimate: Trajectory, reference: Reference) -> dict[str, float]:
    clock = fit_clock_offset(estimate, reference.marker_time_s, reference.marker_position)
    if not np.isfinite(clock.offset_s):
        return {}
    return {
        'markers_clock_offset_s': clock.offset_s,
        'markers_clock_offset_sigma_s': clock.sigma_s,
        'markers_after_offset_mean_m': float(np.nanmean(clock.distance)),
    }


def _dig(content: dict[str, Any], path: tuple[str, ...]) -> float | None:
    value: Any = content
    for name in path:
        value = value.get(name) if isinstance(value, dict) else None
    return value if isinstance(value, int | float) else None

"""The goals of the roller coaster, each with what it asks, what was measured, and whether met."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from track_localization.cli.coaster.reproduce_rides import SMALL_MOUNT_DEG, Ride
from track_localization.cli.goals import Goal, at_most

Array = NDArray[np.float64]

MARKERS = 'markers_m.mean'
NAN = float('nan')


class Rides:
    """Rides of one kind, and statistics over them."""

    def __init__(self, rides: Sequence[Ride]) -> None:
        self.all = [ride for ride in rides if 'failed' not in ride.about]

    @property
    def tracks(self) -> list[str]:
        """Names of the tracks, in the order they came."""
        return list(dict.fromkeys(ride.track for ride in self.all))

    def on(self, track: str) -> Rides:
        """Return those on one track."""
        return Rides([ride for ride in self.all if ride.track == track])

    def where(self, keep: Callable[[Ride], bool]) -> Rides:
        """Return those for which ``keep`` holds."""
        return Rides([ride for ride in self.all if keep(ride)])

    def values(self, method: str, figure: str) -> Array:
        """Return a figure of every ride that has it."""
        found = (ride.methods.get(method, {}).get(figure) for ride in self.all)
        return np.array([v for v in found if isinstance(v, float)], dtype=np.float64)

    def about(self, figure: str) -> Array:
        """Return a figure of the rides themselves, of every ride that has it."""
        found = (ride.about.get(figure) for ride in self.all)
        return np.array([v for v in found if isinstance(v, float)], dtype=np.float64)

    def median(self, method: str, figure: str = MARKERS) -> float:
        """Return the median over rides; NaN without any."""
        values = self.values(method, figure)
        return float(np.median(values)) if len(values) else NAN

    def mean(self, method: str, figure: str = MARKERS) -> float:
        """Return the mean over rides; NaN without any."""
        values = self.values(method, figure)
        return float(np.mean(values)) if len(values) else NAN

    def weighted(self, method: str, figure: str, weight: str) -> float:
        """Return the mean over rides, weighted; NaN where no ride has both or weights are zero."""
        pairs = [
            (entry[figure], entry[weight])
            for ride in self.all
            if figure in (entry := ride.methods.get(method, {})) and weight in entry
        ]
        total = sum(float(w) for _, w in pairs)
        return sum(float(v) * float(w) for v, w in pairs) / total if total > 0.0 else NAN


def goals(nominal: Rides, small_mount: Rides) -> list[Goal]:
    """
    Return every goal.

    Args:
        nominal: the rides of the exam.
        small_mount: further rides whose mount is exactly SMALL_MOUNT_DEG off.
    """
    return [
        *_matching(nominal),
        *_fused(nominal, small_mount),
        *_gross(nominal),
        *_consistency(nominal),
        *_findings(nominal),
    ]


def mount_of(ride: Ride) -> float:
    """Return the angle by which the ride's sensor was turned [deg]."""
    value = ride.about.get('mount_deg')
    return value if isinstance(value, float) else NAN


def _matching(nominal: Rides) -> list[Goal]:
    z = nominal.median('srdtw_z')
    both_run = np.isfinite(z) and np.isfinite(nominal.median('dtw_z'))
    worse = [
        f'{t} {nominal.on(t).median("srdtw_z"):.3f} against {nominal.on(t).median("dtw_z"):.3f}'
        for t in nominal.tracks
        if not nominal.on(t).median('srdtw_z') < nominal.on(t).median('dtw_z')
    ]
    multi = nominal.median('srdtw_multi')
    penalised = nominal.median('dtw_penalised')
    fed = sorted({str(r.methods.get('eskf', {}).get('fed_by', '')) for r in nominal.all} - {''})
    ours, segments = (
        nominal.median(name, 'position_m.mean') for name in ('eskf_smoothed', 'eskf_srdtw')
    )
    better = 'dtw_penalised' if ours <= segments else 'srdtw_multi'
    return [
        Goal(
            'srdtw_z at markers, median over rides',
            '<= 0.46 m',
            f'{z:.3f} m (mean {nominal.mean("srdtw_z"):.3f}; the paper 0.445)',
            at_most(z, 0.46),
        ),
        Goal(
            'srdtw_z better than dtw_z, median of every track',
            'all tracks',
            'worse: ' + '; '.join(worse) if worse else f'all {len(nominal.tracks)}',
            not worse if both_run else None,
        ),
        Goal('srdtw_multi at markers, median', '<= 0.30 m', f'{multi:.3f} m', at_most(multi, 0.30)),
        Goal(
            'dtw_penalised beside it; the better front end, by the ride smoothed with it, is the '
            'default',
            'default = better',
            f'{penalised:.3f} m; default: {", ".join(fed) or "?"}; smoothed ride {ours:.3f} m, '
            f'with srdtw_multi {segments:.3f} m (markers {nominal.median("eskf_smoothed"):.3f}, '
            f'{nominal.median("eskf_srdtw"):.3f})',
            fed == [better] if fed and not np.isnan(ours + segments) else None,
        ),
    ]


def _fused(nominal: Rides, small_mount: Rides) -> list[Goal]:
    natural = nominal.where(lambda r: mount_of(r) <= SMALL_MOUNT_DEG)
    small = Rides([*natural.all, *small_mount.all])
    which = (
        f'mount within {SMALL_MOUNT_DEG:g} deg: {len(natural.all)} nominal rides and '
        f'{len(small_mount.all)} with exactly that angle'
    )
    smoothed = small.median('eskf_smoothed')
    fed = small.median('eskf_smoothed', 'fed.' + MARKERS)
    each = small.median('eskf_smoothed', 'ratio_to_matching.markers_m')
    ratio = smoothed / fed if fed > 0.0 else NAN
    worst, where = _worst_ratio(nominal)
    live = nominal.median('eskf_live', 'position_m.mean')
    everywhere = nominal.median('eskf_smoothed')
    return [
        Goal(
            f'eskf_smoothed at markers, median ({which})',
            '<= 0.24 m',
            f'{smoothed:.3f} m (all nominal rides: {everywhere:.3f})',
            at_most(smoothed, 0.24),
        ),
        Goal(
            'the same over the matching it was fed, medians of those rides',
            '<= 0.55',
            f'{ratio:.2f} (match {fed:.3f} m; median of the ratios {each:.2f})',
            at_most(ratio, 0.55),
        ),
        Goal(
            'eskf_smoothed over that matching, medians of any track, all rides',
            '<= 1.05',
            f'{worst:.2f} at worst ({where})',
            at_most(worst, 1.05),
        ),
        Goal(
            'eskf_live over the ride: mean of a ride, median over rides',
            '<= 1.5 m',
            f'{live:.2f} m (mean over rides {nominal.mean("eskf_live", "position_m.mean"):.2f})',
            at_most(live, 1.5),
        ),
    ]


def _worst_ratio(nominal: Rides) -> tuple[float, str]:
    """Return the greatest eskf_smoothed / match of any track, by medians, and that track."""
    ratios = {}
    for track in nominal.tracks:
        rides = nominal.on(track)
        theirs = rides.median('eskf_smoothed', 'fed.' + MARKERS)
        if theirs > 0.0:
            ratios[track] = rides.median('eskf_smoothed') / theirs
    where = max(ratios, key=lambda track: ratios[track], default='')
    return ratios.get(where, NAN), where


def gross(nominal: Rides, method: str) -> tuple[float, float, float, float]:
    """
    Return how gross mismatches of a match are dealt with, every sample counted alike.

    The share of the ride that is off by more than 10 m; of that, the shares that are flagged, that
    are within 3 sigma, and that are either. NaN where nothing is off.
    """
    share = 'match.gross_share'
    flagged, covered, either = (
        nominal.weighted(method, f'match.gross_{name}', share)
        for name in ('flagged', 'inside_3_sigma', 'flagged_or_covered')
    )
    return nominal.mean(method, share), flagged, covered, either


def _gross(nominal: Rides) -> list[Goal]:
    out = []
    for method in ('dtw_penalised', 'srdtw_multi', 'srdtw_z'):
        share, flagged, covered, either = gross(nominal, method)
        if np.isnan(share):
            continue
        ours = f'{share:.2%} of the ride is off by more than 10 m'
        if share > 0.0:
            ours += f': {flagged:.1%} flagged, {covered:.1%} within 3 sigma, {either:.1%} either'
        met = bool(flagged >= 0.95 and covered >= 0.95) if share > 0.0 else True
        out.append(Goal(f'gross mismatches of {method}', '>= 95 % flagged, covered', ours, met))
    for method in ('eskf_live', 'eskf_smoothed'):
        share = nominal.mean(method, 'gross_share')
        if np.isnan(share):
            continue
        covered = nominal.weighted(method, 'gross_inside_3_sigma', 'gross_share')
        ours = f'{share:.2%} of the ride is off by more than 10 m'
        if share > 0.0:
            ours += f': {covered:.1%} within 3 sigma'
        met = bool(covered >= 0.95) if share > 0.0 else True
        out.append(Goal(f'errors beyond 10 m of {method}', '>= 95 % covered', ours, met))
    return out


def _consistency(nominal: Rides) -> list[Goal]:
    out = []
    for method in ('eskf', 'eskf_smoothed'):
        nees = nominal.median(method, 'nees_position_over_3')
        inside = nominal.median(method, 'inside_2_sigma')
        average = nominal.mean(method, 'nees_position_over_3')
        ours = f'{nees:.2f} (mean over rides {average:.2f}; {inside:.0%} within 2 sigma)'
        met = None if np.isnan(nees) else bool(0.5 <= nees <= 2.0)
        out.append(Goal(f'NEES of the position / 3, {method}, median', '0.5 to 2', ours, met))
    return out


def _findings(nominal: Rides) -> list[Goal]:
    z, pitch, yaw, roll = (
        nominal.median(f'srdtw_{channel}') for channel in ('z', 'pitch', 'yaw', 'roll')
    )
    known = not np.isnan([z, pitch, yaw, roll]).any()
    return [
        Goal(
            "the paper's finding: Z and pitch better than yaw and roll",
            'both than both',
            f'{z:.2f}, {pitch:.2f} against {yaw:.2f}, {roll:.2f} m',
            bool(max(z, pitch) < min(yaw, roll)) if known else None,
        )
    ]

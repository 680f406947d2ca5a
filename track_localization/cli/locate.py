"""``locate BAG --events events.csv``: where on the track something happened."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coaster_localization.methods import METHODS, MethodResult, run_methods
from track_localization.cli.coaster import inputs as coaster_inputs
from track_localization.cli.coaster.evaluate_notes import clock_offset, mount_note
from track_localization.cli.coaster.usable import usable
from track_localization.cli.common import guarded, say
from track_localization.cli.files import make_file
from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.clock import TWO_SIDED_95, ClockOffset, fit_clock_offset
from track_localization.evaluation.interpolation import at_times
from track_localization.evaluation.tabulate import Table
from track_localization.io.tables import Events, Markers, read_events, write_table

PREFERENCE = ('track_filter_smoothed', 'eskf_smoothed', 'eskf', 'dtw_penalised')
"""Methods, the most accurate first; the first that exists is used."""

REACH_S = 60.0
"""Clocks further apart than this are not brought together by markers [s]."""
SAME_CLOCK = ClockOffset(0.0, 0.0, np.empty(0))
COLUMNS = (
    *('time_s', 'name', 'x_m', 'y_m', 'z_m', 'chainage_m', 'chainage_95_m'),
    *('nearest_marker', 'marker_distance_m', 'remark'),
)


@dataclasses.dataclass(frozen=True)
class Place:
    """
    Where the vehicle was at an event; numbers are NaN where ``remark`` says why.

    Attributes:
        time_s: of the event, recording's clock [s].
        name: of the event.
        position: x, y, z in ``map`` [m].
        chainage: along the track [m].
        half_width: of the interval along the track that holds it with 95 % [m].
        marker: name of the nearest marker, '' without markers.
        marker_distance: how far that is, straight [m].
        remark: why there is no answer, or ''.
    """

    time_s: float
    name: str
    position: tuple[float, float, float]
    chainage: float
    half_width: float
    marker: str
    marker_distance: float
    remark: str


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, locate, print; return the exit code."""
    parser = make_parser()
    args = parser.parse_args(argv)
    if args.clock_from_markers and args.clock_event is not None:
        parser.error('give --clock-event or --clock-from-markers, not both')
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    methods = [name for name in PREFERENCE if name in METHODS]
    parser = argparse.ArgumentParser(
        prog='locate',
        description='Say where on the track the train was at given times. design_ride.csv and '
        'markers.csv are looked for beside the bag.',
    )
    coaster_inputs.add_arguments(parser)
    parser.add_argument(
        '--events',
        type=Path,
        required=True,
        help="time_s,name in the recording's clock, or the ground's with one of --clock-...",
    )
    parser.add_argument(
        '--clock-from-markers',
        action='store_true',
        help="times of events are of the markers' clock: fit its offset to markers.csv",
    )
    parser.add_argument('--method', choices=METHODS, default=methods[0])
    parser.add_argument('--output', type=Path, metavar='CSV', help='write the places here too')
    return parser


def run(args: argparse.Namespace) -> None:
    """Locate the events as the arguments say."""
    events = read_events(args.events)
    inputs = coaster_inputs.read_inputs(args)
    for finding in inputs.recording.findings:
        say(str(finding))
    methods, recording, _ = usable([args.method], inputs.recording)
    if args.output is not None:
        make_file(args.output)
    say(f'locating {len(events)} events by {args.method}')
    results = run_methods(
        recording.imu,
        inputs.design,
        inputs.config,
        methods,
        learned=inputs.learned,
    )
    result: MethodResult = next(iter(results))
    for note in result.notes:
        say(note)
    if result.mount is not None:
        say(mount_note(result.mount))
    clock = _clock(result, inputs, args.clock_from_markers)
    places = locate(result.trajectory, events, inputs.markers, clock)
    print(as_table(places).text())
    if args.output is not None:
        write_table(args.output, COLUMNS, [_row(place) for place in places])


def locate(
    trajectory: Trajectory,
    events: Events,
    markers: Markers | None = None,
    clock: ClockOffset = SAME_CLOCK,
) -> list[Place]:
    """
    Return the place of each event, in the order of ``events``.

    ``clock`` takes their times to the recording's clock; its uncertainty goes into the interval.
    """
    offset = clock.offset_s
    there = at_times(trajectory, events.time_s + offset)
    half_width = _half_width(there, clock.sigma_s)
    first, last = float(trajectory.time_s[0]) - offset, float(trajectory.time_s[-1]) - offset
    places = []
    for i, (time_s, name) in enumerate(zip(events.time_s.tolist(), events.name, strict=True)):
        position = there.position[i]
        marker, distance = _nearest(position, markers)
        remark = ''
        if not first <= time_s <= last:
            remark = f'outside the recording ({first:.2f} to {last:.2f} s)'
        elif not np.isfinite(position).all():
            remark = 'in a gap of the recording'
        places.append(
            Place(
                time_s,
                name,
                (float(position[0]), float(position[1]), float(position[2])),
                math.nan if there.chainage is None else float(there.chainage[i]),
                float(half_width[i]),
                marker,
                distance,
                remark,
            )
        )
    return places


def as_table(places: Sequence[Place]) -> Table:
    """Return the places as a table for people."""
    columns = ('time [s]', 'event', 'x [m]', 'y [m]', 'z [m]', 'along the track [m]', 'place')
    rows: list[tuple[str, ...]] = []
    for p in places:
        if p.remark:
            rows.append((f'{p.time_s:.3f}', p.name, '', '', '', '', p.remark))
            continue
        along = '' if math.isnan(p.chainage) else f'{p.chainage:.2f}'
        if along and not math.isnan(p.half_width):
            along += f' +- {p.half_width:.2f}'
        near = f'{p.marker_distance:.1f} m from {p.marker}' if p.marker else ''
        rows.append((f'{p.time_s:.3f}', p.name, *(f'{v:.2f}' for v in p.position), along, near))
    return Table('places (+- 95 %)', columns, rows)


def _clock(result: MethodResult, inputs: coaster_inputs.Inputs, by_markers: bool) -> ClockOffset:
    """Return the offset of the events' clock as the arguments ask, and say what it is."""
    if inputs.clock_event is not None:
        clock, sentence = clock_offset(result.trajectory, inputs.clock_event, result.name)
        say(sentence)
        return clock
    if not by_markers:
        return SAME_CLOCK
    markers = inputs.markers
    if markers is None:
        raise DataError('--clock-from-markers: no markers.csv beside the bag; name it by --markers')
    clock = fit_clock_offset(result.trajectory, markers.time_s, markers.position, REACH_S)
    if not np.isfinite(clock.offset_s + clock.sigma_s):
        raise DataError(
            f'--clock-from-markers: no offset within {REACH_S:.0f} s brings the ride to '
            f'{len(markers)} markers; three at least must be passed, at speed. One known event '
            'does as well: --clock-event'
        )
    side, left = 'behind' if clock.offset_s > 0 else 'ahead of', float(np.nanmedian(clock.distance))
    said = dataclasses.replace(clock, offset_s=abs(clock.offset_s)).text()
    say(f"the markers' clock is {said} {side} the recording's; they are then {left:.2f} m off")
    return clock


def _half_width(there: Trajectory, clock_sigma_s: float) -> np.ndarray:
    """Return the half widths (K,) [m] of the intervals along the track, the clock's part too."""
    if there.sigma_along is None:
        return np.full(len(there), math.nan)
    by_clock = np.zeros(len(there)) if there.speed is None else there.speed * clock_sigma_s
    return np.asarray(TWO_SIDED_95 * np.hypot(there.sigma_along, by_clock))


def _nearest(position: np.ndarray, markers: Markers | None) -> tuple[str, float]:
    if markers is None or not len(markers) or not np.isfinite(position).all():
        return '', math.nan
    distance = np.linalg.norm(markers.position - position, axis=1)
    i = int(np.argmin(distance))
    return markers.name[i], float(distance[i])


def _row(place: Place) -> list[str]:
    def cell(value: float, digits: int = 4) -> str:
        return '' if math.isnan(value) else f'{value:.{digits}f}'

    return [
        cell(place.time_s, 6),
        place.name,
        *(cell(v) for v in place.position),
        cell(place.chainage),
        cell(place.half_width),
        place.marker,
        cell(place.marker_distance),
        place.remark,
    ]


if __name__ == '__main__':
    raise SystemExit(main())

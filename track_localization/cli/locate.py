"""``locate BAG --events events.csv``: where on the track something happened."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coaster_localization.methods import METHODS, MethodResult, run_methods
from track_localization.cli import coaster_inputs
from track_localization.cli.common import guarded, say
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import at_times
from track_localization.evaluation.tabulate import Table
from track_localization.io.tables import Events, Markers, read_events, write_table

PREFERENCE = ('track_filter_smoothed', 'eskf_smoothed', 'eskf', 'dtw_penalised')
"""Methods, the most accurate first; the first that exists is used."""

TWO_SIDED_95 = 1.96
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
    args = make_parser().parse_args(argv)
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
        '--events', type=Path, required=True, help="time_s,name in the recording's clock"
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
    say(f'locating {len(events)} events by {args.method}')
    results = run_methods(
        inputs.recording.imu,
        inputs.design,
        inputs.config,
        [args.method],
        learned=inputs.learned,
    )
    result: MethodResult = next(iter(results))
    for note in result.notes:
        say(note)
    places = locate(result.trajectory, events, inputs.markers)
    print(as_table(places).text())
    if args.output is not None:
        write_table(args.output, COLUMNS, [_row(place) for place in places])


def locate(trajectory: Trajectory, events: Events, markers: Markers | None = None) -> list[Place]:
    """Return the place of each event, in the order of ``events``."""
    there = at_times(trajectory, events.time_s)
    first, last = float(trajectory.time_s[0]), float(trajectory.time_s[-1])
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
                math.nan
                if there.sigma_along is None
                else TWO_SIDED_95 * float(there.sigma_along[i]),
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

"""``compare RIDE_A RIDE_B``: two rides of one track by chainage: speed, time, riders' forces."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coaster_localization.comparing import (
    UNRUN,
    Comparison,
    Element,
    Verdict,
    between_places,
    compare,
    equal_stretches,
    judge,
)
from track_localization.cli.coaster import rides
from track_localization.cli.common import guarded, say
from track_localization.cli.files import beside, make_folder
from track_localization.cli.progress import Progress
from track_localization.errors import DataError
from track_localization.evaluation.plots_rides import RideCurves, rides_by_chainage
from track_localization.evaluation.tabulate import Table
from track_localization.io.tables import read_markers, read_table, write_table
from track_localization.track.line_map import LineMap

COLUMNS = (
    *('pass', 'chainage_m', 'speed_a_mps', 'speed_b_mps', 'speed_difference_mps', 'sigma_mps'),
    *('time_a_s', 'time_b_s', 'time_difference_s'),
    *('longitudinal_a_mps2', 'lateral_a_mps2', 'vertical_a_mps2'),
    *('longitudinal_b_mps2', 'lateral_b_mps2', 'vertical_b_mps2'),
)
EXPLANATION = (
    'Differences are B minus A; time differences count from where both trains first moved. Forces '
    'are specific forces at the sensor in body axes (forward, left, up), low-passed at 5 Hz (four '
    'poles, forward and backward: no delay). At 95 %, up to one element in twenty that did '
    'not change is called different.'
)


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, compare, write, print; return the exit code."""
    args = make_parser().parse_args(argv)
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='compare',
        description='Compare two rides of one track by chainage: did the train run slower through '
        'an element than last month? Writes comparison.csv and comparison.png and prints a table '
        'by element. A shuttle is compared pass by pass.',
        epilog=EXPLANATION,
    )
    parser.add_argument('ride_a', type=Path, help='bag folder, .mcap, .db3 or phone export')
    parser.add_argument('ride_b', type=Path, help='the same, of the other ride')
    rides.add_arguments(parser, learned=True)
    parser.add_argument(
        '--elements',
        type=Path,
        help='elements.csv: name,from_m,to_m; else the stretches between the places of markers.csv '
        'beside ride A, else ten equal ones',
    )
    parser.add_argument('--output', type=Path, default=Path('comparison'), metavar='DIR')
    return parser


def run(args: argparse.Namespace) -> None:
    """Compare as the arguments say."""
    setup = rides.read_setup(args, args.ride_a)
    elements = _elements(args, setup.line)
    smoothed = []
    with Progress(2, 'ride') as progress:
        for path in (args.ride_a, args.ride_b):
            progress.begin(str(path))
            smoothed.append(rides.read_ride(args, path, setup))
            progress.done()
    comparisons, notes = compare(smoothed[0], smoothed[1])
    for note in notes:
        say(note)
    folder = make_folder(args.output)
    write_table(folder / 'comparison.csv', COLUMNS, [r for c in comparisons for r in _rows(c)])
    _tell(comparisons, elements, folder)
    print(EXPLANATION)
    print(folder / 'comparison.csv')


def _tell(comparisons: Sequence[Comparison], elements: Sequence[Element], folder: Path) -> None:
    """Print a table and draw a picture for every pass that runs through an element."""
    several = len(comparisons) > 1
    told = False
    for comparison in comparisons:
        verdicts = [v for v in judge(comparison, elements) if not several or v.remark != UNRUN]
        if not verdicts:
            continue
        title = 'mean speed by element, +- 95 %'
        if several:
            way = 'forward' if comparison.forward else 'backward'
            title += f', pass {comparison.number} ({way})'
        print(as_table(verdicts, title).text() + '\n')
        name = f'comparison_pass{comparison.number}.png' if told else 'comparison.png'
        rides_by_chainage(folder / name, _curves(comparison), _spans(verdicts))
        told = True
    if not told:
        say('no element was run by both rides; comparison.csv holds what both have run')


def read_elements(path: Path, length: float) -> list[Element]:
    """
    Read ``name,from_m,to_m``.

    Raise DataError naming the row and the remedy where a stretch is empty or off the line.
    """
    table = read_table(path, ('name', 'from_m', 'to_m'), text=('name',))
    out = []
    for k, name in enumerate(table.texts['name']):
        begin, end = float(table.numbers['from_m'][k]), float(table.numbers['to_m'][k])
        if not begin < end:
            raise DataError(
                f'{path}: element {name!r}: from_m {begin:g} is not below to_m {end:g}; one that '
                'runs over the end of the lap is written as two'
            )
        if begin < -1.0 or end > length + 1.0:
            raise DataError(
                f'{path}: element {name!r}: {begin:g} to {end:g} m is not on the line, which '
                f'is {length:.1f} m long; chainages are those of the design ride'
            )
        out.append(Element(name, begin, end))
    return out


def as_table(verdicts: Sequence[Verdict], title: str) -> Table:
    """Return the verdicts as a table for people."""
    columns = (
        *('element', 'from [m]', 'to [m]', 'A [m/s]', 'B [m/s]', 'B - A [m/s]', 'time B - A [s]'),
        'verdict',
    )
    rows = []
    for v in verdicts:
        e = v.element
        place = (e.name, f'{e.from_m:.1f}', f'{e.to_m:.1f}')
        if math.isnan(v.speed_a):
            rows.append((*place, '', '', '', '', v.remark))
            continue
        word = 'not significant'
        if v.significant:
            word = 'B slower' if v.difference < 0.0 else 'B faster'
        rows.append(
            (
                *place,
                *(f'{v.speed_a:.2f}', f'{v.speed_b:.2f}'),
                f'{v.difference:+.2f} +- {v.half_width:.2f}',
                f'{v.time_difference:+.2f} +- {v.time_half_width:.2f}',
                f'{word}; {v.remark}' if v.remark else word,
            )
        )
    return Table(title, columns, rows)


def _elements(args: argparse.Namespace, line: LineMap) -> list[Element]:
    if args.elements is not None:
        return read_elements(args.elements, line.length)
    path = beside(args.ride_a, 'markers.csv')
    if path is None:
        return equal_stretches(line.length)
    markers = read_markers(path)
    chainage = np.asarray(line.line.nearest(markers.position))
    return between_places(markers.name, chainage, line.length)


def _rows(c: Comparison) -> list[list[str]]:
    numbers = np.column_stack(
        [
            *(c.chainage, c.a.speed, c.b.speed, c.speed_difference, c.sigma),
            *(c.a.time_s, c.b.time_s, c.time_difference, c.a.force, c.b.force),
        ]
    )
    if not c.forward:
        numbers = numbers[::-1]
    digits = (3, 4, 4, 4, 4, 4, 4, 4, *[3] * 6)
    return [
        [str(c.number)]
        + [f'{v:.{d}f}' if math.isfinite(v) else '' for v, d in zip(row, digits, strict=True)]
        for row in numbers.tolist()
    ]


def _curves(c: Comparison) -> RideCurves:
    return RideCurves(
        chainage=c.chainage,
        speed=(c.a.speed, c.b.speed),
        difference=c.speed_difference,
        sigma=c.sigma,
        time_difference=c.time_difference,
        force=(c.a.force, c.b.force),
    )


def _spans(verdicts: Sequence[Verdict]) -> list[tuple[str, float, float, bool]]:
    return [(v.element.name, v.element.from_m, v.element.to_m, v.significant) for v in verdicts]


if __name__ == '__main__':
    raise SystemExit(main())

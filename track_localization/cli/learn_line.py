"""``learn_line BAG...``: usual speed and built track from several recorded rides."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coaster_localization.learning import Difference, Lesson, differences, learn
from track_localization.cli.coaster import rides
from track_localization.cli.common import guarded
from track_localization.cli.files import make_folder
from track_localization.cli.progress import Progress
from track_localization.errors import DataError
from track_localization.evaluation.plots_rides import LearnedCurves, learned_by_chainage
from track_localization.evaluation.tabulate import Table
from track_localization.track.learned_line import write_learned_line

EXPLANATION = (
    'Angles are about the body axes x, y, z (roll: + right side down, pitch: + nose down, yaw: + '
    'nose left), built track against design. What varies slowly along the line is each '
    "recording's own mount and drift and is taken out: bends of the track longer than about 150 m "
    'do not show, and neither does a shift of the track along itself.'
)


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, learn, write, print; return the exit code."""
    args = make_parser().parse_args(argv)
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='learn_line',
        description='Learn from several rides of one track: its usual speed, and where the track '
        'as built differs from its design. Writes learned_line.csv (for --learned of evaluate, '
        'locate and compare) and learned_line.png, and prints where the two differ.',
        epilog=EXPLANATION,
    )
    parser.add_argument(
        'bags', type=Path, nargs='+', metavar='BAG', help='bag folder, .mcap, .db3 or phone export'
    )
    rides.add_arguments(parser, learned=False)
    parser.add_argument('--output', type=Path, default=Path('learned'), metavar='DIR')
    return parser


def run(args: argparse.Namespace) -> None:
    """Learn as the arguments say."""
    same = {path.resolve() for path in args.bags}
    if len(same) < len(args.bags):
        raise DataError('a recording is named twice; name each once: twice it teaches no more')
    setup = rides.read_setup(args, args.bags[0])
    smoothed = []
    with Progress(len(args.bags), 'ride') as progress:
        for path in args.bags:
            progress.begin(str(path))
            smoothed.append(rides.read_ride(args, path, setup)[0])
            progress.done()
    lesson = learn(smoothed, setup.design, setup.config.track_filter)
    folder = make_folder(args.output)
    write_learned_line(folder / 'learned_line.csv', lesson.learned)
    found = differences(lesson)
    learned_by_chainage(
        folder / 'learned_line.png', _curves(lesson), [(d.axis, d.from_m, d.to_m) for d in found]
    )
    print('\n'.join([_said(lesson, len(args.bags)), '', as_table(found).text(), '', EXPLANATION]))
    print(folder / 'learned_line.csv')


def as_table(found: Sequence[Difference]) -> Table:
    """Return the flagged stretches as a table for people."""
    rows = [
        (
            *(f'{d.from_m:.1f}', f'{d.to_m:.1f}', d.axis),
            f'{1e3 * d.largest:+.1f} +- {1.96e3 * d.error:.1f}',
        )
        for d in found
    ]
    title = 'where built track and design differ' if found else 'nowhere do track and design differ'
    return Table(title, ('from [m]', 'to [m]', 'axis', 'largest [mrad], 95 %'), rows)


def _said(lesson: Lesson, count: int) -> str:
    learned = lesson.learned
    seen = learned.rides > 1
    rms = 1e3 * np.sqrt(np.nanmean(lesson.deviation[seen] ** 2, axis=0))
    lines = [
        f'{count} rides, {100.0 * seen.mean():.0f} % of the line seen twice or more',
        'deviation, rms: '
        + ', '.join(
            f'{name} {value:.1f} mrad'
            for name, value in zip(('roll', 'pitch', 'yaw'), rms.tolist(), strict=True)
        ),
    ]
    with np.errstate(invalid='ignore'):
        change = (
            float(np.nanmean(learned.speed / lesson.design_speed - 1.0))
            if (np.isfinite(learned.speed / lesson.design_speed).any())
            else math.nan
        )
    lines.append(
        'usual speed: none, the line is run both ways'
        if math.isnan(change)
        else f'usual speed: {100.0 * change:+.1f} % against the design, on average'
    )
    return '\n'.join(lines)


def _curves(lesson: Lesson) -> LearnedCurves:
    learned = lesson.learned
    return LearnedCurves(
        chainage=learned.chainage,
        deviation=lesson.deviation,
        error=lesson.error,
        turn=learned.turn,
        speeds=lesson.speeds,
        usual=learned.speed,
        design=lesson.design_speed,
    )


if __name__ == '__main__':
    raise SystemExit(main())

"""``reproduce SYSTEM``: the paper's tables and figures beside ours, and the acceptance table."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from coaster_localization.methods import METHODS
from track_localization.cli import reproduce_goals, reproduce_tables
from track_localization.cli.coaster_sweeps import LAMBDA_X, LAMBDA_Y, RATIO, Sweeps
from track_localization.cli.common import guarded, say
from track_localization.cli.progress import Progress
from track_localization.cli.reproduce_goals import Rides
from track_localization.cli.reproduce_rides import (
    SMALL_MOUNT,
    Ride,
    Task,
    code_fingerprint,
    kept_rides,
    run_rides,
    scenarios,
)
from track_localization.errors import DataError
from track_localization.evaluation import plots_sweeps, provenance
from track_localization.evaluation.tabulate import Table
from track_localization.sim.coaster import TRACKS

SYSTEMS = ('coaster',)
EXAM_SEEDS = range(1000, 1020)
"""Seeds that nothing was tuned on."""

NOT_EXAMINED = ('shuttle',)
SWEPT_SEEDS = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, run the rides, print the tables; return the exit code."""
    args = make_parser().parse_args(argv)
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    tracks = tuple(t for t in TRACKS if t not in NOT_EXAMINED)
    parser = argparse.ArgumentParser(
        prog='reproduce',
        description="Simulate rides, run every method, print the paper's figures beside ours and "
        'whether the goals are met. Rides are kept: a second run prints from them.',
    )
    parser.add_argument('system', choices=SYSTEMS)
    parser.add_argument('--seeds', type=_seeds, default=EXAM_SEEDS, metavar='A:B', help='1000:1020')
    parser.add_argument('--tracks', type=_list_of(TRACKS), default=tracks, metavar='A,B')
    parser.add_argument('--methods', type=_list_of(METHODS), default=METHODS, metavar='A,B')
    parser.add_argument('--scenario', choices=scenarios(), default='nominal')
    parser.add_argument('--jobs', type=int, default=2, help='worker processes (2)')
    parser.add_argument('--no-sweeps', action='store_true', help='without Figures 14 and 15')
    parser.add_argument(
        '--reprint', action='store_true', help='print from the rides kept, whatever code made them'
    )
    parser.add_argument('--output', type=Path, default=Path('reproduce'), metavar='DIR')
    return parser


def run(args: argparse.Namespace) -> None:
    """Run or read the rides, then print and write the tables."""
    tasks, folder = make_tasks(args), args.output / 'rides'
    code = code_fingerprint()
    rides, left = kept_rides(tasks, folder, None if args.reprint else code)
    if args.reprint:
        if not rides:
            raise DataError(f'{folder}: no rides are kept there; run without --reprint first')
        say(f'{len(rides)} rides kept in {folder}, {len(left)} missing')
    else:
        say(f'{len(left)} rides to run, {len(rides)} kept in {folder}')
        with Progress(len(left), 'rides', quiet_s=10.0) as progress:
            for ride in run_rides(left, folder, args.jobs, code):
                rides.append(ride)
                progress.done()
                progress.bar(f'{ride.scenario} {ride.track} {ride.seed}')
    publish(args, rides)


def make_tasks(args: argparse.Namespace) -> list[Task]:
    """Return the rides to run: the scenario, and the small mounts that one goal needs."""
    sweeps = not args.no_sweeps and 'srdtw_z' in args.methods
    tasks = [
        Task(track, args.scenario, seed, args.methods, sweeps and k < SWEPT_SEEDS)
        for k, seed in enumerate(args.seeds)
        for track in args.tracks
    ]
    if args.scenario == 'nominal' and 'eskf_smoothed' in args.methods:
        tasks += [
            Task(track, SMALL_MOUNT, seed, ('eskf_smoothed',))
            for seed in args.seeds
            for track in args.tracks
        ]
    return tasks


def publish(args: argparse.Namespace, rides: Sequence[Ride]) -> None:
    """Print the tables; write them as Markdown and CSV, and draw the figures."""
    nominal = Rides([ride for ride in rides if ride.scenario == args.scenario])
    small = Rides([ride for ride in rides if ride.scenario == SMALL_MOUNT])
    goals = reproduce_goals.goals(nominal, small)
    tables = {
        'paper': reproduce_tables.paper_table(nominal, small),
        'methods': reproduce_tables.methods_table(nominal),
        'tracks': reproduce_tables.tracks_table(nominal),
        'gross': reproduce_tables.gross_table(nominal),
    }
    sweeps = reproduce_tables.sweeps_of(nominal)
    if sweeps is not None:
        tables['fig14'], tables['fig15'] = reproduce_tables.sweep_tables(sweeps)
        goals += reproduce_tables.sweep_goals(sweeps)
        _draw(args.output, sweeps)
    tables['goals'] = reproduce_goals.table(goals)
    said = [
        f'reproduce coaster --seeds {args.seeds.start}:{args.seeds.stop} '
        f'--scenario {args.scenario}, tracks {", ".join(args.tracks)}.',
        *reproduce_tables.rides_note(rides),
        f'Commit {provenance.commit()}, code {code_fingerprint()}.',
    ]
    print('\n\n'.join([*(table.text() for table in tables.values()), '\n'.join(said)]))
    _write(args.output, tables, said)


def _write(folder: Path, tables: dict[str, Table], said: Sequence[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    parts = [table.markdown() for table in tables.values()] + ['  \n'.join(said)]
    (folder / 'reproduce.md').write_text('\n\n'.join(parts) + '\n', encoding='utf-8')
    for name, table in tables.items():
        (folder / f'{name}.csv').write_text(table.csv(), encoding='utf-8')


def _draw(folder: Path, sweeps: Sweeps) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    plots_sweeps.error_by_lambda(
        folder / 'fig14_lambda.png',
        np.array(LAMBDA_Y),
        np.array(RATIO),
        sweeps.by_lambda,
        sweeps.matching,
    )
    plots_sweeps.error_by_channel(
        folder / 'fig15_channels.png', np.array(LAMBDA_X), sweeps.by_channel
    )


def _seeds(text: str) -> range:
    first, colon, last = text.partition(':')
    try:
        seeds = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not A:B') from None
    if not seeds or seeds.start < 0:
        raise argparse.ArgumentTypeError(f'{text!r}: no seeds in it')
    return seeds


def _list_of(known: Sequence[str]) -> Callable[[str], tuple[str, ...]]:
    def parse(text: str) -> tuple[str, ...]:
        names = tuple(dict.fromkeys(n.strip() for n in text.split(',') if n.strip()))
        unknown = [n for n in names if n not in known]
        if unknown or not names:
            wrong = ', '.join(unknown) or 'nothing'
            raise argparse.ArgumentTypeError(f'{wrong}: known are {", ".join(known)}')
        return names

    return parse


if __name__ == '__main__':
    raise SystemExit(main())

"""``reproduce coaster``: the paper's tables and figures beside ours, and the acceptance table."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coaster_localization.methods import METHODS
from track_localization.cli import goals
from track_localization.cli.coaster import reproduce_goals, reproduce_tables, reproduce_track
from track_localization.cli.coaster.reproduce_goals import Rides
from track_localization.cli.coaster.reproduce_rides import (
    KEEPER,
    SMALL_MOUNT,
    Ride,
    Task,
    code_fingerprint,
    scenarios,
)
from track_localization.cli.coaster.sweeps import LAMBDA_X, LAMBDA_Y, RATIO, Sweeps
from track_localization.cli.coaster.sweeps import runs as swept_runs
from track_localization.cli.common import guarded, names_among, seed_range
from track_localization.evaluation import plots_sweeps, provenance
from track_localization.sim.coaster import TRACKS

EXAM_SEEDS = range(1000, 1020)
"""Seeds that nothing was tuned on."""

NOT_EXAMINED = ('shuttle',)
SWEPT_SEEDS = 5


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, run the rides, print the tables; return the exit code."""
    args = parse(argv)
    return guarded(lambda: reproduce_track.run(args) if args.track_filter else run(args))


def parse(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse arguments; what is not given becomes what the exam asked for has."""
    parser = make_parser()
    args = parser.parse_args(argv)
    own = {
        'seeds': reproduce_track.EXAM_SEEDS,
        'tracks': reproduce_track.EXAM_TRACKS,
        'scenario_seeds': reproduce_track.SCENARIO_SEEDS,
        'starts': reproduce_track.STARTS,
        'output': Path('reproduce', 'track_filter'),
    }
    papers = {
        'seeds': EXAM_SEEDS,
        'tracks': tuple(t for t in TRACKS if t not in NOT_EXAMINED),
        'methods': METHODS,
        'scenario': 'nominal',
        'no_sweeps': False,
        'output': Path('reproduce'),
    }
    mine, others = (own, papers) if args.track_filter else (papers, own)
    for name in others.keys() - mine.keys():
        if getattr(args, name) is not None:
            verb = 'does not go' if args.track_filter else 'goes only'
            parser.error(f'--{name.replace("_", "-")} {verb} with --track-filter')
    for name, value in mine.items():
        if getattr(args, name) is None:
            setattr(args, name, value)
    return args


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='reproduce coaster',
        description="Simulate rides, run every method, print the paper's figures beside ours and "
        'whether the goals are met. Rides are kept: a second run prints from them.',
    )
    parser.add_argument(
        '--seeds', type=seed_range, metavar='A:B', help='1000:1020; of the track filter 2000:2020'
    )
    parser.add_argument('--tracks', type=names_among(TRACKS), metavar='A,B')
    parser.add_argument('--methods', type=names_among(METHODS), metavar='A,B')
    parser.add_argument('--scenario', choices=scenarios(), help='nominal')
    parser.add_argument('--jobs', type=int, default=2, help='worker processes (2)')
    parser.add_argument(
        '--no-sweeps', action='store_true', default=None, help='without Figures 14 and 15'
    )
    parser.add_argument(
        '--reprint', action='store_true', help='print from the rides kept, whatever code made them'
    )
    parser.add_argument('--output', type=Path, metavar='DIR', help='reproduce')
    track = parser.add_argument_group('the track filter')
    track.add_argument(
        '--track-filter',
        action='store_true',
        help="the track filter's own exam: nominal rides, every scenario, starts during the ride",
    )
    track.add_argument(
        '--scenario-seeds', type=_count, metavar='N', help='seeds of every other scenario (5)'
    )
    track.add_argument('--starts', type=_count, metavar='N', help='starts during the ride (200)')
    return parser


def run(args: argparse.Namespace) -> None:
    """Run or read the rides, then print and write the tables."""
    tasks, code = make_tasks(args), code_fingerprint()
    publish(args, KEEPER.gather(tasks, args.output / 'rides', args.jobs, args.reprint, code))


def make_tasks(args: argparse.Namespace) -> list[Task]:
    """Return the rides to run: the scenario, and the small mounts that one goal needs."""
    sweeps = not args.no_sweeps and swept_runs(args.methods) > 0
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
    reached = reproduce_goals.goals(nominal, small)
    tables = {
        'paper': reproduce_tables.paper_table(nominal, small),
        'methods': reproduce_tables.methods_table(nominal),
        'tracks': reproduce_tables.tracks_table(nominal),
        'gross': reproduce_tables.gross_table(nominal),
    }
    sweeps = reproduce_tables.sweeps_of(nominal)
    if sweeps is not None:
        tables |= reproduce_tables.sweep_tables(sweeps)
        reached += reproduce_tables.sweep_goals(sweeps)
        _draw(args.output, sweeps)
    tables['goals'] = goals.table(reached)
    said = [
        f'reproduce coaster --seeds {args.seeds.start}:{args.seeds.stop} '
        f'--scenario {args.scenario}, tracks {", ".join(args.tracks)}.',
        *reproduce_tables.rides_note(rides),
        f'Commit {provenance.commit()}, code {code_fingerprint()}.',
    ]
    goals.show(args.output, tables, said)


def _draw(folder: Path, sweeps: Sweeps) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for feed, grid in sweeps.by_lambda.items():
        file, own = folder / f'fig14_{feed}.png', sweeps.matching[feed]
        plots_sweeps.error_by_lambda(file, np.array(LAMBDA_Y), np.array(RATIO), grid, own)
    plots_sweeps.error_by_channel(
        folder / 'fig15_channels.png', np.array(LAMBDA_X), sweeps.by_channel
    )


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'{text!r} is not a count')
    return int(text)


if __name__ == '__main__':
    raise SystemExit(main())

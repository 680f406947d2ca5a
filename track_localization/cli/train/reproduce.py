"""``reproduce train``: the paper's figures beside ours, and the acceptance table."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from track_localization.cli import goals
from track_localization.cli.arguments import add_exam
from track_localization.cli.common import guarded, seed_range
from track_localization.cli.exam_runs import Run, Task, runs_note
from track_localization.cli.train import reproduce_figures, reproduce_goals, reproduce_tables
from track_localization.cli.train.reproduce_runs import (
    CASES,
    ENTRIES,
    FLOOR,
    FLOOR_CASES,
    KEEPER,
    LINE,
    code_fingerprint,
)
from track_localization.evaluation import provenance
from track_localization.evaluation.tabulate import Table

EXAM_SEEDS = range(2000, 2050)
"""Seeds that nothing was tuned on."""
LINE_SEEDS = 10
"""How many of them see the long line."""


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, run, print the tables; return the exit code."""
    args = make_parser().parse_args(argv)
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='reproduce train',
        description="Simulate runs, run every method, draw the paper's Figures 3 to 6 with ours, "
        'print errors through the outage and whether the goals are met. Runs are kept: a second '
        'time prints from them.',
    )
    parser.add_argument(
        '--seeds',
        type=seed_range,
        default=EXAM_SEEDS,
        metavar='A:B',
        help=f'{EXAM_SEEDS.start}:{EXAM_SEEDS.stop}; {LINE}: the first {LINE_SEEDS} of them',
    )
    add_exam(parser, tuple(CASES), (*ENTRIES, FLOOR))
    parser.add_argument('--no-plots', action='store_true', help='leave the pictures out')
    parser.add_argument('--output', type=Path, default=Path('reproduce', 'train'), metavar='DIR')
    return parser


def run(args: argparse.Namespace) -> None:
    """Run or read the runs, then print and write the tables, and draw the paper's figures."""
    code = code_fingerprint()
    runs = KEEPER.gather(make_tasks(args), args.output / 'runs', args.jobs, args.reprint, code)
    publish(args, runs, code)
    if not args.no_plots:
        for path in reproduce_figures.draw(args.output, args.seeds[0]):
            print(path)


def make_tasks(args: argparse.Namespace) -> list[Task]:
    """Return the runs to make."""
    entries = tuple(entry for entry in ENTRIES if entry in args.methods)
    floor = (FLOOR,) if FLOOR in args.methods else ()
    return [
        Task(name, seed, entries + (floor if name in FLOOR_CASES else ()))
        for name in args.scenarios
        for seed in (args.seeds[:LINE_SEEDS] if name == LINE else args.seeds)
    ]


def publish(args: argparse.Namespace, runs: Sequence[Run], code: str) -> None:
    """Print the tables; write them as Markdown and CSV."""
    exam = reproduce_tables.exam_of(runs)
    tables = {
        'outage': reproduce_tables.outage_table(exam),
        'floor': reproduce_tables.floor_table(exam),
        'honesty': reproduce_tables.honesty_table(exam),
        'speed': reproduce_tables.speed_table(exam),
    }
    shown: dict[str, Table] = {name: table for name, table in tables.items() if table.rows}
    shown['goals'] = goals.table(reproduce_goals.goals(exam))
    said = [
        f'reproduce train --seeds {args.seeds.start}:{args.seeds.stop} '
        f'--scenarios {",".join(args.scenarios)} --methods {",".join(args.methods)}.',
        *runs_note(runs),
        f'Run times with {args.jobs} jobs on {provenance.machine()["processors"]} processors.',
        f'Commit {provenance.commit()}, code {code}.',
    ]
    goals.show(args.output, shown, said)


if __name__ == '__main__':
    raise SystemExit(main())

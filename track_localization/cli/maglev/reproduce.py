"""``reproduce maglev``: the paper's figures beside ours, and the acceptance table."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from maglev_localization.methods import METHODS
from track_localization.cli import goals
from track_localization.cli.arguments import add_exam
from track_localization.cli.common import guarded, seed_range
from track_localization.cli.exam_runs import Run, Task, runs_note
from track_localization.cli.maglev import reproduce_goals, reproduce_paper, reproduce_tables
from track_localization.cli.maglev.reproduce_runs import (
    CASES,
    FLOORS,
    KEEPER,
    LINE,
    MISSED,
    PAPER,
    code_fingerprint,
)
from track_localization.evaluation import provenance
from track_localization.evaluation.tabulate import Table

EXAM_SEEDS = range(1000, 1050)
"""Seeds that nothing was tuned on."""
FAULT_SEEDS = 20
"""How many of them see the scenarios with faults."""


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, run, print the tables; return the exit code."""
    args = make_parser().parse_args(argv)
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='reproduce maglev',
        description="Simulate runs, run every method, print the paper's figures beside ours and "
        'whether the goals are met. Runs are kept: a second time prints from them.',
    )
    parser.add_argument(
        '--seeds',
        type=seed_range,
        default=EXAM_SEEDS,
        metavar='A:B',
        help=f'1000:1050; scenarios with faults: the first {FAULT_SEEDS} of them',
    )
    reproduce_paper.add_arguments(parser)
    add_exam(parser, tuple(CASES), METHODS)
    parser.add_argument('--output', type=Path, default=Path('reproduce', 'maglev'), metavar='DIR')
    return parser


def run(args: argparse.Namespace) -> None:
    """Run or read the runs, then print and write the tables."""
    code = code_fingerprint()
    runs = KEEPER.gather(make_tasks(args), args.output / 'runs', args.jobs, args.reprint, code)
    papers = papers_tables(args) if {PAPER, MISSED} & set(args.scenarios) else {}
    publish(args, papers, runs, code)


def papers_tables(args: argparse.Namespace) -> dict[str, Table]:
    """Return the paper's claims beside ours, and draw its figures."""
    names = ('claims', 'particles')
    tables = reproduce_paper.paper_tables(args.paper_seeds, args.jobs, args.output, args.reprint)
    return dict(zip(names, tables, strict=True))


def make_tasks(args: argparse.Namespace) -> list[Task]:
    """Return the runs to make, the long ones first."""
    tasks = []
    for name in args.scenarios:
        case = CASES[name]
        entries = tuple(
            n for n, e in case.entries.items() if e.method in args.methods or e.method in FLOORS
        )
        seeds = args.seeds if name == LINE else args.seeds[:FAULT_SEEDS]
        if name in (PAPER, MISSED):
            seeds = args.paper_seeds
        if any(case.entries[n].method in args.methods for n in entries):
            tasks += [Task(name, seed, entries) for seed in seeds]
    return tasks


def publish(
    args: argparse.Namespace, papers: Mapping[str, Table], runs: Sequence[Run], code: str
) -> None:
    """Print the tables; write them as Markdown and CSV."""
    exam = reproduce_tables.exam_of(runs)
    tables = {
        'optimum': reproduce_tables.optimum_table(exam),
        'missed': reproduce_tables.missed_table(exam),
        'line': reproduce_tables.line_table(exam),
        'faults': reproduce_tables.faults_table(exam),
        'dead': reproduce_tables.dead_table(exam),
    }
    shown = dict(papers) | {name: table for name, table in tables.items() if table.rows}
    shown['goals'] = goals.table(reproduce_goals.goals(exam))
    said = [
        f'reproduce maglev --seeds {args.seeds.start}:{args.seeds.stop} '
        f'--paper-seeds {args.paper_seeds.start}:{args.paper_seeds.stop} '
        f'--scenarios {",".join(args.scenarios)} --methods {",".join(args.methods)}.',
        *runs_note(runs),
        f'Run times with {args.jobs} jobs on {provenance.machine()["processors"]} processors.',
        f'Commit {provenance.commit()}, code {code}.',
    ]
    goals.show(args.output, shown, said)


if __name__ == '__main__':
    raise SystemExit(main())

"""Arguments that the systems' command lines share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from track_localization.cli.common import assignment, names_among, settings_help
from track_localization.errors import DataError
from track_localization.settings import override

Config = TypeVar('Config')


def settings_parser(prog: str, description: str, config: Any) -> argparse.ArgumentParser:
    """Return a parser with ``--set``; its epilog lists every setting of ``config``."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description=description,
        epilog=f'settings:\n{settings_help(config)}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--set',
        type=assignment,
        action='append',
        default=[],
        metavar='FIELD=VALUE',
        help='change a setting; may be repeated',
    )
    return parser


def check_settings(parser: argparse.ArgumentParser, args: argparse.Namespace, config: Any) -> None:
    """End as wrong usage where ``--set`` names no setting of ``config`` or no value for one."""
    try:
        override(config, dict(args.set))
    except DataError as error:
        parser.error(f'--set: {error}')


def add_evaluation(parser: argparse.ArgumentParser, methods: Sequence[str]) -> None:
    """Add what every ``evaluate`` takes."""
    parser.add_argument(
        '--methods',
        type=names_among(methods),
        default=methods,
        help=f'some of {",".join(methods)}',
    )
    parser.add_argument('--output', type=Path, default=Path('evaluation'), metavar='DIR')
    parser.add_argument('--no-plots', action='store_true', help='leave the pictures out')


def add_simulation(parser: argparse.ArgumentParser, default: str, listed: str) -> None:
    """Add what every ``simulate`` takes; ``default`` is its scenario, ``listed`` what it lists."""
    parser.add_argument('--seed', type=int, default=1, help='same seed, same bits (1)')
    parser.add_argument('--scenario', default=default, help=f'what to simulate ({default})')
    parser.add_argument('--output', type=Path, metavar='DIR', help='where the files go')
    parser.add_argument('--list', action='store_true', help=f'list {listed}, and end')


def simulation(
    parser: argparse.ArgumentParser,
    args: argparse.Namespace,
    scenarios: Mapping[str, Any],
    scenario: Callable[[str], Config],
) -> Config:
    """Return the settings of a simulation; arguments that make none end as wrong usage."""
    if args.output is None:
        parser.error('--output DIR is missing')
    if args.scenario not in scenarios:
        parser.error(f'unknown scenario {args.scenario!r}; known: {", ".join(scenarios)}')
    if args.seed < 0:
        parser.error(f'--seed {args.seed}: must not be negative')
    try:
        return override(scenario(args.scenario), dict(args.set))
    except DataError as error:
        parser.error(str(error))


def scenario_list(scenarios: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the scenarios, a line for each with the settings that it changes."""
    lines = (
        f'  {name:12} ' + (', '.join(f'{k}={v}' for k, v in changes.items()) or 'the defaults')
        for name, changes in scenarios.items()
    )
    return '\n'.join(['scenarios:', *lines])


def add_exam(parser: argparse.ArgumentParser, cases: Sequence[str], methods: Sequence[str]) -> None:
    """Add what a ``reproduce`` of simulated runs takes besides seeds and output."""
    for name, known in (('--scenarios', cases), ('--methods', methods)):
        parser.add_argument(
            name,
            type=names_among(known),
            default=tuple(known),
            metavar='A,B',
            help=f'some of {", ".join(known)}',
        )
    parser.add_argument('--jobs', type=int, default=2, help='worker processes (2)')
    parser.add_argument(
        '--reprint', action='store_true', help='print from the runs kept, whatever code made them'
    )

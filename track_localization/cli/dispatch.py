"""Commands that serve every system: ``COMMAND SYSTEM ...`` runs that system's own command line."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from track_localization.cli.common import DONE, WRONG_USAGE

SYSTEMS = {'coaster': 'roller coaster', 'maglev': 'maglev train', 'train': 'high-speed train'}
"""Systems, each with a folder of command lines here, and what they are."""


def run(command: str, about: str, argv: Sequence[str] | None) -> int:
    """
    Run ``command`` of the system that ``argv`` names first; return the exit code.

    The system's own module has ``main(argv)`` and is loaded only when it is asked for. As
    argparse does, help and wrong usage raise SystemExit.
    """
    args = list(sys.argv[1:] if argv is None else argv)
    if args and args[0] in SYSTEMS:
        module = importlib.import_module(f'track_localization.cli.{args[0]}.{command}')
        code: int = module.main(args[1:])
        return code
    systems = ', '.join(f'{name} ({what})' for name, what in SYSTEMS.items())
    text = f'usage: {command} SYSTEM ...\n\n{about}\n\nsystems: {systems}'
    help_of = f'`{command} SYSTEM --help` tells what can be said about one'
    if args and args[0] in ('-h', '--help'):
        print(f'{text}\n{help_of}')
        raise SystemExit(DONE)
    wrong = f'{args[0]!r} is no system' if args else 'name a system'
    print(f'usage: {command} SYSTEM ...\n{command}: error: {wrong}: {systems}', file=sys.stderr)
    raise SystemExit(WRONG_USAGE)

"""What the command lines share: exit codes, ``--set``, and progress on stderr."""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

from track_localization.errors import DataError
from track_localization.settings import walk

DONE, BAD_DATA, WRONG_USAGE = 0, 1, 2


def guarded(command: Callable[[], None]) -> int:
    """
    Run a command and return its exit code.

    0 when done, 1 when data cannot be used (the reason goes to stderr), 130 on Ctrl-C. Wrong usage
    is argparse's own: it exits with 2.
    """
    try:
        command()
        sys.stdout.flush()
    except DataError as error:
        print(f'error: {error}', file=sys.stderr)
        return BAD_DATA
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except KeyboardInterrupt:
        return 130
    return DONE


def say(message: str) -> None:
    """Report progress on stderr."""
    print(message, file=sys.stderr, flush=True)


def assignment(text: str) -> tuple[str, str]:
    """Parse ``field=value`` of ``--set``; argparse turns the error into wrong usage."""
    name, equals, value = text.partition('=')
    if not equals or not name.strip():
        raise argparse.ArgumentTypeError(f'{text!r} is not field=value')
    return name.strip(), value.strip()


def remapping(text: str) -> tuple[str, str]:
    """Parse ``from:=to`` of ``--remap``; argparse turns the error into wrong usage."""
    name, sign, topic = text.partition(':=')
    if not sign or not name or not topic:
        raise argparse.ArgumentTypeError(f'{text!r} is not from:=to')
    return name, topic


def names_among(known: Sequence[str]) -> Callable[[str], tuple[str, ...]]:
    """Return an argparse type: names separated by commas, each of ``known``, each once."""

    def parse(text: str) -> tuple[str, ...]:
        names = tuple(dict.fromkeys(name.strip() for name in text.split(',') if name.strip()))
        unknown = [name for name in names if name not in known]
        if unknown or not names:
            raise argparse.ArgumentTypeError(
                f'{", ".join(unknown) or "nothing"} is not known; there are {", ".join(known)}'
            )
        return names

    return parse


def seed_range(text: str) -> range:
    """Parse ``A:B`` of ``--seeds``; argparse turns the error into wrong usage."""
    first, colon, last = text.partition(':')
    try:
        seeds = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not A:B') from None
    if not seeds or seeds.start < 0:
        raise argparse.ArgumentTypeError(f'{text!r}: no seeds in it')
    return seeds


def settings_help(config: Any) -> str:
    """Return one line for each setting of ``config``: name, default, unit and meaning."""
    lines = []
    for name, field, value in walk(config):
        unit = f' {field.metadata["unit"]}' if field.metadata.get('unit') else ''
        shown = list(value) if isinstance(value, tuple) else value
        lines.append(f'  {name} = {shown}{unit}  {field.metadata.get("doc", "")}')
    return '\n'.join(lines)


def plain(config: Any) -> dict[str, Any]:
    """Return a config as nested dictionaries and lists that YAML can hold."""

    def convert(value: Any) -> Any:
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return {f.name: convert(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return [convert(v) for v in value] if isinstance(value, tuple) else value

    content: dict[str, Any] = convert(config)
    return content

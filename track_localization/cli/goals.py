"""Goals: what is asked, what was measured, whether it is met; and how ``reproduce`` shows them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from track_localization.evaluation.tabulate import Table


@dataclasses.dataclass(frozen=True)
class Goal:
    """
    One line of the acceptance table.

    Attributes:
        what: is asked.
        goal: how much of it.
        ours: what was measured.
        met: None where nothing was run that tells.
        best: what can be reached at all, where it is known; a column where any goal has it.
    """

    what: str
    goal: str
    ours: str
    met: bool | None
    best: str = ''


def table(goals: Sequence[Goal]) -> Table:
    """Return the acceptance table."""
    words = {True: 'met', False: 'NOT met', None: ''}
    columns = ['what', 'goal', 'ours', '']
    rows = [[g.what, g.goal, 'not run' if g.met is None else g.ours, words[g.met]] for g in goals]
    if any(g.best for g in goals):
        columns.append('best there can be')
        rows = [[*row, g.best] for row, g in zip(rows, goals, strict=True)]
    return Table('What it must reach', columns, rows)


def at_most(value: float, limit: float) -> bool | None:
    """Return whether a value keeps within a limit; None where it is not known."""
    return None if np.isnan(value) else bool(value <= limit)


def show(folder: Path, tables: Mapping[str, Table], said: Sequence[str]) -> None:
    """Print the tables and sentences; write them as reproduce.md and each table as CSV."""
    print('\n\n'.join([*(table.text() for table in tables.values()), '\n'.join(said)]))
    folder.mkdir(parents=True, exist_ok=True)
    parts = [table.markdown() for table in tables.values()] + ['  \n'.join(said)]
    (folder / 'reproduce.md').write_text('\n\n'.join(parts) + '\n', encoding='utf-8')
    for name, table in tables.items():
        (folder / f'{name}.csv').write_text(table.csv(), encoding='utf-8')

"""Balises along a line: their names and surveyed chainages."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError

Array = NDArray[np.float64]

COLUMNS = ('id', 'chainage_m', 'sigma_m')
"""Columns of a balise table's file."""


@dataclasses.dataclass(frozen=True)
class BaliseTable:
    """
    Where balises lie, in order of chainage.

    Attributes:
        id: (M,) what each balise tells the train.
        chainage: (M,) surveyed distance along the track [m].
        sigma: (M,) standard deviation of the survey [m].
    """

    id: tuple[str, ...]
    chainage: Array
    sigma: Array

    def __post_init__(self) -> None:
        """Put the balises in order of chainage."""
        order = np.argsort(self.chainage, kind='stable')
        object.__setattr__(self, 'id', tuple(self.id[i] for i in order))
        object.__setattr__(self, 'chainage', np.asarray(self.chainage, dtype=np.float64)[order])
        object.__setattr__(self, 'sigma', np.asarray(self.sigma, dtype=np.float64)[order])
        object.__setattr__(self, '_index', {name: i for i, name in enumerate(self.id)})

    def __len__(self) -> int:
        return len(self.id)

    def index(self, id: str) -> int | None:
        """Return the row of a balise, or None for an id that the table does not know."""
        index: dict[str, int] = self.__dict__['_index']
        return index.get(id)


def write_balises(path: str | Path, table: BaliseTable) -> None:
    """Write ``balises.csv``: ``id,chainage_m,sigma_m``."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(COLUMNS)
        for row in zip(table.id, table.chainage.tolist(), table.sigma.tolist(), strict=True):
            writer.writerow((row[0], f'{row[1]:.6f}', f'{row[2]:.6f}'))


def read_balises(path: str | Path) -> BaliseTable:
    """
    Read ``balises.csv``; rows and columns may stand in any order, ``#`` begins a comment.

    Raise DataError that names the line when the file, a column or a value is missing, an id
    stands twice, a number is not finite or a sigma not positive.
    """
    path = Path(path)
    lines = _lines(path)
    header = [cell.strip() for cell in lines[0][1]] if lines else []
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise DataError(
            f'{path}: column {", ".join(missing)} missing; expected {",".join(COLUMNS)}'
        )
    if len(lines) < 2:
        raise DataError(f'{path}: only a header, no balises; give each a row {",".join(COLUMNS)}')
    columns = [header.index(name) for name in COLUMNS]
    seen: dict[str, int] = {}
    numbers = []
    for line, cells in lines[1:]:
        if len(cells) != len(header):
            raise DataError(f'{path}: line {line} has {len(cells)} cells, the header {len(header)}')
        name, chainage, sigma = (cells[c].strip() for c in columns)
        _check_id(path, line, name, seen)
        seen[name] = line
        numbers.append((_number(path, line, 'chainage_m', chainage), _sigma(path, line, sigma)))
    table = np.array(numbers)
    return BaliseTable(tuple(seen), table[:, 0], table[:, 1])


def _check_id(path: Path, line: int, name: str, seen: dict[str, int]) -> None:
    if not name:
        raise DataError(f'{path}: line {line}: id is empty; every balise needs one')
    if name in seen:
        raise DataError(
            f'{path}: line {line}: id {name} stands in line {seen[name]} already; '
            'remove one of them or mend the id'
        )


def _sigma(path: Path, line: int, cell: str) -> float:
    sigma = _number(path, line, 'sigma_m', cell)
    if sigma <= 0.0:
        raise DataError(
            f'{path}: line {line}: sigma_m {cell} is not positive; give the standard deviation '
            "of the balise's survey"
        )
    return sigma


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return (line number, cells) of the lines that are neither blank nor comments."""
    try:
        text = path.read_text(encoding='utf-8-sig')
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror}); name a balise table') from None
    except UnicodeDecodeError:
        raise DataError(f'{path}: not text; a balise table is a CSV {",".join(COLUMNS)}') from None
    used = [
        (i, line)
        for i, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith('#')
    ]
    if not used:
        raise DataError(f'{path}: empty; expected a header {",".join(COLUMNS)} and rows')
    delimiter = next((d for d in (';', '\t') if d in used[0][1]), ',')
    cells = csv.reader((line for _, line in used), delimiter=delimiter)
    return [(i, row) for (i, _), row in zip(used, cells, strict=True)]


def _number(path: Path, line: int, column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise DataError(f'{path}: line {line}, {column}: {cell!r} is not a number') from None
    if not math.isfinite(value):
        raise DataError(f'{path}: line {line}, {column}: {cell} is not finite; survey it anew')
    return value

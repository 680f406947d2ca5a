"""What recorded rides taught of a line: usual speed and the built track's attitude, by chainage."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError

Array = NDArray[np.float64]

COLUMNS = (
    *('chainage_m', 'speed_mps', 'speed_sigma_mps', 'turn_x_rad', 'turn_y_rad', 'turn_z_rad'),
    *('sigma_rad', 'rides'),
)
"""Columns of ``learned_line.csv``, in the order they are written."""
MAY_BE_BLANK = ('speed_mps', 'speed_sigma_mps', 'sigma_rad')


@dataclasses.dataclass(frozen=True)
class LearnedLine:
    """
    Corrections to a design line, M rows; NaN where no ride tells.

    Attributes:
        chainage: (M,) strictly increasing [m].
        speed: (M,) usual speed [m/s].
        speed_sigma: (M,) of what is left when a ride's own pace is taken out [m/s].
        turn: (M, 3) rotation vectors in body axes, from the design's attitude to the built [rad].
        sigma: (M,) standard deviation of the attitude that is left [rad].
        rides: (M,) how many passes tell of the row.
    """

    chainage: Array
    speed: Array
    speed_sigma: Array
    turn: Array
    sigma: Array
    rides: Array


def write_learned_line(path: str | Path, learned: LearnedLine) -> None:
    """Write ``learned_line.csv``; what is NaN stays blank."""
    table = np.column_stack(
        [
            *(learned.chainage, learned.speed, learned.speed_sigma),
            *(learned.turn, learned.sigma, learned.rides),
        ]
    )
    digits = (3, 4, 4, 7, 7, 7, 7, 0)
    lines = [','.join(COLUMNS)]
    for row in table.tolist():
        cells = [f'{v:.{d}f}' if math.isfinite(v) else '' for v, d in zip(row, digits, strict=True)]
        lines.append(','.join(cells))
    Path(path).write_text('\n'.join(lines) + '\n', encoding='utf-8')


def read_learned_line(path: str | Path) -> LearnedLine:
    """
    Read ``learned_line.csv``; columns may stand in any order.

    Raise DataError, naming file, row, column and remedy, for what cannot be used.
    """
    try:
        text = Path(path).read_text(encoding='utf-8-sig')
    except OSError as error:
        raise DataError(
            f'{path}: cannot be read ({error.strerror}); `learn_line` writes such a file'
        ) from None
    except UnicodeDecodeError:
        raise DataError(f'{path}: not text; `learn_line` writes such a file') from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith('#')]
    names = [name.strip() for name in lines[0].split(',')] if lines else []
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise DataError(f'{path}: no column {", ".join(missing)}; expected {",".join(COLUMNS)}')
    rows = [line.split(',') for line in lines[1:]]
    if len(rows) < 2:
        raise DataError(f'{path}: {len(rows)} rows; at least two are needed, learn the line anew')
    n = {name: _column(path, name, names, rows) for name in COLUMNS}
    late = np.flatnonzero(np.diff(n['chainage_m']) <= 0.0)
    if len(late):
        raise DataError(f'{path}: chainage_m does not increase at row {late[0] + 3}; sort by it')
    for name in ('speed_sigma_mps', 'sigma_rad'):
        bad = np.flatnonzero(n[name] <= 0.0)
        if len(bad):
            raise DataError(f'{path}: row {bad[0] + 2}, {name} is not positive; learn it anew')
    turn = np.column_stack([n['turn_x_rad'], n['turn_y_rad'], n['turn_z_rad']])
    far = np.flatnonzero(np.linalg.norm(turn, axis=1) > 0.5)
    if len(far):
        raise DataError(f'{path}: row {far[0] + 2}: turns by more than 0.5 rad; are these degrees?')
    return LearnedLine(
        *(n['chainage_m'], n['speed_mps'], n['speed_sigma_mps'], turn, n['sigma_rad'], n['rides'])
    )


def _column(path: str | Path, name: str, names: list[str], rows: list[list[str]]) -> Array:
    place = names.index(name)
    out = np.full(len(rows), np.nan)
    for i, cells in enumerate(rows):
        if len(cells) != len(names):
            raise DataError(f'{path}: row {i + 2} has {len(cells)} cells, the header {len(names)}')
        cell = cells[place].strip()
        try:
            out[i] = float(cell) if cell or name not in MAY_BE_BLANK else np.nan
        except ValueError:
            raise DataError(
                f'{path}: row {i + 2}, {name}: {cell!r} is not a number; learn the line anew'
            ) from None
        if cell and not np.isfinite(out[i]):
            raise DataError(f'{path}: row {i + 2}, {name} is not finite; learn the line anew')
    return out

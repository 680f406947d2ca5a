"""
Text tables: columns by name, with errors that say which cell is wrong.

Commas, semicolons and tabs separate cells; a byte-order mark, UTF-16, blank lines and ``#``
comments are accepted, and so is the decimal comma where semicolons separate.
"""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.markers import Markers as Markers

Array = NDArray[np.float64]

MARKER_COLUMNS = ('time_s', 'name', 'x_m', 'y_m', 'z_m')
TRAJECTORY_COLUMNS = (
    *('time_s', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw', 'vx_mps', 'vy_mps', 'vz_mps'),
    *('chainage_m', 'speed_mps', 'sigma_along_m', 'sigma_x_m', 'sigma_y_m', 'sigma_z_m'),
    'sigma_speed_mps',
)


@dataclasses.dataclass(frozen=True)
class Table:
    """
    Columns of a file, all of the same length.

    Attributes:
        numbers: numeric columns by name, (N,) each; NaN where a blank cell was allowed.
        texts: text columns by name.
    """

    numbers: dict[str, Array]
    texts: dict[str, list[str]]


@dataclasses.dataclass(frozen=True)
class Events:
    """Times (N,) in the recording's clock [s] at which something happened, and N names for it."""

    time_s: Array
    name: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time_s)


def read_table(
    path: str | Path,
    required: Sequence[str],
    optional: Sequence[str] = (),
    text: Sequence[str] = (),
    blank: bool = False,
) -> Table:
    """
    Read the named columns of a file; see ``parse_table``.

    Raises:
        DataError: a missing or unreadable file, and all that ``parse_table`` raises.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from None
    return parse_table(str(path), content, required, optional, text, blank)


def parse_table(
    name: str,
    content: bytes,
    required: Sequence[str],
    optional: Sequence[str] = (),
    text: Sequence[str] = (),
    blank: bool = False,
) -> Table:
    """
    Take the named columns out of a table; other columns are ignored.

    Args:
        name: what to call the table in an error, usually its path.
        content: the file's bytes.
        required: columns that must be there.
        optional: columns that are read if they are there.
        text: those of the above that are not numbers.
        blank: whether a number may be blank, NaN or infinite; a blank becomes NaN.

    Raises:
        DataError: no rows, a missing or repeated column, a row of another length than the header,
            or a cell that is not a finite number; with the line and column.
    """
    rows = _rows(name, content)
    first = next(rows, None)
    if first is None:
        raise DataError(f'{name}: empty; a header and rows are needed: {",".join(required)}')
    header = [cell.strip() for cell in first[1]]
    _check_header(name, header, required)
    wanted = [c for c in (*required, *optional) if c in header]
    places = [header.index(c) for c in wanted]
    lines: list[int] = []
    columns: list[list[str]] = [[] for _ in wanted]
    for line, cells in rows:
        if len(cells) < len(header) or any(c.strip() for c in cells[len(header) :]):
            raise DataError(f'{name}: line {line} has {len(cells)} cells, the header {len(header)}')
        lines.append(line)
        for column, place in zip(columns, places, strict=True):
            column.append(cells[place])
    if not lines:
        raise DataError(f'{name}: only a header, no rows')
    numbers = {
        c: _numbers(name, c, values, lines, blank)
        for c, values in zip(wanted, columns, strict=True)
        if c not in text
    }
    texts = {
        c: [v.strip() for v in values]
        for c, values in zip(wanted, columns, strict=True)
        if c in text
    }
    return Table(numbers, texts)


def write_table(path: str | Path, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write a comma-separated file with a header; cells are text already."""
    with Path(path).open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(columns)
        writer.writerows(rows)


def read_markers(path: str | Path) -> Markers:
    """Read ``markers.csv``: ``time_s,name,x_m,y_m,z_m``; raise DataError if it cannot be used."""
    table = read_table(path, MARKER_COLUMNS, text=('name',))
    n = table.numbers
    position = np.stack([n['x_m'], n['y_m'], n['z_m']], axis=1)
    return Markers(n['time_s'], tuple(table.texts['name']), position)


def write_markers(path: str | Path, markers: Markers) -> None:
    """Write ``markers.csv``; white space in a name becomes single blanks."""
    rows = [
        [_cell(t, 9), ' '.join(name.split()), *(_cell(v, 6) for v in p)]
        for t, name, p in zip(markers.time_s, markers.name, markers.position, strict=True)
    ]
    write_table(path, MARKER_COLUMNS, rows)


def read_events(path: str | Path) -> Events:
    """Read ``time_s,name``; raise DataError if it cannot be used."""
    table = read_table(path, ('time_s', 'name'), text=('name',))
    return Events(table.numbers['time_s'], tuple(table.texts['name']))


def write_trajectory(path: str | Path, trajectory: Trajectory) -> None:
    """Write ``trajectory_<method>.csv``; cells of quantities that are None or NaN stay empty."""
    n = len(trajectory)
    absent = np.full((n, 1), np.nan)

    def columns(values: Array | None, width: int) -> Array:
        return np.repeat(absent, width, axis=1) if values is None else values.reshape(n, width)

    sigma = None
    if trajectory.covariance is not None:
        sigma = np.sqrt(np.maximum(np.diagonal(trajectory.covariance, axis1=1, axis2=2), 0.0))
    values = np.hstack(
        [
            trajectory.position,
            columns(trajectory.quaternion, 4),
            columns(trajectory.velocity, 3),
            columns(trajectory.chainage, 1),
            columns(trajectory.speed, 1),
            columns(trajectory.sigma_along, 1),
            columns(sigma, 3),
            columns(trajectory.sigma_speed, 1),
        ]
    )
    digits = (6, 6, 6, 9, 9, 9, 9, *[6] * 10)
    rows = [
        [_cell(t, 9), *(_cell(v, d) for v, d in zip(row, digits, strict=True))]
        for t, row in zip(trajectory.time_s.tolist(), values.tolist(), strict=True)
    ]
    write_table(path, TRAJECTORY_COLUMNS, rows)


def read_trajectory(path: str | Path) -> Trajectory:
    """
    Read ``trajectory_<method>.csv``; columns that are absent or empty give None.

    The covariance is diagonal: that is all the file holds. Raise DataError if it cannot be used.
    """
    needed = TRAJECTORY_COLUMNS[:4]
    n = read_table(path, needed, TRAJECTORY_COLUMNS[4:], blank=True).numbers

    def stack(*names: str) -> Array | None:
        if any(c not in n or np.isnan(n[c]).all() for c in names):
            return None
        return np.stack([n[c] for c in names], axis=1)

    def one(name: str) -> Array | None:
        column = stack(name)
        return None if column is None else column[:, 0]

    for c in needed:
        if not np.isfinite(n[c]).all():
            raise DataError(f'{path}: column {c} has blank or infinite cells; every row needs it')
    sigma = stack('sigma_x_m', 'sigma_y_m', 'sigma_z_m')
    return Trajectory(
        n['time_s'],
        np.stack([n['x_m'], n['y_m'], n['z_m']], axis=1),
        quaternion=stack('qx', 'qy', 'qz', 'qw'),
        velocity=stack('vx_mps', 'vy_mps', 'vz_mps'),
        chainage=one('chainage_m'),
        speed=one('speed_mps'),
        covariance=None if sigma is None else sigma[:, :, None] ** 2 * np.eye(3),
        sigma_along=one('sigma_along_m'),
        sigma_speed=one('sigma_speed_mps'),
    )


def _cell(value: float, digits: int) -> str:
    return f'{value:.{digits}f}' if math.isfinite(value) else ''


def _rows(name: str, content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Yield (line number, cells) of the lines that are neither blank nor comments."""
    encoding = 'utf-16' if content[:2] in (b'\xff\xfe', b'\xfe\xff') else 'utf-8-sig'
    try:
        lines = content.decode(encoding).splitlines()
    except UnicodeDecodeError as error:
        raise DataError(
            f'{name}: not text in UTF-8 (byte {error.start}); save it as CSV in UTF-8'
        ) from None
    used = [(i, text) for i, text in enumerate(lines, 1) if text.strip() and text[0] != '#']
    if not used:
        return
    head = used[0][1]
    delimiter = max(',;\t', key=head.count)
    reader = csv.reader((text for _, text in used), delimiter=delimiter)
    try:
        for cells in reader:
            if delimiter == ';':
                cells = [c.replace(',', '.') if _decimal_comma(c) else c for c in cells]
            yield used[reader.line_num - 1][0], cells
    except csv.Error as error:
        raise DataError(f'{name}: line {reader.line_num}: not a table ({error})') from None


def _decimal_comma(cell: str) -> bool:
    whole, comma, fraction = cell.strip().partition(',')
    return bool(comma) and whole.lstrip('+-').isdigit() and fraction[:1].isdigit()


def _check_header(name: str, header: list[str], required: Sequence[str]) -> None:
    missing = [c for c in required if c not in header]
    if missing:
        raise DataError(
            f'{name}: no column {", ".join(missing)}; the header is {",".join(header)}; '
            f'expected {",".join(required)}'
        )
    repeated = sorted({c for c in header if c and header.count(c) > 1})
    if repeated:
        raise DataError(f'{name}: column {", ".join(repeated)} stands twice in the header')


def _numbers(name: str, column: str, cells: list[str], lines: list[int], blank: bool) -> Array:
    """Return a column as numbers, or raise DataError naming the first bad cell."""
    out = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            out[i] = float(cell) if cell.strip() or not blank else np.nan
        except ValueError:
            raise DataError(
                f'{name}: line {lines[i]}, column {column}: {cell.strip()!r} is not a number'
            ) from None
    if not blank and not np.isfinite(out).all():
        i = int(np.argmin(np.isfinite(out)))
        raise DataError(
            f'{name}: line {lines[i]}, column {column}: {cells[i].strip()!r} is not finite'
        )
    return out

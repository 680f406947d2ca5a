"""Track files in the column layout of NoLimits 2's track export."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError

Array = NDArray[np.float64]

COLUMNS = (
    *('No.', 'PosX', 'PosY', 'PosZ', 'FrontX', 'FrontY', 'FrontZ'),
    *('LeftX', 'LeftY', 'LeftZ', 'UpX', 'UpY', 'UpZ'),
)
"""Columns as they are written."""

MAP_FROM_FILE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""The file is Y-up: map x = X, y = -Z, z = Y."""


@dataclasses.dataclass(frozen=True)
class TrackFile:
    """
    Points of a track in order of travel, with the vehicle's axes there, all in ``map``.

    Attributes:
        position: (N, 3) [m].
        front, left, up: (N, 3) unit vectors.
    """

    position: Array
    front: Array
    left: Array
    up: Array

    def __len__(self) -> int:
        return len(self.position)

    @property
    def attitude(self) -> Array:
        """R_nb (N, 3, 3): front, left and up as columns."""
        return np.stack([self.front, self.left, self.up], axis=-1)

    def shifted(self, up_m: float) -> TrackFile:
        """Return the line moved along ``up``: from rail centre to heart line, or back [m]."""
        return dataclasses.replace(self, position=self.position + up_m * self.up)


def write_track(path: str | Path, track: TrackFile, delimiter: str = ',') -> None:
    """Write a track file, separated by ``delimiter`` (NoLimits 2 itself writes tabs)."""
    vectors = (track.position, track.front, track.left, track.up)
    table = np.concatenate([v @ MAP_FROM_FILE for v in vectors], axis=1)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('w', encoding='utf-8') as out:
        out.write(delimiter.join(COLUMNS) + '\n')
        for number, row in enumerate(np.where(np.abs(table) < 1e-9, 0.0, table), start=1):
            out.write(delimiter.join([str(number), *(f'{v:.9f}' for v in row)]) + '\n')


def read_track(path: str | Path) -> TrackFile:
    """
    Read a track file; repeated points are dropped.

    Separators may be tabs, semicolons or commas (decimal commas with the first two); column names
    may differ in case, blanks and underscores, and others may stand between them. Raise DataError
    that names the row and column when the file cannot be used.
    """
    path = Path(path)
    lines = _lines(path)
    number, header, delimiter = _header(path, lines)
    columns = [header.index(_plain(name)) for name in COLUMNS[1:]]
    rows, origin = [], []
    for i, line in lines[number + 1 :]:
        cells = [cell.strip().strip('"') for cell in line.split(delimiter)]
        if len(cells) <= max(columns):
            raise DataError(f'{path}: line {i} has {len(cells)} values, the header {len(header)}')
        try:
            rows.append([_number(cells[c], delimiter) for c in columns])
        except ValueError:
            raise DataError(f'{path}: line {i} holds text where a number belongs') from None
        origin.append(i)
    table = np.array(rows).reshape(-1, 12)
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise DataError(f'{path}: line {origin[row]}, {COLUMNS[column + 1]} is not finite')
    vectors = table.reshape(-1, 4, 3) @ MAP_FROM_FILE.T
    return _checked(path, vectors, np.array(origin))


def _lines(path: Path) -> list[tuple[int, str]]:
    """Return (line number, text) of the lines that are not blank."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror}); name a track file') from None
    encoding = 'utf-16' if raw[:2] in (b'\xff\xfe', b'\xfe\xff') else 'utf-8-sig'
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        raise DataError(f'{path}: not text; export the track as CSV from the editor') from None
    return [(i, line) for i, line in enumerate(text.splitlines(), start=1) if line.strip()]


def _header(path: Path, lines: list[tuple[int, str]]) -> tuple[int, list[str], str]:
    """Find the header among the first lines: (its place, plain names, delimiter)."""
    closest: list[str] = [_plain(name) for name in COLUMNS[1:]]
    for place, (_, line) in enumerate(lines[:20]):
        for delimiter in ('\t', ';', ','):
            names = [_plain(name) for name in line.split(delimiter)]
            missing = [name for name in COLUMNS[1:] if _plain(name) not in names]
            if not missing:
                return place, names, delimiter
            if len(missing) < len(closest):
                closest = missing
    if len(closest) < 12:
        raise DataError(
            f'{path}: column {", ".join(closest)} missing; expected {",".join(COLUMNS)}'
        )
    raise DataError(f'{path}: no header line; expected {",".join(COLUMNS)}')


def _plain(name: str) -> str:
    return ''.join(c for c in name.lower() if c.isalnum())


def _number(cell: str, delimiter: str) -> float:
    return float(cell if delimiter == ',' else cell.replace(',', '.'))


def _checked(path: Path, vectors: Array, origin: NDArray[np.int64]) -> TrackFile:
    """Check geometry; ``vectors`` (N, 4, 3) hold position, front, left, up in ``map``."""
    moved = np.linalg.norm(np.diff(vectors[:, 0], axis=0), axis=1) > 1e-6
    keep = np.concatenate([[True], moved]) if len(vectors) else np.zeros(0, dtype=bool)
    vectors, origin = vectors[keep], origin[keep]
    if len(vectors) < 8:
        raise DataError(f'{path}: {len(vectors)} points; a track needs at least 8')
    axes = np.swapaxes(vectors[:, 1:], 1, 2)
    gram = np.swapaxes(axes, 1, 2) @ axes
    skew = np.abs(gram - np.eye(3)).max(axis=(1, 2))
    worst = int(np.argmax(skew))
    if skew[worst] > 0.02:
        raise DataError(
            f'{path}: line {origin[worst]}: Front, Left and Up are not unit vectors at right '
            f'angles (off by {skew[worst]:.3f}); export the track anew'
        )
    if np.median(np.linalg.det(axes)) < 0.0:
        raise DataError(
            f'{path}: Front, Left and Up are left-handed: the Left columns point right; '
            'change their sign'
        )
    along = np.diff(vectors[:, 0], axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    agreement = float(np.median(np.sum(along * vectors[:-1, 1], axis=1)))
    if agreement < 0.9:
        how = 'against' if agreement < -0.9 else 'across'
        raise DataError(
            f'{path}: Front points {how} the order of the rows; the file is Y-up with rows in '
            'order of travel'
        )
    R = _orthonormal(axes)
    return TrackFile(vectors[:, 0].copy(), R[:, :, 0], R[:, :, 1], R[:, :, 2])


def _orthonormal(axes: Array) -> Array:
    """Return the rotations (N, 3, 3) nearest to slightly inexact axes."""
    u, _, vt = np.linalg.svd(axes)
    R: Array = u @ vt
    return R

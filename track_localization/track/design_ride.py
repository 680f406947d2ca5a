"""The design ride: the simulated motion of the seat along the design track, by time."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from track_localization.errors import DataError

Array = NDArray[np.float64]

COLUMNS = (
    *('time_s', 'chainage_m', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw', 'vx_mps', 'vy_mps'),
    *('vz_mps', 'fx_mps2', 'fy_mps2', 'fz_mps2', 'wx_radps', 'wy_radps', 'wz_radps'),
)
"""Columns of ``design_ride.csv``, in the order they are written."""

STANDING_MPS = 0.05
"""A design that is no faster stands."""
IN_G = (0.5, 2.0)
"""Specific force so long, at rest or at the median, is in g."""


@dataclasses.dataclass(frozen=True)
class DesignRide:
    """
    Motion of the row-1 seat in the design simulation.

    Attributes:
        time_s: (N,) strictly increasing [s].
        chainage: (N,) along the track [m]; laps go on counting.
        position: (N, 3) in ``map`` [m].
        quaternion: (N, 4) x, y, z, w, body to map.
        velocity: (N, 3) in ``map`` [m/s].
        specific_force: (N, 3) in body axes [m/s^2].
        angular_rate: (N, 3) in body axes [rad/s].
    """

    time_s: Array
    chainage: Array
    position: Array
    quaternion: Array
    velocity: Array
    specific_force: Array
    angular_rate: Array

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def rate_hz(self) -> float:
        """Median sampling rate [Hz]."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    @property
    def speed(self) -> Array:
        """Speed over ground (N,) [m/s]."""
        return np.asarray(np.linalg.norm(self.velocity, axis=1))

    def at(self, time_s: Array) -> DesignRide:
        """
        Return the ride at other times (M,), which must increase.

        Positions follow cubics that keep the velocities, attitudes the shortest arc, the rest is
        linear. Times outside the ride get its first or last row.
        """
        t = np.clip(np.asarray(time_s, dtype=np.float64), self.time_s[0], self.time_s[-1])

        def linear(values: Array) -> Array:
            return np.stack([np.interp(t, self.time_s, v) for v in values.T], axis=-1)

        return DesignRide(
            time_s=np.asarray(time_s, dtype=np.float64),
            chainage=np.interp(t, self.time_s, self.chainage),
            position=CubicHermiteSpline(self.time_s, self.position, self.velocity)(t),
            quaternion=Slerp(self.time_s, Rotation.from_quat(self.quaternion))(t).as_quat(),
            velocity=linear(self.velocity),
            specific_force=linear(self.specific_force),
            angular_rate=linear(self.angular_rate),
        )

    def resample(self, rate_hz: float) -> DesignRide:
        """Return the ride on a uniform grid from its first stamp on; nothing is filtered."""
        start, end = self.time_s[0], self.time_s[-1]
        count = int(np.floor((end - start) * rate_hz + 1e-9)) + 1
        return self.at(start + np.arange(count) / rate_hz)


def write_design_ride(path: str | Path, ride: DesignRide) -> None:
    """Write ``design_ride.csv``."""
    table = np.column_stack(
        [
            ride.time_s,
            ride.chainage,
            ride.position,
            ride.quaternion,
            ride.velocity,
            ride.specific_force,
            ride.angular_rate,
        ]
    )
    table = np.where(np.abs(table) < 1e-9, 0.0, table)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    formats = ['%.6f'] * 5 + ['%.9f'] * 4 + ['%.6f'] * 9
    header = ','.join(COLUMNS)
    np.savetxt(path, table, fmt=formats, delimiter=',', header=header, comments='')


def read_design_ride(path: str | Path) -> DesignRide:
    """
    Read ``design_ride.csv``; columns may stand in any order.

    Raise DataError when the file, a column or a value is missing, time does not increase, forces
    are in g or a quaternion is not unit.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding='utf-8-sig').splitlines()
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror}); name a design ride') from None
    except UnicodeDecodeError:
        raise DataError(f'{path}: not text; a design ride is a CSV of {COLUMNS}') from None
    lines = [line for line in lines if line.strip()]
    names = [name.strip().strip('"') for name in lines[0].split(',')] if lines else []
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise DataError(
            f'{path}: column {", ".join(missing)} missing; expected {",".join(COLUMNS)}'
        )
    table = _numbers(path, lines[1:], [names.index(name) for name in COLUMNS], len(names))
    return _checked(path, table)


def _numbers(path: Path, lines: list[str], columns: list[int], width: int) -> Array:
    rows = []
    for number, line in enumerate(lines, start=2):
        cells = line.split(',')
        if len(cells) != width:
            raise DataError(f'{path}: row {number} has {len(cells)} values, the header {width}')
        try:
            rows.append([float(cells[c]) for c in columns])
        except ValueError:
            raise DataError(f'{path}: row {number} holds text where a number belongs') from None
    table = np.array(rows).reshape(-1, len(columns))
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise DataError(f'{path}: row {row + 2}, {COLUMNS[column]} is not finite; export it anew')
    return table


def _checked(path: Path, table: Array) -> DesignRide:
    if len(table) < 10:
        raise DataError(f'{path}: {len(table)} rows; a ride needs at least 10')
    late = np.flatnonzero(np.diff(table[:, 0]) <= 0.0)
    if len(late):
        raise DataError(f'{path}: time_s does not increase at row {late[0] + 3}; sort by time')
    norm = np.linalg.norm(table[:, 5:9], axis=1)
    bad = np.flatnonzero(np.abs(norm - 1.0) > 0.01)
    if len(bad):
        raise DataError(
            f'{path}: row {bad[0] + 2}: qx,qy,qz,qw has length {norm[bad[0]]:.3f}, not 1'
        )
    _check_force(path, table[:, 9:12], table[:, 12:15])
    return DesignRide(
        time_s=table[:, 0],
        chainage=table[:, 1],
        position=table[:, 2:5],
        quaternion=table[:, 5:9] / norm[:, None],
        velocity=table[:, 9:12],
        specific_force=table[:, 12:15],
        angular_rate=table[:, 15:18],
    )


def _check_force(path: Path, velocity: Array, force: Array) -> None:
    """Raise DataError for forces in g: 1 instead of 9.8 at rest, or all along without a rest."""
    standing = np.linalg.norm(velocity, axis=1) <= STANDING_MPS
    lengths = np.linalg.norm(force[standing] if standing.any() else force, axis=1)
    usual = float(np.median(lengths))
    if IN_G[0] < usual < IN_G[1]:
        where = 'where the ride stands' if standing.any() else 'along the ride'
        raise DataError(
            f'{path}: columns fx_mps2, fy_mps2, fz_mps2 are in g: their vector is {usual:.2f} long '
            f'{where}, not 9.8 m/s^2; multiply them by 9.80665'
        )

"""Trajectories as text in the TUM layout, which ``evo_traj tum`` reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """
    Write ``timestamp tx ty tz qx qy qz qw``, one line per epoch.

    Epochs with a NaN are left out. Without quaternions the identity is written.
    """
    quaternion = trajectory.quaternion
    if quaternion is None:
        quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (len(trajectory), 1))
    rows = np.column_stack([trajectory.time_s, trajectory.position, quaternion])
    rows = rows[np.isfinite(rows).all(axis=1)]
    with Path(path).open('w', encoding='utf-8') as file:
        file.write('# timestamp tx ty tz qx qy qz qw\n')
        for row in rows.tolist():
            file.write(f'{row[0]:.9f} ' + ' '.join(f'{v:.9f}' for v in row[1:]) + '\n')


def read_tum(path: str | Path) -> Trajectory:
    """Return a TUM file's poses; raise DataError with the line that cannot be read."""
    try:
        lines = Path(path).read_text(encoding='utf-8').splitlines()
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from None
    except UnicodeDecodeError:
        raise DataError(f'{path}: not a text file; give a TUM trajectory') from None
    rows = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith('#'):
            continue
        try:
            row = [float(cell) for cell in line.replace(',', ' ').split()]
        except ValueError:
            row = []
        if len(row) != 8 or not np.isfinite(row).all():
            raise DataError(f'{path}: line {number}: expected "timestamp tx ty tz qx qy qz qw"')
        rows.append(row)
    if not rows:
        raise DataError(f'{path}: no poses in it')
    values = np.array(rows)
    return Trajectory(values[:, 0], values[:, 1:4], values[:, 4:8])

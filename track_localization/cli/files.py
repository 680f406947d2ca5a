"""Files that every command line finds, makes and leaves behind alike."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.io.tables import write_trajectory
from track_localization.io.tum import write_tum


def beside(bag: Path, name: str) -> Path | None:
    """Return the file of that name in the bag's folder or the folder around it, else None."""
    folder = bag if bag.is_dir() else bag.parent
    for place in (folder, folder.resolve().parent):
        if (place / name).is_file():
            return place / name
    return None


def make_folder(folder: Path, option: str = '--output') -> Path:
    """Make the folder that ``option`` names; raise DataError where it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{option} {folder}: cannot be made ({error.strerror})') from None
    return folder


def make_file(path: Path) -> Path:
    """Make the file of ``--output`` where it is not; raise DataError if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open('a', encoding='utf-8').close()
    except OSError as error:
        raise DataError(f'--output {path}: cannot be made ({error.strerror})') from None
    return path


def write_metrics(folder: Path, content: Mapping[str, Any]) -> None:
    """Write metrics.json; NaN and infinity have no place in it."""
    text = json.dumps(content, indent=2, allow_nan=False)
    (folder / 'metrics.json').write_text(text + '\n', encoding='utf-8')


def write_trajectories(folder: Path, trajectories: Mapping[str, Trajectory]) -> None:
    """Write trajectory_<method>.csv and .tum of every method."""
    for name, trajectory in trajectories.items():
        write_trajectory(folder / f'trajectory_{name}.csv', trajectory)
        write_tum(folder / f'trajectory_{name}.tum', trajectory)

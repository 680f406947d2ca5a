"""
The Kingston drive: a car in a town with IMU, receiver, odometer and a reference, as text tables.

A folder with ``imu.csv``, ``gnss.csv``, ``odometer.csv`` and ``reference.csv``; times in seconds of
one clock. Heights of the receiver and of the reference are above different surfaces.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.io.tables import read_table

Array = NDArray[np.float64]

FOLDER = 'TRACK_LOCALIZATION_DATA'
"""Environment variable that names the folder of all real recordings."""
IMU_AGE_S = 0.05
"""
An IMU sample is the mean over the tenth of a second before its stamp, and so is as old [s].

On the first 1000 s the integrated yaw rate follows the reference's yaw 0.055 s late.
"""
FORCES, RATES = ('fx_mps2', 'fy_mps2', 'fz_mps2'), ('wx_radps', 'wy_radps', 'wz_radps')
PLACES = ('latitude_deg', 'longitude_deg', 'altitude_m')
SIGMAS = ('sigma_east_m', 'sigma_north_m', 'sigma_up_m')
VELOCITIES = ('v_east_mps', 'v_north_mps', 'v_up_mps')


@dataclasses.dataclass(frozen=True)
class Fixes:
    """
    The receiver's fixes.

    Attributes:
        time_s: (N,) [s].
        geodetic: (N, 3) latitude, longitude [rad], height [m].
        sigma: (N, 3) claimed, east, north, up [m].
    """

    time_s: Array
    geodetic: Array
    sigma: Array


@dataclasses.dataclass(frozen=True)
class Speeds:
    """The odometer's speeds [m/s] and stamps [s], (N,) each."""

    time_s: Array
    speed: Array


@dataclasses.dataclass(frozen=True)
class Reference:
    """
    What a better IMU and receiver found afterwards.

    Attributes:
        time_s: (N,) [s].
        geodetic: (N, 3) latitude, longitude [rad], height [m].
        velocity: (N, 3) east, north, up [m/s].
        yaw: (N,) of the car from east, anticlockwise, without jumps [rad].
    """

    time_s: Array
    geodetic: Array
    velocity: Array
    yaw: Array


@dataclasses.dataclass(frozen=True)
class Drive:
    """The recording; ``imu`` in x forward, y left, z up, stamped in the middle of its means."""

    imu: ImuSeries
    fixes: Fixes
    speeds: Speeds
    reference: Reference


def default_folder() -> Path:
    """Return where the drive is looked for: beside this repository, or as the environment says."""
    beside = Path(__file__).resolve().parents[3] / 'shared' / 'data'
    return Path(os.environ.get(FOLDER) or beside) / 'kingston'


def read_drive(folder: str | Path) -> Drive:
    """
    Read the drive.

    Raises:
        DataError: a file or a column is missing, a cell is no number, stamps do not increase, or
            a number cannot be what its column says; with the file, the field and the remedy.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(f'{folder}: no such folder; set {FOLDER} to the one that holds kingston/')
    imu = _read(folder / 'imu.csv', (*FORCES, *RATES))
    fixes = _read(folder / 'gnss.csv', (*PLACES, *SIGMAS))
    speeds = _read(folder / 'odometer.csv', ('speed_mps',))
    reference = _read(folder / 'reference.csv', (*PLACES, *VELOCITIES, 'azimuth_deg'))
    if min(fixes[c].min() for c in SIGMAS) <= 0.0:
        raise DataError(f'{folder / "gnss.csv"}: sigma_*_m must be positive; remove such rows')
    return Drive(
        ImuSeries(imu['time_s'] - IMU_AGE_S, _columns(imu, FORCES), _columns(imu, RATES)),
        Fixes(fixes['time_s'], _geodetic(fixes), _columns(fixes, SIGMAS)),
        Speeds(speeds['time_s'], speeds['speed_mps']),
        Reference(
            reference['time_s'],
            _geodetic(reference),
            _columns(reference, VELOCITIES),
            np.unwrap(np.radians(90.0 - reference['azimuth_deg'])),
        ),
    )


def _read(path: Path, columns: tuple[str, ...]) -> dict[str, Array]:
    """Return ``time_s`` and the columns of a file, checked."""
    numbers = read_table(path, ('time_s', *columns)).numbers
    back = np.flatnonzero(np.diff(numbers['time_s']) <= 0.0)
    if len(back):
        stamp = numbers['time_s'][back[0] + 1]
        raise DataError(f'{path}: time_s does not increase at {stamp:g} s; sort its rows')
    for name, limit in (('latitude_deg', 90.0), ('longitude_deg', 360.0)):
        if name in numbers and np.abs(numbers[name]).max() > limit:
            raise DataError(f'{path}: {name} is beyond {limit:g}; it must be in degrees')
    return numbers


def _columns(numbers: dict[str, Array], names: tuple[str, ...]) -> Array:
    return np.stack([numbers[name] for name in names], axis=1)


def _geodetic(numbers: dict[str, Array]) -> Array:
    latitude, longitude, height = (numbers[name] for name in PLACES)
    return np.stack([np.radians(latitude), np.radians(longitude), height], axis=1)

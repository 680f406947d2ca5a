"""What a live system is given at its start: the coaster's files, the mount, a start pose."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide, read_design_ride
from track_localization.track.line_table import LineTable
from track_localization.track.track_file import read_track

Array = NDArray[np.float64]

SAME_TRACK_M = 5.0
"""How far a seat may run off the line of its own track file (rail centre, heart line)."""

__all__ = [
    'check_track',
    'line_of',
    'mount_matrix',
    'quaternion_of',
    'read_design_ride',
    'rotation',
    'start_at_chainage',
    'warm_up_samples',
]


def line_of(ride: DesignRide) -> LineTable:
    """Return the seat's line along a design ride."""
    return LineTable(Centreline.from_design_ride(ride))


def mount_matrix(rpy_deg: tuple[float, float, float]) -> Array | None:
    """Return R_bm (3, 3), which turns the sensor's axes into the body's; None when they agree."""
    if not any(rpy_deg):
        return None
    return so3.matrix_from_rpy(*map(math.radians, rpy_deg))


def quaternion_of(R_nb: Array) -> Array:
    """Return the quaternion (4,) x, y, z, w of a rotation (3, 3)."""
    return so3.quat_from_matrix(R_nb)


def rotation(quaternion: Array) -> Array:
    """Return R_nb (3, 3) of a quaternion (4,) x, y, z, w."""
    return so3.matrix_from_quat(quaternion)


def check_track(path: str, ride: DesignRide) -> None:
    """
    Raise DataError when a track file cannot be read, or the design ride does not run along it.

    The estimators need the design ride only; its chainage counts along the track file.
    """
    line = Centreline.from_track(read_track(path))
    points = ride.position[:: max(1, len(ride) // 200)]
    off = float(np.median(np.linalg.norm(points - line.position(line.nearest(points)), axis=1)))
    if off > SAME_TRACK_M:
        raise DataError(
            f'{path}: the design ride runs {off:.0f} m off this line; name the files of one coaster'
        )


def warm_up_samples() -> Iterator[ImuSample]:
    """Yield three seconds of rest and two of shaking: what makes every part of a core compile."""
    rng = np.random.default_rng(0)
    for k in range(500):
        shake = rng.normal(0.0, 2.0, 3) * (k >= 300)
        force = np.array([0.0, 0.0, GRAVITY]) + shake
        yield ImuSample(0.01 * k, force, 0.1 * shake)


def start_at_chainage(
    line: LineTable, s: float, variance: float, cross_sigma: float
) -> tuple[Array, Array, Array]:
    """
    Return the position (3,), its covariance (3, 3) and R_nb (3, 3) of a place on the line.

    Args:
        line: the seat's line.
        s: chainage [m].
        variance: of the chainage [m^2].
        cross_sigma: how far the seat may be off the line, across [m].
    """
    i = line.index(s)
    axes = line.axes[i]
    along, across = variance * float(line.stretch[i]) ** 2, cross_sigma**2
    return line.point(s), axes @ np.diag([along, across, across]) @ axes.T, axes

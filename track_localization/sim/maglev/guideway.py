"""A guideway with gentle curves and slopes, by closed forms of its course and grade."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import so3
from track_localization.sim.maglev.config import Line
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

STEP_M = 1.0
ROW_SPACING_M = 5.0
CURVES = ((0.6, 1700.0, 0.4), (0.4, 730.0, 1.1))
"""Share of the greatest curvature, wavelength [m] and phase [rad] of two waves of curves."""

GRADE_LENGTH_M = 2300.0
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclasses.dataclass(frozen=True)
class Guideway:
    """
    The line in ``map``: it begins at the origin, chainage is its arc length.

    Attributes:
        length: [m].
        radius: of the tightest curve [m].
        grade: steepest slope.
    """

    length: float
    radius: float
    grade: float

    def direction(self, s: Array) -> Array:
        """Return the unit tangents (N, 3)."""
        course, slope = self._angles(s)
        level = np.cos(slope)
        return np.stack([level * np.cos(course), level * np.sin(course), np.sin(slope)], axis=-1)

    def attitude(self, s: Array) -> Array:
        """Return R_nb (N, 3, 3): a vehicle that looks along the line and does not lean."""
        course, _ = self._angles(s)
        front = self.direction(s)
        left = np.stack([-np.sin(course), np.cos(course), np.zeros_like(course)], axis=-1)
        return np.stack([front, left, np.cross(front, left)], axis=-1)

    def quaternion(self, s: Array) -> Array:
        """Return the attitude as quaternions (N, 4), x, y, z, w."""
        return so3.quat_from_matrix(self.attitude(s))

    def position(self, s: Array) -> Array:
        """Return points (N, 3) [m]: the direction, integrated."""
        count = int(np.ceil(self.length / STEP_M))
        grid = np.linspace(0.0, STEP_M * count, count + 1)
        at_grid = np.zeros((count + 1, 3))
        at_grid[1:] = np.cumsum(self._advance(grid[:-1], np.diff(grid)), axis=0)
        i = np.clip((s / STEP_M).astype(np.int64), 0, count)
        return at_grid[i] + self._advance(grid[i], s - grid[i])

    def track(self) -> TrackFile:
        """Return the line as a track file's rows, the last one at its very end."""
        count = max(round(self.length / ROW_SPACING_M), 8) + 1
        s = np.linspace(0.0, self.length, count)
        R = self.attitude(s)
        return TrackFile(self.position(s), R[:, :, 0], R[:, :, 1], R[:, :, 2])

    def _angles(self, s: Array) -> tuple[Array, Array]:
        """Return course and slope (N,) [rad]; the curvature is a sum of two waves."""
        course = np.zeros_like(s)
        for share, wave, phase in CURVES:
            k = 2.0 * np.pi / wave
            course += share / (self.radius * k) * (np.cos(phase) - np.cos(k * s + phase))
        return course, np.arctan(self.grade) * np.sin(2.0 * np.pi / GRADE_LENGTH_M * s)

    def _advance(self, begin: Array, length: Array) -> Array:
        """Return the way (N, 3) from chainages on over short lengths, by Gauss and Legendre."""
        s = begin + 0.5 * length * (1.0 + NODES[:, None])
        way: Array = 0.5 * length[:, None] * np.einsum('k,knc->nc', WEIGHTS, self.direction(s))
        return way


def guideway_of(line: Line) -> Guideway | None:
    """Return the line's guideway, or None where it is straight."""
    if line.curve_radius_m <= 0.0:
        return None
    return Guideway(line.length_m * line.sections, line.curve_radius_m, line.grade)

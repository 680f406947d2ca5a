"""A centreline sampled so densely that a filter can look it up at every IMU sample."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from track_localization.track.centreline import Centreline

Array = NDArray[np.float64]


class LineTable:
    """
    Position, axes and curvature of a line every ``step_m`` metres, linear in between.

    Attributes:
        position: (M, 3) [m].
        R_nb: (M, 3, 3), columns forward, left, up.
        curvature: (M, 3) turning of the axes per metre, in the axes themselves [rad/m].
    """

    def __init__(self, line: Centreline, step_m: float = 0.1) -> None:
        count = max(2, int(np.ceil(line.length / step_m)) + 1)
        s = np.linspace(0.0, line.length, count)
        self.length = float(line.length)
        self.closed = bool(line.closed)
        self.step_m = float(s[1] - s[0])
        self.position = np.ascontiguousarray(line.position(s))
        self.R_nb = np.ascontiguousarray(line.attitude(s))
        self.curvature = np.ascontiguousarray(line.curvature(s))
        self._tree = cKDTree(self.position)

    def index(self, s: float) -> int:
        """Return the row nearest to chainage ``s`` [m]; off the ends of an open line, the end."""
        i = round(s / self.step_m)
        last = len(self.position) - 1
        return int(i % last) if self.closed else int(min(max(i, 0), last))

    def point(self, s: float) -> Array:
        """Return the position (3,) at ``s``; an open line goes on straight beyond its ends."""
        i = self.index(s)
        ds = s - i * self.step_m
        if self.closed:
            ds -= self.length * round(ds / self.length)
        point: Array = self.position[i] + self.R_nb[i, :, 0] * ds
        return point

    def nearest(self, p: Array) -> float:
        """Return the chainage of the point nearest to ``p`` (3,) on the whole line [m]."""
        _, i = self._tree.query(p)
        return self.project(p, float(i) * self.step_m)

    def project(self, p: Array, near: float) -> float:
        """Return the chainage whose normal plane holds ``p`` (3,), found from ``near`` [m]."""
        return float(
            _project(self.position, self.R_nb, self.step_m, self.length, self.closed, p, near)
        )


@numba.njit(cache=True)
def _project(
    position: Array, R: Array, step: float, length: float, closed: bool, p: Array, near: float
) -> float:
    s = near
    last = len(position) - 1
    for _ in range(10):
        if closed:
            s -= length * np.floor(s / length)
        i = int(round(s / step))
        i = min(max(i, 0), last)
        along = 0.0
        for j in range(3):
            along += R[i, j, 0] * (p[j] - position[i, j])
        # From row i, not from s: the row's own chainage is exact.
        new = i * step + min(max(along, -2.0), 2.0)
        if not closed:
            new = min(max(new, 0.0), length)
        moved = abs(new - s)
        s = new
        if moved < 0.5 * step:
            break
    if closed:
        s -= length * np.floor(s / length)
    return s

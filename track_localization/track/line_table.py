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
    Points, axes and bend of a line every ``step_m`` metres of chainage, straight in between.

    A seat's path goes by the chainage of the track, and is longer than the track on a crest and
    shorter in a valley: ``stretch`` metres of path for a metre of chainage.

    Attributes:
        length: of the line in chainage [m].
        closed: whether the line is a circuit.
        step_m: between rows [m].
        position: (M, 3) [m].
        axes: (M, 3, 3), columns: along the path, left, up.
        stretch: (M,) metres of path for a metre of chainage.
        bend: (M,) curvature of the path [1/m].
    """

    def __init__(self, line: Centreline, step_m: float = 0.1) -> None:
        count = max(2, int(np.ceil(line.length / step_m)) + 1)
        s = np.linspace(0.0, line.length, count)
        self.length = float(line.length)
        self.closed = bool(line.closed)
        self.step_m = float(s[1] - s[0])
        self.position = np.ascontiguousarray(line.position(s))
        slope = np.gradient(self.position, self.step_m, axis=0)
        self.stretch = np.maximum(np.linalg.norm(slope, axis=1), 1e-3)
        tangent = slope / self.stretch[:, None]
        left = line.attitude(s)[:, :, 1]
        left = left - tangent * np.einsum('ni,ni->n', left, tangent)[:, None]
        left /= np.linalg.norm(left, axis=1, keepdims=True)
        self.axes = np.ascontiguousarray(
            np.stack([tangent, left, np.cross(tangent, left)], axis=-1)
        )
        turn = np.gradient(tangent, self.step_m, axis=0) / self.stretch[:, None]
        self.bend = np.linalg.norm(turn, axis=1)
        self._tree = cKDTree(self.position)

    def index(self, s: float) -> int:
        """Return the row nearest to chainage ``s`` [m]; off the ends of an open line, the end."""
        i = round(s / self.step_m)
        last = len(self.position) - 1
        return int(i % last) if self.closed else int(min(max(i, 0), last))

    def point(self, s: float) -> Array:
        """Return the position (3,) at ``s``; an open line goes on straight beyond its ends."""
        i = self.index(s)
        ds = self.difference(s, i * self.step_m)
        point: Array = self.position[i] + self.axes[i, :, 0] * (ds * self.stretch[i])
        return point

    def difference(self, a: float, b: float) -> float:
        """Return the chainage from ``b`` to ``a`` [m], the short way round on a closed line."""
        d = a - b
        if self.closed:
            d -= self.length * round(d / self.length)
        return d

    def nearest(self, p: Array) -> float:
        """Return the chainage of the point nearest to ``p`` (3,) on the whole line [m]."""
        _, i = self._tree.query(p)
        return self.project(p, float(i) * self.step_m)

    def project(self, p: Array, near: float) -> float:
        """Return the chainage whose normal plane holds ``p`` (3,), found from ``near`` [m]."""
        return float(
            project_one(
                self.position,
                self.axes,
                self.stretch,
                self.step_m,
                self.length,
                self.closed,
                p,
                near,
            )
        )

    def follow(self, points: Array, near: float) -> Array:
        """Return the chainages (N,) of points (N, 3), each found from the one before it."""
        s: Array = _follow(
            self.position,
            self.axes,
            self.stretch,
            self.step_m,
            self.length,
            self.closed,
            np.ascontiguousarray(points),
            near,
        )
        return s


@numba.njit(cache=True)
def _follow(
    position: Array,
    axes: Array,
    stretch: Array,
    step: float,
    length: float,
    closed: bool,
    points: Array,
    near: float,
) -> Array:
    out = np.empty(len(points))
    for k in range(len(points)):
        near = project_one(position, axes, stretch, step, length, closed, points[k], near)
        out[k] = near
    return out


@numba.njit(cache=True)
def project_one(
    position: Array,
    axes: Array,
    stretch: Array,
    step: float,
    length: float,
    closed: bool,
    p: Array,
    near: float,
) -> float:
    """Return what ``LineTable.project`` does, from the table's own columns."""
    s = near
    last = len(position) - 1
    for _ in range(10):
        if closed:
            s -= length * np.floor(s / length)
        i = min(max(int(np.rint(s / step)), 0), last)
        along = 0.0
        for j in range(3):
            along += axes[i, j, 0] * (p[j] - position[i, j])
        # Counted from row i, whose chainage is exact; a step is bounded where the line bends away.
        new = i * step + min(max(along / stretch[i], -2.0), 2.0)
        if not closed:
            new = min(max(new, 0.0), length)
        moved = abs(new - s)
        s = new
        if moved < 0.5 * step:
            break
    if closed:
        s -= length * np.floor(s / length)
    return s

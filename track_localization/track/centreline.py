"""The line that the vehicle rides on: chainage to position, attitude and curvature, and back."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.track.design_ride import DesignRide
from track_localization.track.rounding import without_rounding
from track_localization.track.track_file import TrackFile
from track_localization.track.uniform_spline import UniformSpline, evaluate

Array = NDArray[np.float64]

STEP = 0.25
"""Spacing of the look-up table [m]; coaster curvature varies over metres."""

CLOSING_GAP = 3.0
"""A circuit is closed when its ends are nearer than this [m], or two rows, and aligned."""


class Centreline:
    """
    A smooth line by chainage, with the vehicle's attitude along it.

    Attributes:
        length: one lap, or the whole of an open line [m].
        closed: the line is a circuit; every chainage is then taken modulo ``length``.

    All methods take chainages (...,) of any shape. Beyond the ends of an open line the line goes
    on straight.
    """

    def __init__(self, s: Array, position: Array, attitude: Array, closed: bool, length: float):
        """
        Fit the line; prefer ``from_track`` and ``from_design_ride``.

        Args:
            s: (N,) increasing chainage of the given points [m], from 0.
            position: (N, 3) in ``map`` [m].
            attitude: (N, 3, 3) forward, left and up axes in ``map`` as columns.
            closed: the last point leads on to the first.
            length: ``s`` where the line ends, or meets its first point again [m].
        """
        self.length, self.closed = float(length), closed
        quaternion = _continuous(so3.quat_from_matrix(attitude))
        if closed:
            s, position, quaternion = _wrap(s, position, quaternion, length)
        count = max(int(np.ceil(length / STEP)), 8) + 1
        grid = np.linspace(0.0, length, count)
        ends = np.array([0.0, length])
        self._position = _table(s, position, grid, ends, closed)
        self._quaternion = _table(s, quaternion, grid, ends, closed)
        self._tree: cKDTree | None = None

    @classmethod
    def from_track(cls, track: TrackFile) -> Centreline:
        """
        Fit a line through a track file; its ends are joined where it is a circuit.

        Chainage is the arc length from the first row. Files with few decimals are smoothed.
        """
        points, attitude = track.position, track.attitude
        spacing = np.linalg.norm(np.diff(points, axis=0), axis=1)
        gap = float(np.linalg.norm(points[-1] - points[0]))
        if gap < 1e-3 * float(np.median(spacing)) + 1e-6:
            points, attitude, spacing = points[:-1], attitude[:-1], spacing[:-1]
            gap = float(np.linalg.norm(points[-1] - points[0]))
        aligned = float(attitude[0, :, 0] @ attitude[-1, :, 0]) > 0.9
        closed = gap < max(CLOSING_GAP, 2.0 * float(np.median(spacing))) and aligned
        even = without_rounding(TrackFile(points, *np.moveaxis(attitude, 2, 0)), closed)
        points, attitude = even.position, even.attitude
        spacing = np.linalg.norm(np.diff(points, axis=0), axis=1)
        chord = np.concatenate([[0.0], np.cumsum(spacing)])
        s, length = _arc_length(chord, points, gap if closed else 0.0)
        return cls(s, points, attitude, closed, length)

    @classmethod
    def from_design_ride(cls, ride: DesignRide, spacing: float = 0.25) -> Centreline:
        """
        Make the line that the seat draws in the design ride, by the ride's own chainage.

        Only the longest stretch in the forward sense is used (a shuttle coaster runs its track
        several times), one lap of it. Raise DataError when the ride does not move.
        """
        first, last = _longest_advance(ride.chainage)
        s, index = np.unique(ride.chainage[first:last], return_index=True)
        if len(s) < 8 or s[-1] - s[0] < 10.0:
            raise DataError('design ride: it advances less than 10 m; is chainage_m filled in?')
        rows = index + first
        keep = _thin(s, spacing)
        s, rows = s[keep], rows[keep]
        attitude = so3.matrix_from_quat(ride.quaternion[rows])
        points = ride.position[rows]
        closed, length, last = _lap(s, points, attitude)
        if not closed:
            return _shifted(cls, s[0], s - s[0], points, attitude, length)
        return _one_lap(cls, s[:last], points[:last], attitude[:last], length)

    def position(self, s: float | Array) -> Array:
        """Return points (..., 3) in ``map`` [m]."""
        return self._position(s)

    def slope(self, s: float | Array, derivative: int = 1) -> Array:
        """Return the first or second ``derivative`` (..., 3) of the position by chainage."""
        return self._position(s, derivative)

    def tangent(self, s: float | Array) -> Array:
        """Return unit vectors (..., 3) along the line in ``map``."""
        slope = self._position(s, 1)
        return slope / np.linalg.norm(slope, axis=-1, keepdims=True)

    def attitude(self, s: float | Array) -> Array:
        """Return R_nb (..., 3, 3): forward, left and up in ``map`` as columns."""
        return so3.matrix_from_quat(_unit(self._quaternion(s)))

    def quaternion(self, s: float | Array) -> Array:
        """Return unit quaternions (..., 4) x, y, z, w, body to ``map``."""
        return _unit(self._quaternion(s))

    def curvature(self, s: float | Array) -> Array:
        """Return the turning of the attitude per metre (..., 3), in body axes [rad/m]."""
        return turning(self._quaternion(s), self._quaternion(s, 1))

    def nearest(
        self, p: Array, near: float | Array | None = None, window: float | None = None
    ) -> Array:
        """
        Return the chainage (...,) of the point of the line nearest to ``p`` (..., 3).

        Args:
            p: points in ``map`` [m].
            near: look only about this chainage [m]; needed where the line passes itself closely.
            window: half width of that search [m], by default 15.
        """
        points = np.ascontiguousarray(np.asarray(p, dtype=np.float64).reshape(-1, 3))
        grid = self._position.grid
        if near is None:
            if self._tree is None:
                self._tree = cKDTree(self._position(grid))
            start = np.asarray(grid[self._tree.query(points)[1]], dtype=np.float64)
            half = 2.0 * self._position.step
        else:
            start = np.broadcast_to(np.asarray(near, dtype=np.float64), np.shape(p)[:-1])
            start, half = (
                np.ascontiguousarray(start.reshape(-1)),
                15.0 if window is None else window,
            )
        spline = self._position
        found = _project(spline.coefficients, spline.step, self.closed, points, start, half)
        return found.reshape(np.shape(p)[:-1])


def turning(q: Array, slope: Array) -> Array:
    """
    Return the rotation vector rate (..., 3) in body axes of a quaternion path.

    ``q`` (..., 4) x, y, z, w need not be unit; ``slope`` is its derivative.
    """
    x, y, z, w = np.moveaxis(q, -1, 0)
    dx, dy, dz, dw = np.moveaxis(slope, -1, 0)
    vector = np.stack(
        [
            w * dx - x * dw - y * dz + z * dy,
            w * dy - y * dw - z * dx + x * dz,
            w * dz - z * dw - x * dy + y * dx,
        ],
        axis=-1,
    )
    return 2.0 * vector / np.sum(q * q, axis=-1, keepdims=True)


@njit(cache=True)
def _project(c: Array, step: float, closed: bool, p: Array, near: Array, half: float) -> Array:
    length = c.shape[0] * step
    out = np.empty(len(p))
    probes = int(np.ceil(2.0 * half / step)) + 1
    for j in range(len(p)):
        s = near[j] - half + 2.0 * half * np.arange(probes) / (probes - 1)
        if not closed:
            s = np.minimum(np.maximum(s, 0.0), length)
        line = evaluate(c, step, closed, s, 0)
        best, least = 0, np.inf
        for i in range(probes):
            d = (line[i, 0] - p[j, 0]) ** 2 + (line[i, 1] - p[j, 1]) ** 2
            d += (line[i, 2] - p[j, 2]) ** 2
            if d < least:
                best, least = i, d
        x = s[best : best + 1].copy()
        for _ in range(6):
            r = evaluate(c, step, closed, x, 0)[0] - p[j]
            t = evaluate(c, step, closed, x, 1)[0]
            bend = evaluate(c, step, closed, x, 2)[0]
            slope = max(np.dot(t, t) + np.dot(r, bend), 0.2)
            x[0] -= min(max(np.dot(r, t) / slope, -step), step)
        out[j] = x[0] - np.floor(x[0] / length) * length if closed else x[0]
    return out


def _unit(q: Array) -> Array:
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def _continuous(q: Array) -> Array:
    """Flip signs so that neighbouring quaternions lie on the same side."""
    flips = np.sign(np.sum(q[1:] * q[:-1], axis=1))
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips == 0.0, 1.0, flips))])
    return q * signs[:, None]


def _wrap(s: Array, position: Array, q: Array, length: float) -> tuple[Array, Array, Array]:
    """Append a stretch of the other end before and after, so that the join is smooth."""
    pad = min(12, len(s) - 1)
    sign = 1.0 if float(q[0] @ q[-1]) >= 0.0 else -1.0
    return (
        np.concatenate([s[-pad:] - length, s, s[:pad] + length]),
        np.concatenate([position[-pad:], position, position[:pad]]),
        np.concatenate([sign * q[-pad:], q, sign * q[:pad]]),
    )


def _table(s: Array, values: Array, grid: Array, ends: Array, closed: bool) -> UniformSpline:
    fit = CubicSpline(s, values)
    return UniformSpline(fit(grid), float(ends[1]), closed, fit(ends, 1))


def _arc_length(chord: Array, points: Array, gap: float) -> tuple[Array, float]:
    """Return arc lengths (N,) of the points and the total, by refining the chord lengths."""
    s = chord
    total = float(chord[-1] + gap)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    for _ in range(3):
        knots, values = s, points
        if gap > 0.0:
            knots = np.concatenate([s[-8:] - total, s, s[:8] + total])
            values = np.concatenate([points[-8:], points, points[:8]])
        fit = CubicSpline(knots, values)
        edges = np.concatenate([s, [total]]) if gap > 0.0 else s
        half, middle = np.diff(edges) / 2.0, (edges[1:] + edges[:-1]) / 2.0
        speed = np.linalg.norm(fit(middle[:, None] + half[:, None] * nodes, 1), axis=2)
        arc = np.concatenate([[0.0], np.cumsum(speed @ weights * half)])
        s, total = (arc[:-1], float(arc[-1])) if gap > 0.0 else (arc, float(arc[-1]))
    return s, total


def _longest_advance(chainage: Array) -> tuple[int, int]:
    """Return the index range of the longest stretch that never runs back (0.1 mm tolerated)."""
    back = np.flatnonzero(np.diff(chainage) < -1e-4) + 1
    edges = np.concatenate([[0], back, [len(chainage)]])
    gains = [chainage[b - 1] - chainage[a] for a, b in pairwise(edges)]
    i = int(np.argmax(gains))
    return int(edges[i]), int(edges[i + 1])


def _thin(s: Array, spacing: float) -> NDArray[np.int64]:
    """Return indices of points at least ``spacing`` apart."""
    bins = np.floor((s - s[0]) / spacing)
    keep: NDArray[np.int64] = np.unique(bins, return_index=True)[1].astype(np.int64)
    return keep


def _lap(s: Array, points: Array, attitude: Array) -> tuple[bool, float, int]:
    """Return whether the points come round, the lap [m], and how many points make one lap."""
    far = s - s[0] > 30.0
    ahead = (points - points[0]) @ attitude[0, :, 0]
    near = np.linalg.norm(points - points[0], axis=1) < CLOSING_GAP
    aligned = attitude[:, :, 0] @ attitude[0, :, 0] > 0.9
    hits = np.flatnonzero(far & near & aligned)
    if len(hits) == 0:
        return False, float(s[-1] - s[0]), len(s)
    i = int(hits[np.argmin(np.abs(ahead[hits]))])
    length = float(s[i] - ahead[i] - s[0])
    return True, length, int(np.searchsorted(s, s[0] + length - 0.05))


def _one_lap(
    cls: type[Centreline], s: Array, points: Array, attitude: Array, length: float
) -> Centreline:
    """Turn one lap that began anywhere so that it starts at chainage 0."""
    order = np.argsort(s % length)
    s, points, attitude = s[order] % length, points[order], attitude[order]
    return cls(s, points, attitude, True, length)


def _shifted(
    cls: type[Centreline], start: float, s: Array, points: Array, attitude: Array, length: float
) -> Centreline:
    """Give an open line that was ridden from ``start`` on its straight run-up from 0."""
    if start <= 0.0:
        return cls(s, points, attitude, False, length)
    lead = points[0] - start * attitude[0, :, 0]
    return cls(
        np.concatenate([[0.0], s + start]),
        np.concatenate([lead[None], points]),
        np.concatenate([attitude[:1], attitude]),
        False,
        length + start,
    )

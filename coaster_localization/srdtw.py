"""
Segment-recombination dynamic time warping (paper 1, section 1.2, eqs 5-14).

Two series are cut into segments; a dynamic program over the cut points joins one to four
neighbouring segments of either side into groups and pairs the groups. The distance of a pair is
the end value of a DTW inside it, whose point distances grow with the distance from the group's
shortest path, its diagonal.

The program is exact but not exhaustive: solved first at about 10 Hz, its sequence of groups gives
at the full rate a cost that the optimum cannot exceed, and cut points beyond it are left out.
"""

from __future__ import annotations

import dataclasses
import math

import numba
import numpy as np
from numpy.typing import NDArray

from coaster_localization import kernels
from coaster_localization.dtw import checked_series, compact
from track_localization.errors import DataError

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
IntArray = NDArray[np.int64]

MODES = np.array([(1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 4), (4, 2)])
"""The seven recombinations: segments of ``a``, segments of ``b`` (eqs 5-11)."""

COARSE_HZ = 10.0
NEAR = 0.08
"""Share of the ride that two cut points may be apart where a first bound is sought."""
SLACK = 1e-4
"""Relative rounding error allowed for in the bound, single precision against itself."""


@dataclasses.dataclass(frozen=True)
class GlobalPenalty:
    """
    The weight kg of a point pair (eq. 14), which the paper gives as 1.05, without its form.

    ``power``: kg = value^d, d the distance from the group's diagonal in samples at ``per_hz``.
    ``linear``: kg = 1 + value d, d the difference of the two relative positions in the group.
    """

    form: str = 'power'
    value: float = 1.05
    per_hz: float = 50.0

    def kernel(self, rate_hz: float) -> tuple[int, float]:
        """Return the kernels' kind and growth at a sampling rate; DataError if kg would fall."""
        if self.form == 'linear' and self.value >= 0.0:
            return kernels.LINEAR, self.value
        if self.form == 'power' and self.value >= 1.0:
            return kernels.POWER, math.log(self.value) * self.per_hz / rate_hz
        raise DataError(f'global penalty {self.form} {self.value}: must not fall with distance')


@dataclasses.dataclass(frozen=True)
class SegmentAlignment:
    """
    The optimal sequence of groups and the point path through it.

    Attributes:
        path: (L, 2) int, pairs (i, j), as in ``dtw.Alignment``.
        corners: (K, 2) int, limits of the groups as sample indices (i, j), first (0, 0), last
            (m, n).
        cost: sum of the groups' distances (eq. 13).
    """

    path: IntArray
    corners: IntArray
    cost: float


def align_segments(
    a: Array,
    b: Array,
    cuts_a: IntArray,
    cuts_b: IntArray,
    rate_hz: float,
    penalty: GlobalPenalty,
    step_penalty: float = 0.0,
    prune: bool = True,
) -> SegmentAlignment | None:
    """
    Return the optimum over all recombinations of ``a`` (m, C) and ``b`` (n, C), or None.

    ``cuts_a`` (P+1,) and ``cuts_b`` (Q+1,) limit the segments, from 0 to m and n. ``step_penalty``
    is added for each step inside a group that is not diagonal (the paper has none). None says that
    no sequence of the seven recombinations uses up P and Q segments. ``prune=False`` visits every
    cut point; the answer is the same. Raise DataError for empty or non-finite series.
    """
    a, b = checked_series(a, b)
    kind, growth = penalty.kernel(rate_hz)
    usable = _usable(np.ones((len(cuts_a), len(cuts_b)), dtype=bool), MODES)
    if not usable[0, 0]:
        return None
    forward, backward, scale = compact(a, b)
    skip = np.float32(step_penalty / scale**2)
    bound, step = np.inf, round(rate_hz / COARSE_HZ)
    if prune and step > 1:
        bound = _bound(forward, backward, cuts_a, cuts_b, usable, skip, kind, growth, step)
    H, mode = _recombine(
        forward, backward, cuts_a, cuts_b, MODES, usable, skip, kind, growth, bound
    )
    corners = _corners(mode, cuts_a, cuts_b)
    path = _join(forward, backward, corners, skip, kind, growth)
    return SegmentAlignment(path, corners, float(H[-1, -1]) * scale**2)


def _bound(
    forward: Array32,
    backward: Array32,
    cuts_a: IntArray,
    cuts_b: IntArray,
    usable: NDArray[np.bool_],
    skip: np.float32,
    kind: int,
    growth: float,
    step: int,
) -> float:
    """
    Return what the groups chosen at a ``step`` times lower rate cost at the full one.

    They need not be the best, so only corners near the diagonal are tried if that gets through.
    """
    thin_a = np.ascontiguousarray(forward[:, ::step])
    thin_b = np.ascontiguousarray(backward[:, ::-1][:, ::step][:, ::-1])
    thin_cuts_a, thin_cuts_b = -(-cuts_a // step), -(-cuts_b // step)
    if np.diff(thin_cuts_a).min() < 1 or np.diff(thin_cuts_b).min() < 1:
        return np.inf
    places = np.subtract.outer(cuts_a / cuts_a[-1], cuts_b / cuts_b[-1])
    near = _usable(np.abs(places) < NEAR, MODES)
    if near[0, 0]:
        usable = near
    faster = growth * step if kind == kernels.POWER else growth
    _, mode = _recombine(
        thin_a, thin_b, thin_cuts_a, thin_cuts_b, MODES, usable, skip, kind, faster, np.inf
    )
    cost = _cost_of(forward, backward, _corners(mode, cuts_a, cuts_b), skip, kind, growth)
    return float(cost * (1.0 + SLACK))


@numba.njit(cache=True)
def _usable(allowed: NDArray[np.bool_], modes: IntArray) -> NDArray[np.bool_]:
    """Return (P+1, Q+1): whether the last corner can be reached from each, by allowed ones."""
    P, Q = allowed.shape[0] - 1, allowed.shape[1] - 1
    usable = np.zeros((P + 1, Q + 1), np.bool_)
    usable[P, Q] = True
    for i in range(P - 1, -1, -1):
        for j in range(Q - 1, -1, -1):
            for p, q in modes:
                if i + p <= P and j + q <= Q and usable[i + p, j + q]:
                    usable[i, j] = allowed[i, j]
    return usable


@numba.njit(cache=True)
def _recombine(
    a: Array32,
    b_reversed: Array32,
    cuts_a: IntArray,
    cuts_b: IntArray,
    modes: IntArray,
    usable: NDArray[np.bool_],
    skip: np.float32,
    kind: int,
    growth: float,
    bound: float,
) -> tuple[Array, IntArray]:
    """
    Return H (P+1, Q+1) (eqs 12-13) and the index of the mode by which each corner was reached.

    Corners whose H exceeds ``bound`` lead nowhere: what follows can only add to it.
    """
    P, Q = len(cuts_a) - 1, len(cuts_b) - 1
    rows = np.empty((4, a.shape[1] + 2), np.float32)
    weights = np.empty((2, a.shape[1] + b_reversed.shape[1]), np.float32)
    H = np.full((P + 1, Q + 1), np.inf)
    mode = np.full((P + 1, Q + 1), -1)
    H[0, 0] = 0.0
    for i in range(P):
        for j in range(Q):
            if not (H[i, j] <= bound and H[i, j] < np.inf):
                continue
            for k in range(len(modes)):
                p, q = i + modes[k, 0], j + modes[k, 1]
                if p > P or q > Q or not usable[p, q]:
                    continue
                block = (cuts_a[i], cuts_a[p], cuts_b[j], cuts_b[q])
                distance = kernels.end_cost(a, b_reversed, block, skip, kind, growth, rows, weights)
                if H[i, j] + distance < H[p, q]:
                    H[p, q] = H[i, j] + distance
                    mode[p, q] = k
    return H, mode


def _corners(mode: IntArray, cuts_a: IntArray, cuts_b: IntArray) -> IntArray:
    """Walk back from the last corner; return the groups' limits (K, 2) in samples, forward."""
    i, j = mode.shape[0] - 1, mode.shape[1] - 1
    corners = [(cuts_a[i], cuts_b[j])]
    while i > 0:
        p, q = MODES[mode[i, j]]
        i, j = i - p, j - q
        corners.append((cuts_a[i], cuts_b[j]))
    return np.array(corners[::-1], dtype=np.int64)


def _cost_of(
    a: Array32,
    b_reversed: Array32,
    corners: IntArray,
    skip: np.float32,
    kind: int,
    growth: float,
) -> float:
    """Return the sum of the distances of given groups."""
    rows = np.empty((4, a.shape[1] + 2), np.float32)
    weights = np.empty((2, a.shape[1] + b_reversed.shape[1]), np.float32)
    total = 0.0
    for (i0, j0), (i1, j1) in zip(corners[:-1].tolist(), corners[1:].tolist(), strict=True):
        total += kernels.end_cost(
            a, b_reversed, (i0, i1, j0, j1), skip, kind, growth, rows, weights
        )
    return total


def _join(
    a: Array32,
    b_reversed: Array32,
    corners: IntArray,
    skip: np.float32,
    kind: int,
    growth: float,
) -> IntArray:
    """Return the point paths inside the groups, joined (the paper's Fig. 5)."""
    stay = np.full(a.shape[1], skip, dtype=np.float32)
    parts = []
    for (i0, j0), (i1, j1) in zip(corners[:-1].tolist(), corners[1:].tolist(), strict=True):
        _, packed, starts = kernels.sweep(
            a, b_reversed, (i0, i1, j0, j1), stay, skip, False, kind, growth
        )
        part = kernels.trace(packed, starts, i1 - i0, j1 - j0, j1 - j0 - 1)
        parts.append(part + np.array([i0, j0]))
    return np.concatenate(parts)

"""
Compiled loops of the warping algorithms: one anti-diagonal at a time.

Cells on one anti-diagonal do not depend on each other, so vector instructions compute them:
series ``a`` runs forward along it and ``b``, stored reversed, too, both contiguous in memory. Cell
(i, j) of a block is known by ``i`` and its diagonal ``d = i + j``. All of it is single precision.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
IntArray = NDArray[np.int64]
Bytes = NDArray[np.uint8]

DIAGONAL, STEP_A, STEP_B, START = 0, 1, 2, 3
"""Where a cell came from: (i-1, j-1), (i-1, j), (i, j-1), nowhere."""

FLAT, POWER, LINEAR = 0, 1, 2
"""How the global penalty kg (eq. 14) grows with the distance from the block's diagonal."""

LARGEST_EXPONENT = 80.0
"""Of e, in single precision; kg of blocks so long that it would be passed grows more slowly."""

NO_NAN = {'nnan', 'nsz', 'contract'}


@numba.njit(cache=True)
def sweep(
    a: Array32,
    b_reversed: Array32,
    block: tuple[int, int, int, int],
    stay: Array32,
    skip: np.float32,
    open_begin: bool,
    kind: int,
    growth: float,
) -> tuple[Array32, Bytes, IntArray]:
    """
    Warp one block: rows ``i0..i1`` of ``a`` (C, M) onto ``j0..j1`` of ``b`` (C, N), reversed.

    ``block`` is (i0, i1, j0, j1). Steps of ``a`` alone into row i cost ``stay[i0 + i]`` more,
    steps of ``b`` alone ``skip``. Return the costs of the last row (n,), the packed directions and
    the offsets of their diagonals.
    """
    i0, m, j0, n = block[0], block[1] - block[0], block[2], block[3] - block[2]
    starts = diagonal_starts(m, n)
    packed = np.empty(starts[m + n - 1], np.uint8)
    infinity = np.float32(np.inf)
    last_row = np.empty(n, np.float32)
    rows = np.full((3, m + 2), infinity)
    before, last, now = rows[0], rows[1], rows[2]
    cost, came_from = np.empty(m, np.float32), np.zeros(m + 8, np.uint8)
    weights = np.empty((2, m + n), np.float32)
    set_weights(weights, kind, growth, m, n)
    shift = b_reversed.shape[1] - 1 - j0
    for d in range(m + n - 1):
        lo, hi = max(0, d - n + 1), min(d, m - 1)
        point_cost(a, b_reversed, cost, i0, shift - d, lo, hi)
        weigh(cost, weights, kind, m + n - 1 - d, lo, hi)
        if d > 0:
            advance(cost, before, last, now, came_from, stay, i0, skip, lo, hi)
        if d == 0 or (open_begin and lo == 0):
            now[1] = cost[0]
            came_from[0] = START
        now[lo] = infinity
        now[min(hi + 2, m + 1)] = infinity
        pack(came_from, lo, hi, packed, starts[d])
        if hi == m - 1:
            last_row[d - m + 1] = now[m]
        before, last, now = last, now, before
    return last_row, packed, starts


@numba.njit(cache=True)
def end_cost(
    a: Array32,
    b_reversed: Array32,
    block: tuple[int, int, int, int],
    skip: np.float32,
    kind: int,
    growth: float,
    rows: Array32,
    weights: Array32,
) -> float:
    """
    Return the cost at the last cell of a block, ``dist(A, B)`` of section 1.1, closed ends.

    ``rows`` (4, M + 2) and ``weights`` (2, M + N) are scratch.
    """
    i0, m, j0, n = block[0], block[1] - block[0], block[2], block[3] - block[2]
    infinity = np.float32(np.inf)
    before, last, now, cost = rows[0], rows[1], rows[2], rows[3]
    set_weights(weights, kind, growth, m, n)
    shift = b_reversed.shape[1] - 1 - j0
    before[:2], last[:2], now[:2] = infinity, infinity, infinity
    for d in range(m + n - 1):
        lo, hi = max(0, d - n + 1), min(d, m - 1)
        point_cost(a, b_reversed, cost, i0, shift - d, lo, hi)
        weigh(cost, weights, kind, m + n - 1 - d, lo, hi)
        if d > 0:
            advance_cost(cost, before, last, now, skip, lo, hi)
        else:
            now[1] = cost[0]
        now[lo] = infinity
        now[min(hi + 2, m + 1)] = infinity
        before, last, now = last, now, before
    return last[m]


@numba.njit(cache=True)
def diagonal_starts(m: int, n: int) -> IntArray:
    """Return (m + n,) byte offsets of the anti-diagonals of an m x n block, and their end."""
    starts = np.empty(m + n, np.int64)
    total = 0
    for d in range(m + n - 1):
        starts[d] = total
        total += (min(d, m - 1) - max(0, d - n + 1) + 4) // 4
    starts[m + n - 1] = total
    return starts


@numba.njit(cache=True)
def set_weights(weights: Array32, kind: int, growth: float, m: int, n: int) -> None:
    """
    Write what ``weigh`` needs for an m x n block: the part of i at [:, :m], of j, reversed, after.

    POWER: kg = exp(growth * d), d = distance of (i, j) from the line between the corners, in
    samples. As exp(x_i - y_j) it is a product, so no exponential is taken per cell. LINEAR: kg =
    1 + growth * |i / (m - 1) - j / (n - 1)|.
    """
    if kind == POWER:
        length = max(np.hypot(m - 1.0, n - 1.0), 1.0)
        along_a, along_b = growth * (n - 1) / length, growth * (m - 1) / length
        middle = 0.5 * along_a * (m - 1)
        slower = min(1.0, LARGEST_EXPONENT / max(middle, 1.0))
        for i in range(m):
            weights[0, i] = np.exp(slower * (along_a * i - middle))
            weights[1, i] = np.float32(1.0) / weights[0, i]
        for j in range(n):
            weights[0, m + n - 1 - j] = np.exp(slower * (middle - along_b * j))
            weights[1, m + n - 1 - j] = np.float32(1.0) / weights[0, m + n - 1 - j]
    elif kind == LINEAR:
        for i in range(m):
            weights[0, i] = growth * i / max(m - 1, 1)
        for j in range(n):
            weights[0, m + n - 1 - j] = growth * j / max(n - 1, 1)


@numba.njit(cache=True, fastmath=NO_NAN)
def point_cost(
    a: Array32, b_reversed: Array32, cost: Array32, i0: int, shift: int, lo: int, hi: int
) -> None:
    """Write the squared distances of cells ``lo..hi`` of one anti-diagonal."""
    first, stop = np.uint64(lo), np.uint64(hi + 1)
    at_a, at_b = np.uint64(i0), np.uint64(shift)
    row_a, row_b = a[0], b_reversed[0]
    for i in range(first, stop):
        e = row_a[i + at_a] - row_b[i + at_b]
        cost[i] = e * e
    for c in range(1, a.shape[0]):
        row_a, row_b = a[c], b_reversed[c]
        for i in range(first, stop):
            e = row_a[i + at_a] - row_b[i + at_b]
            cost[i] += e * e


@numba.njit(cache=True, fastmath=NO_NAN)
def weigh(cost: Array32, weights: Array32, kind: int, shift: int, lo: int, hi: int) -> None:
    """Multiply cells ``lo..hi`` of one anti-diagonal by kg (eq. 14)."""
    first, stop, move = np.uint64(lo), np.uint64(hi + 1), np.uint64(shift)
    grow, shrink = weights[0], weights[1]
    if kind == POWER:
        for i in range(first, stop):
            cost[i] *= max(grow[i] * grow[i + move], shrink[i] * shrink[i + move])
    elif kind == LINEAR:
        for i in range(first, stop):
            cost[i] *= np.float32(1.0) + abs(grow[i] - grow[i + move])


@numba.njit(cache=True, fastmath=NO_NAN)
def advance(
    cost: Array32,
    before: Array32,
    last: Array32,
    now: Array32,
    came_from: Bytes,
    stay: Array32,
    i0: int,
    skip: np.float32,
    lo: int,
    hi: int,
) -> None:
    """
    Fill cells ``lo..hi`` of one anti-diagonal from the two before it (eq. 2).

    Cell ``i`` lies at index ``i + 1`` of ``before``, ``last`` and ``now``.
    """
    one, at_a = np.uint64(1), np.uint64(i0)
    for i in range(np.uint64(lo), np.uint64(hi + 1)):
        from_a = last[i] + stay[i + at_a]
        from_b = last[i + one] + skip
        best = min(from_a, from_b)
        k = np.uint8(STEP_A) if from_a <= from_b else np.uint8(STEP_B)
        came_from[i] = np.uint8(DIAGONAL) if before[i] <= best else k
        now[i + one] = cost[i] + min(best, before[i])


@numba.njit(cache=True, fastmath=NO_NAN)
def advance_cost(
    cost: Array32,
    before: Array32,
    last: Array32,
    now: Array32,
    skip: np.float32,
    lo: int,
    hi: int,
) -> None:
    """Do what ``advance`` does, with ``stay`` equal to ``skip`` and without the directions."""
    one = np.uint64(1)
    for i in range(np.uint64(lo), np.uint64(hi + 1)):
        now[i + one] = cost[i] + min(min(last[i], last[i + one]) + skip, before[i])


@numba.njit(cache=True)
def pack(came_from: Bytes, lo: int, hi: int, packed: Bytes, start: int) -> None:
    """Store the directions of cells ``lo..hi``: byte k holds cells k, k + q, k + 2q, k + 3q."""
    quarter = np.uint64((hi - lo + 4) // 4)
    first, out = np.uint64(lo), np.uint64(start)
    for k in range(quarter):
        i = first + k
        packed[out + k] = (
            came_from[i]
            | (came_from[i + quarter] << 2)
            | (came_from[i + quarter + quarter] << 4)
            | (came_from[i + quarter + quarter + quarter] << 6)
        )


@numba.njit(cache=True)
def trace(packed: Bytes, starts: IntArray, m: int, n: int, end: int) -> IntArray:
    """Walk back from (m - 1, end) to the start (eqs 3-4); return the path (L, 2) forward."""
    path = np.empty((m + n, 2), np.int64)
    i, j, k = m - 1, end, m + n
    while True:
        k -= 1
        path[k, 0], path[k, 1] = i, j
        d = i + j
        lo, hi = max(0, d - n + 1), min(d, m - 1)
        quarter = (hi - lo + 4) // 4
        part, place = divmod(i - lo, quarter)
        step = (packed[starts[d] + place] >> np.uint8(2 * part)) & 3
        if step == START:
            return path[k:].copy()
        if step != STEP_B:
            i -= 1
        if step != STEP_A:
            j -= 1

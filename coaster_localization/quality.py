"""
How sure a match is: the spread of all ways to match, weighted by how well they explain the data.

The ride so far is a hidden Markov chain over the design's samples (stay, advance one or two);
forward and backward recursions give each measured sample's distribution over places. Where the
track looks alike over tens of metres (a straight lift) the distribution is wide; where two places
look alike it has two peaks, however sharp the match itself is. Its second moment *about the match*
is the variance, so a match that disagrees with the distribution is not trusted either.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


NOISE = 1.0
"""Variance of a row's distance, large enough to stand for errors that last a second."""
OFF_PACE = 0.15
"""Probability that the train stays where the design moves one row on; of two rows, likewise."""


def match_spread(
    a: Array,
    b: Array,
    matched: Array,
    chainage: Array,
    held: NDArray[np.bool_],
    far_m: float,
    open_ends: tuple[bool, bool] = (False, False),
) -> tuple[Array, Array]:
    """
    Return the rms distance from the match [m], (m,), and the probability of more than ``far_m``.

    ``a`` (m, C) and ``b`` (n, C) are the series compared, ``matched`` (m,) the chainages that the
    match gave, ``chainage`` (n,) of the design, ``held`` (m,) where the train stood still.
    """
    return _spread(
        np.ascontiguousarray(a),
        np.ascontiguousarray(b),
        matched,
        chainage,
        held,
        NOISE,
        OFF_PACE,
        far_m,
        open_ends[0],
        open_ends[1],
    )


@numba.njit(cache=True)
def _emission(a: Array, b: Array, i: int, noise: float, out: Array) -> None:
    least = np.inf
    for j in range(b.shape[0]):
        h = 0.0
        for c in range(b.shape[1]):
            e = a[i, c] - b[j, c]
            h += e * e
        out[j] = h
        least = min(least, h)
    for j in range(b.shape[0]):
        out[j] = np.exp(-0.5 * (out[j] - least) / noise) + 1e-30


@numba.njit(cache=True)
def _normalise(row: Array) -> None:
    total = row.sum()
    for j in range(len(row)):
        row[j] /= total


@numba.njit(cache=True)
def _spread(
    a: Array,
    b: Array,
    matched: Array,
    chainage: Array,
    held: NDArray[np.bool_],
    noise: float,
    off_pace: float,
    far_m: float,
    open_begin: bool,
    open_end: bool,
) -> tuple[Array, Array]:
    m, n = a.shape[0], b.shape[0]
    like = np.empty((m, n))
    for i in range(m):
        _emission(a, b, i, noise, like[i])
    forward = np.zeros((m, n))
    if open_begin:
        forward[0] = like[0]
    else:
        for j in range(n):
            forward[0, j] = like[0, j] * np.exp(-float(j))
    _normalise(forward[0])
    for i in range(1, m):
        stay, skip = (0.9, 0.0) if held[i] else (off_pace, off_pace)
        go = 1.0 - stay - skip
        for j in range(n):
            p = forward[i - 1, j] * stay
            if j > 0:
                p += forward[i - 1, j - 1] * go
            if j > 1:
                p += forward[i - 1, j - 2] * skip
            forward[i, j] = p * like[i, j] + 1e-200
        _normalise(forward[i])
    spread, doubt = np.empty(m), np.empty(m)
    after, later = np.ones(n), np.empty(n)
    if not open_end:
        for j in range(n):
            after[j] = np.exp(-float(n - 1 - j))
    for i in range(m - 1, -1, -1):
        total = second = far = 0.0
        for j in range(n):
            p = forward[i, j] * after[j]
            e = chainage[j] - matched[i]
            total += p
            second += p * e * e
            far += p if abs(e) > far_m else 0.0
        spread[i], doubt[i] = np.sqrt(second / total), far / total
        stay, skip = (0.9, 0.0) if held[i] else (off_pace, off_pace)
        go = 1.0 - stay - skip
        for j in range(n):
            p = after[j] * like[i, j] * stay
            if j + 1 < n:
                p += after[j + 1] * like[i, j + 1] * go
            if j + 2 < n:
                p += after[j + 2] * like[i, j + 2] * skip
            later[j] = p + 1e-200
        _normalise(later)
        after, later = later, after
    return spread, doubt

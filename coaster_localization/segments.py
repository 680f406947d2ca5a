"""Cutting a series at its extrema into segments (paper 1, section 1.2, step 1)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


def cut_points(series: Array, threshold: float, flat: float = 0.0) -> IntArray:
    """
    Return the segments' limits: 0, the turning points of ``series`` (N,), N.

    Segment k is ``series[cuts[k]:cuts[k + 1]]``. A turning point is an extremum from which the
    series moves away by more than ``threshold`` before it passes it again (hysteresis), so every
    two neighbours are a maximum and a minimum that differ by more than ``threshold``. It is cut in
    the middle of what lies within ``flat`` of it: on a plateau the extremum itself is an accident
    of the noise. A series without extrema, a constant one above all, is one segment.
    """
    values = np.ascontiguousarray(series, dtype=float)
    turns = _centred(values, _turning_points(values, float(threshold)), float(flat))
    inner = turns[(turns > 0) & (turns < len(series))]
    return np.concatenate([[0], inner, [len(series)]]).astype(np.int64)


def matched_cut_points(
    measured: Array, design: Array, prominence: float, flat: float = 0.0, ratio: float = 1.2
) -> tuple[IntArray, IntArray]:
    """
    Cut both series (N,) and (M,); thresholds are ``prominence`` times the design's deviation.

    Both are cut in the middle of what lies within ``flat`` thresholds of an extremum.
    Noise makes extrema that the design does not have: while the measured series has more than
    ``ratio`` times as many segments, its own threshold is raised, to at most four times.
    """
    threshold = prominence * float(np.std(design))
    cuts_b = cut_points(design, threshold, flat * threshold)
    for factor in np.geomspace(1.0, 4.0, 9):
        cuts_a = cut_points(measured, factor * threshold, flat * threshold)
        if len(cuts_a) - 1 <= max(1.0, ratio * (len(cuts_b) - 1)):
            break
    return cuts_a, cuts_b


@numba.njit(cache=True)
def _turning_points(x: Array, threshold: float) -> IntArray:
    out = np.empty(len(x), np.int64)
    count, direction = 0, 0
    high_first = high_last = low_first = low_last = 0
    for k in range(len(x)):
        if x[k] > x[high_first]:
            high_first, high_last = k, k
        elif x[k] == x[high_first] and k == high_last + 1:
            high_last = k
        if x[k] < x[low_first]:
            low_first, low_last = k, k
        elif x[k] == x[low_first] and k == low_last + 1:
            low_last = k
        if direction >= 0 and x[high_first] - x[k] > threshold:
            out[count] = (high_first + high_last) // 2
            count += 1
            direction, low_first, low_last = -1, k, k
            high_first, high_last = k, k
        elif direction <= 0 and x[k] - x[low_first] > threshold:
            out[count] = (low_first + low_last) // 2
            count += 1
            direction, high_first, high_last = 1, k, k
            low_first, low_last = k, k
    return out[:count].copy()


@numba.njit(cache=True)
def _centred(x: Array, turns: IntArray, flat: float) -> IntArray:
    """Move every turning point to the middle of the stretch within ``flat`` of its value."""
    out = turns.copy()
    for k in range(len(turns)):
        first = turns[k - 1] + 1 if k else 0
        last = turns[k + 1] - 1 if k + 1 < len(turns) else len(x) - 1
        low = high = turns[k]
        while low > first and abs(x[low - 1] - x[turns[k]]) <= flat:
            low -= 1
        while high < last and abs(x[high + 1] - x[turns[k]]) <= flat:
            high += 1
        if flat > 0.0 and high > low:
            out[k] = (low + high) // 2
    return out

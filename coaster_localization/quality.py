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

from coaster_localization import dtw
from coaster_localization.channels import Grid
from coaster_localization.config import MatcherConfig
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


SPREAD_HZ = 10.0
NOISE = 1.0
OFF_PACE = 0.05
FLOOR_M = 0.05
FLOOR_S = 0.005


def sigma_along(
    series: tuple[Array, Array],
    design_time_s: Array,
    matched: DesignRide,
    measured: Grid,
    planned: Grid,
    design: DesignRide,
    ends: tuple[bool, bool],
    config: MatcherConfig,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the standard deviation along the track (N,) [m], and where it may be far wrong."""
    step = max(1, round(config.rate_hz / SPREAD_HZ))
    a, b = (dtw.with_derivative(x, config.rate_hz, config.derivative_weight) for x in series)
    chainage = np.interp(planned.time_s, design.time_s, design.chainage)
    spread, doubt = match_spread(
        a[::step],
        b[::step],
        matched.chainage[::step],
        chainage[::step],
        measured.held[::step],
        NOISE,
        OFF_PACE,
        config.doubt_m,
        ends,
    )
    t = measured.time_s
    spread, doubt = (np.interp(t, t[::step], x) for x in (spread, doubt))
    floor = FLOOR_M**2 + (FLOOR_S * matched.speed) ** 2
    return np.sqrt(spread**2 + floor), doubt > 0.05


def match_spread(
    a: Array,
    b: Array,
    matched: Array,
    chainage: Array,
    held: NDArray[np.bool_],
    noise: float,
    off_pace: float,
    far_m: float,
    open_ends: tuple[bool, bool] = (False, False),
) -> tuple[Array, Array]:
    """
    Return the rms distance from the match [m], (m,), and the probability of more than ``far_m``.

    ``a`` (m, C) and ``b`` (n, C) are the series compared, ``matched`` (m,) the chainages that the
    match gave, ``chainage`` (n,) of the design. ``noise`` is the variance of a row's distance,
    made large enough to stand for errors that last; ``off_pace`` the probability of staying and of
    advancing two, each.
    """
    return _spread(
        np.ascontiguousarray(a),
        np.ascontiguousarray(b),
        matched,
        chainage,
        held,
        noise,
        off_pace,
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
        stay = 0.9 if held[i] else off_pace
        go = 1.0 - stay - off_pace
        for j in range(n):
            p = forward[i - 1, j] * stay
            if j > 0:
                p += forward[i - 1, j - 1] * go
            if j > 1:
                p += forward[i - 1, j - 2] * off_pace
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
        stay = 0.9 if held[i] else off_pace
        go = 1.0 - stay - off_pace
        for j in range(n):
            p = after[j] * like[i, j] * stay
            if j + 1 < n:
                p += after[j + 1] * like[i, j + 1] * go
            if j + 2 < n:
                p += after[j + 2] * like[i, j + 2] * off_pace
            later[j] = p + 1e-200
        _normalise(later)
        after, later = later, after
    return spread, doubt

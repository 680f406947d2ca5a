"""Marked places: four distinctive features of the track, four points at each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from track_localization.errors import DataError
from track_localization.sim.coaster.dynamics import Run
from track_localization.track.centreline import Centreline
from track_localization.track.markers import Markers

Array = NDArray[np.float64]

PLACES = 4
POINTS = (-4.5, -1.5, 1.5, 4.5)
SLOWEST = 7.0
STEP = 0.5


def places(line: Centreline, run: Run) -> Array:
    """
    Return the chainages (16,) of row 1 at the marked points, increasing [m].

    The places are where the line turns or rolls hardest, apart from each other by a ninth of the
    track at least, and passed faster than 7 m/s. Raise DataError when there are not enough.
    """
    grid = np.arange(0.0, line.length, STEP)
    turning = gaussian_filter1d(np.linalg.norm(line.curvature(grid), axis=1), 5.0 / STEP)
    fast = np.zeros(len(grid), dtype=bool)
    at = np.clip((run.s[np.abs(run.v) > SLOWEST] / STEP).astype(np.int64), 0, len(grid) - 1)
    fast[at] = True
    turning = np.where(fast, turning, -1.0)
    edge = int(12.0 / STEP)
    turning[:edge] = turning[-edge:] = -1.0
    apart = line.length / 9.0
    found: list[float] = []
    for _ in range(PLACES):
        best = int(np.argmax(turning))
        if turning[best] < 0.0:
            raise DataError(
                f'track: only {len(found)} places passed faster than {SLOWEST} m/s, '
                f'{apart:.0f} m apart, for markers; the ride is too short'
            )
        found.append(float(grid[best]))
        turning[np.abs(grid - grid[best]) < apart] = -1.0
    return np.sort(np.add.outer(np.array(found), np.array(POINTS)).reshape(-1))


def passing_times(run: Run, marks: Array) -> Array:
    """Return when row 1 first passes each of ``marks`` (K,), in the run's time [s]."""
    furthest = np.maximum.accumulate(run.s)
    first = np.searchsorted(furthest, marks)
    if np.any(first == 0) or np.any(first == len(run.s)):
        raise DataError('track: a marked place is not passed by this ride')
    s0, s1 = run.s[first - 1], run.s[first]
    step = run.time_s[1] - run.time_s[0]
    return np.asarray(run.time_s[first - 1] + step * (marks - s0) / (s1 - s0))


def markers(time_s: Array, position: Array) -> Markers:
    """Name the points A1 ... D4 in the order of the track."""
    per = len(POINTS)
    names = tuple(f'{chr(ord("A") + i // per)}{i % per + 1}' for i in range(len(time_s)))
    return Markers(time_s, names, position)

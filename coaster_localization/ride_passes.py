"""A smoothed ride cut into passes: stretches run in one direction within one lap."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_rides import FilteredRide
from coaster_localization.track_smoothing import smooth_epochs
from track_localization.track.line_map import STRETCH, LineMap

Array = NDArray[np.float64]

TURN_BACK_M = 2.0
"""A train that comes back by less than this has not turned round."""
SHORTEST_M = 5.0
"""A pass shorter than this tells nothing: the end of a lap's chainage in the station."""


@dataclasses.dataclass(frozen=True)
class SmoothedRide:
    """
    What the whole recording tells of every epoch of the track filter.

    Attributes:
        time_s: (N,) stamps [s].
        x: (N, 30) nominal states of the line filter.
        P: (N, 18, 18) their error covariances.
        line: the line.
    """

    time_s: Array
    x: Array
    P: Array
    line: LineMap

    @classmethod
    def of(cls, ride: FilteredRide) -> SmoothedRide:
        """Smooth a filtered ride."""
        x, P = smooth_epochs(ride.epochs)
        return cls(np.array([e.time_s for e in ride.epochs]), x, P, ride.line)

    @property
    def chainage(self) -> Array:
        """Chainage (N,) [m]; laps go on counting."""
        return np.asarray(self.x[:, 0])

    @property
    def speed(self) -> Array:
        """Speed along the path (N,), negative backward [m/s]."""
        s = self.chainage % self.line.length if self.line.closed else self.chainage
        stretch = np.interp(s, self.line.chainage, self.line.rows[:, STRETCH])
        return np.asarray(self.x[:, 1] * stretch)


@dataclasses.dataclass(frozen=True)
class Pass:
    """
    One run over the line, or a part of it, in one direction.

    Attributes:
        rows: indices (K,) of the epochs at which the train made way, in the order of time.
        chainage: (K,) within the lap [m], strictly increasing, or decreasing where backward.
        forward: the direction.
    """

    rows: NDArray[np.int64]
    chainage: Array
    forward: bool

    def on(self, grid: Array, values: Array) -> Array:
        """Return ``values`` (N, ...) of the ride at ``grid`` (M,); NaN where it did not pass."""
        order = slice(None) if self.forward else slice(None, None, -1)
        s, v = self.chainage[order], values[self.rows][order]
        flat = v.reshape(len(v), -1)
        columns = [np.interp(grid, s, c, left=np.nan, right=np.nan) for c in flat.T]
        return np.stack(columns, axis=-1).reshape((len(grid), *values.shape[1:]))


def split_passes(chainage: Array, line: LineMap) -> list[Pass]:
    """Cut a ride of unwrapped ``chainage`` (N,) into its passes, in the order of time."""
    found: list[Pass] = []
    turns = _turning_points(chainage)
    for first, last in itertools.pairwise(turns):
        forward = bool(chainage[last] >= chainage[first])
        rows = np.arange(first, last + 1)
        sign = 1.0 if forward else -1.0
        # Where the train stood or rolled back a little, only what went on counts.
        furthest = np.maximum.accumulate(sign * chainage[rows])
        went_on = np.concatenate([[True], np.diff(furthest) > 1e-4])
        rows = rows[went_on]
        lap = np.floor(chainage[rows] / line.length) if line.closed else np.zeros(len(rows))
        for number in np.unique(lap)[:: 1 if forward else -1]:
            part = rows[lap == number]
            s = chainage[part] - number * line.length
            if len(part) > 1 and abs(s[-1] - s[0]) >= SHORTEST_M:
                found.append(Pass(part, s, forward))
    return found


def _turning_points(chainage: Array) -> list[int]:
    """Return the indices at which the ride begins, turns round, and ends."""
    turns, extreme, direction = [0], 0, 0.0
    for i, s in enumerate(chainage.tolist()):
        ahead = s - float(chainage[extreme])
        if direction == 0.0:
            if abs(ahead) >= TURN_BACK_M:
                direction, extreme = float(np.sign(ahead)), i
        elif direction * ahead >= 0.0:
            extreme = i
        elif -direction * ahead >= TURN_BACK_M:
            turns.append(extreme)
            direction, extreme = -direction, i
    return [*turns, len(chainage) - 1]

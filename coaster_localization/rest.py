"""Standing still, told sample by sample, and what it teaches about the sensor."""

from __future__ import annotations

import math
from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from coaster_localization.sensed import LEVEL_AS_IN_STATION
from coaster_localization.ticks import FORCE, RATE, SHAKE, WIDTH
from track_localization.estimation.strapdown import REST_FORCE_STD, REST_RATE_STD

Array = NDArray[np.float64]

LEARNT_S = 20.0
SHAKE_FLOOR = np.array([1e-4, 1e-6])
SLOWLY = 0.02
"""Largest share of one row in the yardstick of shaking, after the first rest."""
LARGEST_BIAS = 0.05
"""A mean rate [rad/s] above which the sensor turns, whatever its noise."""
STEADY_MPS2 = 0.05
"""A rest's mean force changes by less over seconds."""
GAINED_MPS, LITTLE_MPS, TELLS_S = 1.0, 0.5, 20.0
"""
What the force has added up to since a rest tells for so long that the train moves, or that it has
hardly moved.
"""
SMOOTH_S = 1.0
"""A train that moves so long without shaking tells nothing by not shaking."""


class RestWatch:
    """
    Finds the first rest by absolute limits, later ones by comparison with it.

    A train that rolls on smoothly feels like one that stands. What it was pushed by as it left
    tells the two apart for some seconds, and so whether this train shakes at all as it rolls.

    Attributes:
        known: whether there was a rest at all.
        held_s: how long the sensor has stood still, to the latest row.
        smooth: whether the train was seen to roll without shaking, so that later rests are none.
    """

    def __init__(
        self, rate_hz: float, elsewhere: Callable[[Array], bool] = lambda _: False
    ) -> None:
        """
        Expect rows of a Ticker at ``rate_hz``.

        ``elsewhere`` tells of a mean force (3,) whether a rest that shows it is none.
        """
        self._elsewhere = elsewhere
        self._step = 1.0 / rate_hz
        # The latest rows, the newest last; of the first ``_missing`` nothing is known yet.
        self._recent = np.zeros((max(8, round(rate_hz)), WIDTH))
        self._missing = len(self._recent)
        self._short = max(4, round(0.6 * rate_hz))
        self.known = False
        self.held_s = 0.0
        self.smooth = False
        self._gained, self._left_s, self._rolled_s = np.zeros(3), 0.0, 0.0
        self._mean = np.zeros(WIDTH)
        self._learnt = 0
        self._learns_shake_slowly = False

    @property
    def gravity(self) -> Array:
        """Mean specific force (3,) of the latest rest in the sensor's axes [m/s^2]."""
        return self._mean[FORCE]

    @property
    def gyro_bias(self) -> Array:
        """Mean rate (3,) of the latest rest in the sensor's axes [rad/s]."""
        return self._mean[RATE]

    def push(self, row: Array) -> bool:
        """Take a row; return whether the sensor stands still."""
        oldest = self._recent[0].copy()
        self._recent[:-1] = self._recent[1:]
        self._recent[-1] = row
        self._missing = max(self._missing - 1, 0)
        quiet = self._as_quiet_as_before() if self.known else self._quiet()
        moves = self.known and self._moves(row, quiet)
        if moves or not quiet:
            self.held_s, self._learnt = 0.0, 0
            return False
        if not self.known:
            self.known = True
            self._learn(self._recent.mean(axis=0), len(self._recent))
        elif self.held_s > len(self._recent) * self._step:
            self._learn(oldest, 1)
        self.held_s += self._step
        return True

    def arrived(self) -> None:
        """Note that the train is back in the station: whether it is smooth is found out anew."""
        self.smooth, self._left_s = False, math.inf

    def _moves(self, row: Array, quiet: bool) -> bool:
        """Tell whether the train, seen at rest before, is pushed, or has gained speed since."""
        mean = self._mean[FORCE]
        self._gained += self._step * (row[FORCE] - mean)
        self._left_s += self._step
        off = float(np.linalg.norm(self._recent[-self._short :, FORCE].mean(axis=0) - mean))
        gained = float(np.linalg.norm(self._gained))
        tells = self._left_s < TELLS_S
        if quiet and off < STEADY_MPS2 and (gained < LITTLE_MPS or not tells):
            self._gained, self._left_s, self._rolled_s = np.zeros(3), 0.0, 0.0
            return False
        pushed, gone = off > 2.0 * STEADY_MPS2, gained > GAINED_MPS
        if tells and gone and quiet and not pushed:
            self._rolled_s += self._step
            self.smooth |= self._rolled_s > SMOOTH_S
        return tells and (gone or pushed)

    def _learn(self, mean: Array, count: int) -> None:
        """Average over the rest so far, LEARNT_S at most; its latest second is not yet in it."""
        self._learnt = min(self._learnt + count, round(LEARNT_S / self._step))
        share = np.full(WIDTH, count / self._learnt)
        if self._learns_shake_slowly:
            share[SHAKE] = np.minimum(share[SHAKE], SLOWLY)
        self._learns_shake_slowly = True
        self._mean = self._mean + share * (mean - self._mean)

    def _quiet(self) -> bool:
        if self._missing:
            return False
        rows = self._recent
        return bool(
            (rows[:, FORCE].std(axis=0) < REST_FORCE_STD).all()
            and (rows[:, RATE].std(axis=0) < REST_RATE_STD).all()
            and np.linalg.norm(rows[:, RATE].mean(axis=0)) < LARGEST_BIAS
            and not self._elsewhere(rows[:, FORCE].mean(axis=0))
        )

    def _as_quiet_as_before(self) -> bool:
        return bool(_as_quiet(self._recent[-self._short :], self._mean))


@numba.njit(cache=True)
def _as_quiet(rows: Array, rest: Array) -> np.bool_:
    """Tell whether the mean of rows (N, WIDTH) shakes and stands like a mean row at rest."""
    mean = rows.sum(axis=0) / len(rows)
    force, gravity = mean[FORCE], rest[FORCE]
    lengths = np.sqrt((force**2).sum() * (gravity**2).sum())
    level = (force * gravity).sum() > LEVEL_AS_IN_STATION * lengths
    return np.bool_(level) & np.all(mean[SHAKE] < 1.5 * rest[SHAKE] + SHAKE_FLOOR)

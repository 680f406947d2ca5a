"""Standing still, told sample by sample, and what it teaches about the sensor."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from coaster_localization.sensed import LEVEL_AS_IN_STATION
from coaster_localization.ticks import FORCE, RATE, SHAKE
from track_localization.estimation.strapdown import REST_FORCE_STD, REST_RATE_STD

Array = NDArray[np.float64]

LEARNT_S = 20.0
LARGEST_BIAS = 0.05
"""A mean rate [rad/s] above which the sensor turns, whatever its noise."""


class RestWatch:
    """
    Finds the first rest by absolute limits, later ones by comparison with it.

    Attributes:
        gravity: (3,) mean specific force of the latest rest in the sensor's axes; None before.
        gyro_bias: (3,) mean rate of it.
        held_s: how long the sensor has stood still, to the latest row.
    """

    def __init__(self, rate_hz: float) -> None:
        """Expect rows of a Ticker, turned back into the sensor's axes, at ``rate_hz``."""
        self._step = 1.0 / rate_hz
        self._recent: deque[Array] = deque(maxlen=max(8, round(rate_hz)))
        self._short = max(4, round(0.4 * rate_hz))
        self.gravity: Array | None = None
        self.gyro_bias = np.zeros(3)
        self.held_s = 0.0
        self._learnt = 0
        self._shake: Array | None = None

    def push(self, row: Array) -> bool:
        """Take a row; return whether the sensor stands still."""
        oldest = self._recent[0] if len(self._recent) == self._recent.maxlen else None
        self._recent.append(row)
        still = self._quiet() if self._shake is None else self._as_quiet_as_before()
        if not still:
            self.held_s = 0.0
            self._learnt = 0
            return False
        self.held_s += self._step
        if self._learnt == 0:
            rows = np.array(self._recent)[: -self._short] if self._shake is not None else None
            rows = np.array(self._recent) if rows is None else rows
            if self._shake is None or self.held_s > 1.0:
                self._learn(rows.mean(axis=0), len(rows))
        elif oldest is not None:
            self._learn(oldest, 1)
        return True

    def _learn(self, mean: Array, count: int) -> None:
        """Average over the rest so far, at most LEARNT_S; the latest second is not in it yet."""
        limit = round(LEARNT_S / self._step)
        self._learnt = min(self._learnt + count, limit)
        share = min(1.0, count / self._learnt)
        if self._learnt == count or self.gravity is None or self._shake is None:
            self.gravity, self.gyro_bias = mean[FORCE].copy(), mean[RATE].copy()
            self._shake = mean[SHAKE] if self._shake is None else self._shake
            return
        self.gravity = self.gravity + share * (mean[FORCE] - self.gravity)
        self.gyro_bias = self.gyro_bias + share * (mean[RATE] - self.gyro_bias)
        self._shake = self._shake + share * (mean[SHAKE] - self._shake)

    def _quiet(self) -> bool:
        if len(self._recent) < (self._recent.maxlen or 0):
            return False
        rows = np.array(self._recent)
        return bool(
            (rows[:, FORCE].std(axis=0) < REST_FORCE_STD).all()
            and (rows[:, RATE].std(axis=0) < REST_RATE_STD).all()
            and np.linalg.norm(rows[:, RATE].mean(axis=0)) < LARGEST_BIAS
        )

    def _as_quiet_as_before(self) -> bool:
        rows = np.array(self._recent)[-self._short :]
        mean = rows.mean(axis=0)
        assert self._shake is not None and self.gravity is not None
        limit = 2.25 * self._shake + np.array([1e-4, 1e-6])
        cosine = mean[FORCE] @ self.gravity
        lengths = np.linalg.norm(mean[FORCE]) * np.linalg.norm(self.gravity)
        return bool((mean[SHAKE] < limit).all() and cosine > LEVEL_AS_IN_STATION * lengths)

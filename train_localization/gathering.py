"""Bringing the sensors together: IMU samples in stretches, fixes with their quality."""

from __future__ import annotations

import heapq
import math
from collections import deque

import numpy as np

from track_localization.estimation.imu import ImuSample
from train_localization.config import GnssConfig
from train_localization.measurements import GnssFix, GnssQuality, WheelSpeed
from train_localization.state import Fix, Stretch

SAME_S = 0.05
"""A fix and a quality whose stamps differ less belong together [s]."""
PATIENCE_S = 0.5
"""So long a fix waits for its quality, where one was ever heard [s]."""


class Gathering:
    """
    Holds what must wait for something else.

    Odometer speeds and fixes wait until the IMU has reached their stamps, so that the samples
    before them can be taken first; a fix waits for its quality, if qualities are told at all.
    """

    def __init__(self, config: GnssConfig, epoch_s: float, ahead_s: float = 0.0) -> None:
        """
        Make it.

        Args:
            config: of the fixes.
            epoch_s: time between stretches [s].
            ahead_s: how far the odometer's stamps are before its speeds' times [s].
        """
        self._config, self._epoch_s, self._ahead_s = config, epoch_s, ahead_s
        self._samples: list[ImuSample] = []
        self._waiting: list[tuple[float, int, GnssFix | WheelSpeed]] = []
        self._count = 0
        self._qualities: deque[GnssQuality] = deque(maxlen=20)
        self._begin_s = math.nan

    def imu(self, sample: ImuSample) -> None:
        """Take an IMU sample."""
        if math.isnan(self._begin_s):
            self._begin_s = sample.time_s
        self._samples.append(sample)

    def quality(self, quality: GnssQuality) -> None:
        """Take a quality."""
        self._qualities.append(quality)

    def wait(self, measurement: GnssFix | WheelSpeed) -> None:
        """Take a fix or a speed."""
        if isinstance(measurement, WheelSpeed) and self._ahead_s:
            measurement = measurement._replace(time_s=measurement.time_s + self._ahead_s)
        self._count += 1
        heapq.heappush(self._waiting, (measurement.time_s, self._count, measurement))

    def due(self) -> list[Stretch | Fix | WheelSpeed]:
        """Return what can be taken now, in order."""
        out: list[Stretch | Fix | WheelSpeed] = []
        while self._waiting and self._samples_reach(self._waiting[0][0]):
            time_s, _, measurement = self._waiting[0]
            heard: Fix | WheelSpeed | None
            heard = self._judged(measurement) if isinstance(measurement, GnssFix) else measurement
            if heard is None:
                break
            heapq.heappop(self._waiting)
            stretch = self._stretch(time_s)
            out += [heard] if stretch is None else [stretch, heard]
        if self._samples and self._samples[-1].time_s >= self._begin_s + self._epoch_s - 1e-6:
            held = self._waiting[0][0] if self._waiting else math.inf
            stretch = self._stretch(min(self._samples[-1].time_s, held))
            out += [] if stretch is None else [stretch]
        return out

    def _samples_reach(self, time_s: float) -> bool:
        newest = self._samples[-1].time_s if self._samples else self._begin_s
        return newest >= time_s

    def _stretch(self, until_s: float) -> Stretch | None:
        """Return the samples up to a stamp, and forget them; None without any."""
        n = len(self._samples)
        while n and self._samples[n - 1].time_s > until_s:
            n -= 1
        if n == 0:
            return None
        taken, self._samples = self._samples[:n], self._samples[n:]
        self._begin_s = taken[-1].time_s
        return Stretch(
            taken[-1].time_s,
            np.array([s.time_s for s in taken]),
            np.array([s.angular_rate for s in taken]),
            np.array([s.specific_force for s in taken]),
        )

    def _judged(self, fix: GnssFix) -> Fix | None:
        """Return a fix with how many axes are good; None while its quality may still come."""
        quality = next(
            (q for q in reversed(self._qualities) if abs(q.time_s - fix.time_s) < SAME_S), None
        )
        if quality is None:
            newest = self._samples[-1].time_s if self._samples else self._begin_s
            if self._qualities and newest - fix.time_s < PATIENCE_S:
                return None
            return Fix(fix.time_s, self._believed(fix, 1.0), 3)
        return Fix(fix.time_s, self._believed(fix, quality.hdop), self.axes(quality))

    def axes(self, quality: GnssQuality) -> int:
        """Return how many axes of a fix are good; the paper's switch (section 1.1)."""
        high = quality.hdop > self._config.hdop_limit
        if high or quality.satellites < 3:
            return 0
        return 3 if quality.satellites > 3 else 2

    def _believed(self, fix: GnssFix, hdop: float) -> GnssFix:
        """Return the fix with a covariance, where none was told."""
        if np.isfinite(fix.covariance).all() and np.diag(fix.covariance).min() > 0.0:
            return fix
        sigma = self._config.untold_sigma_m * (max(hdop, 1.0) if math.isfinite(hdop) else 1.0)
        return fix._replace(covariance=np.eye(3) * sigma**2)

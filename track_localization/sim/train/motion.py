"""How the train runs: speeds joined by changes along Bloss's curve, exact at any time."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.train import bloss
from track_localization.sim.train.config import Running

Array = NDArray[np.float64]

REST_S = 20.0
"""Standstill at the end of a run from station to station [s]."""

SLOWER = 0.98
"""Where a leg is too short for its speeds, the greatest is lessened in such steps."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """
    Speeds between times, end to end: from one to the next along 3x^2 - 2x^3.

    Attributes:
        time_s: (K,) increasing, from 0 [s].
        speed: (K,) [m/s].
        way: (K,) covered until then [m].
    """

    time_s: Array
    speed: Array
    way: Array

    @property
    def duration_s(self) -> float:
        """How long the train is watched [s]."""
        return float(self.time_s[-1])

    @property
    def distance_m(self) -> float:
        """How far it runs [m]."""
        return float(self.way[-1])

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """
        Return way [m], speed [m/s] and acceleration [m/s^2] at times (N,).

        Before the first and after the last time its speed stays as it is.
        """
        k = np.clip(np.searchsorted(self.time_s, time_s, 'right') - 1, 0, len(self.time_s) - 2)
        span, change = np.diff(self.time_s)[k], np.diff(self.speed)[k]
        t = time_s - self.time_s[k]
        x = t / span
        way = self.way[k] + self.speed[k] * t + change * span * bloss.area(x)
        return way, self.speed[k] + change * bloss.value(x), change / span * bloss.slope(x)

    def passing_times(self, way: Array) -> Array:
        """Return when the train has covered a way (M,) [s]; NaN for what it never does."""
        low, high = np.zeros_like(way), np.full_like(way, self.duration_s)
        for _ in range(60):
            middle = 0.5 * (low + high)
            short = self.at(middle)[0] < way
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return np.asarray(np.where((way >= 0.0) & (way <= self.distance_m), high, np.nan))


def plan_motion(rng: Generator, config: Running) -> Motion:
    """Return the motion of one run."""
    if config.profile == 'underway':
        return _underway(rng, config)
    time, speed = [0.0, config.stand_s], [0.0, 0.0]
    for leg in range(config.legs):
        length = float(rng.uniform(*config.leg_m))
        first, second = rng.uniform(*config.speed_mps, 2).tolist()
        share, dwell = float(rng.uniform(0.3, 0.7)), float(rng.uniform(*config.dwell_s))
        dwell = REST_S if leg == config.legs - 1 else dwell
        for span, then in _leg(config, length, first, second, share):
            time.append(time[-1] + span)
            speed.append(then)
        time.append(time[-1] + dwell)
        speed.append(0.0)
    return _joined(np.array(time), np.array(speed))


def _underway(rng: Generator, config: Running) -> Motion:
    """Return a run that covers its distance in just its duration."""
    phases = max(round(config.duration_s / config.phase_s), 1)
    time = np.linspace(0.0, config.duration_s, phases + 1)
    speed = 1.0 + config.variation * rng.uniform(-1.0, 1.0, phases + 1)
    motion = _joined(time, speed)
    return _joined(time, speed * config.distance_m / motion.distance_m)


def _leg(
    config: Running, length: float, first: float, second: float, share: float
) -> list[tuple[float, float]]:
    """Return (span [s], speed at its end) from rest to rest, with a change of speed between."""
    speeds = np.array([0.0, first, second, 0.0])
    while _ramps(config, speeds)[1] > length:
        speeds = np.minimum(speeds, SLOWER * speeds.max())
    spans, way = _ramps(config, speeds)
    cruise = (length - way) * np.array([share, 1.0 - share]) / speeds[1:3]
    span = np.stack([spans, [*cruise, 0.0]], axis=1).ravel().tolist()
    then = np.repeat(speeds[1:], 2).tolist()
    return [part for part in zip(span, then, strict=True) if part[0] > 0.0]


def _ramps(config: Running, speeds: Array) -> tuple[Array, float]:
    """Return how long the changes (3,) between speeds (4,) take [s], and their way [m]."""
    change = np.diff(speeds)
    most = np.where(change > 0.0, config.acceleration_mps2, config.braking_mps2)
    size = np.abs(change)
    span = np.maximum(
        bloss.STEEPEST * size / most, np.sqrt(bloss.SHARPEST * size / config.jerk_mps3)
    )
    return span, float(0.5 * span @ (speeds[1:] + speeds[:-1]))


def _joined(time: Array, speed: Array) -> Motion:
    keep = np.concatenate([[True], np.diff(time) > 0.0])
    time, speed = time[keep], speed[keep]
    way = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (speed[1:] + speed[:-1]))])
    return Motion(time, speed, way)

"""How the simulated train truly moves: stretches of constant jerk, exact at any time."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.sim.maglev.config import Line, MotionErrors

Array = NDArray[np.float64]

STEP_S = 1.0
"""The accelerating train draws its jerk anew after this time: the paper's sample period [s]."""

SENSE = np.array([0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
"""Of the jerk, in a standstill and the seven stretches of a leg."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """
    Stretches of constant jerk, end to end.

    Attributes:
        time_s: (K + 1,) where the stretches begin, and the end, from 0 on [s].
        s, v, a: (K + 1,) chainage [m], speed [m/s] and acceleration [m/s^2] there.
        jerk: (K,) [m/s^3].
    """

    time_s: Array
    s: Array
    v: Array
    a: Array
    jerk: Array

    @property
    def duration_s(self) -> float:
        """How long the train is watched [s]."""
        return float(self.time_s[-1])

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Return chainage [m], speed [m/s] and acceleration [m/s^2] at times (N,)."""
        k = np.clip(np.searchsorted(self.time_s, time_s, 'right') - 1, 0, len(self.jerk) - 1)
        h, j, a = time_s - self.time_s[k], self.jerk[k], self.a[k]
        s = self.s[k] + h * (self.v[k] + h * (a / 2.0 + h * j / 6.0))
        return s, self.v[k] + h * (a + h * j / 2.0), a + h * j

    def passing_times(self, chainage: Array) -> Array:
        """Return when the train first reaches places (M,) [s]; NaN for those it does not pass."""
        k = np.clip(np.searchsorted(self.s, chainage, 'left') - 1, 0, len(self.jerk) - 1)
        low, high = self.time_s[k], self.time_s[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            short = self.at(middle)[0] < chainage
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        passed = (chainage > self.s[0]) & (chainage <= self.s[-1])
        return np.asarray(np.where(passed, high, np.nan))

    def cut(self, time_s: float) -> Motion:
        """Return the motion from a time on, which becomes its time 0."""
        s, v, a = self.at(np.array([time_s]))
        k = int(np.searchsorted(self.time_s, time_s, 'right'))
        return Motion(
            np.concatenate([[0.0], self.time_s[k:] - time_s]),
            np.concatenate([s, self.s[k:]]),
            np.concatenate([v, self.v[k:]]),
            np.concatenate([a, self.a[k:]]),
            self.jerk[k - 1 :],
        )


def plan_motion(rng: Generator, line: Line, config: MotionErrors) -> Motion:
    """Return the motion of one run; raise DataError when the settings contradict each other."""
    if config.profile == 'accelerating':
        return _accelerating(rng, config)
    stops = stops_of(line)
    low, high = config.start_chainage_m
    if high >= stops[-1] or low < stops[0]:
        raise DataError(
            f'setting motion.start_chainage_m: [{low}, {high}] m; give places from the first '
            f'stop at {stops[0]} m to before the last at {stops[-1]} m'
        )
    start = float(rng.uniform(low, high))
    before = stops[stops <= start]
    if start in before or not config.start_moving:
        return _between(rng, np.concatenate([[start], stops[stops > start]]), config)
    whole = _between(rng, np.concatenate([before[-1:], stops[stops > start]]), config)
    return whole.cut(float(whole.passing_times(np.array([start]))[0]))


def stops_of(line: Line) -> Array:
    """Return the stops (M,) of the whole line [m]; raise DataError when they cannot be."""
    try:
        section = np.array([float(cell) for cell in line.stops_m.replace(',', ' ').split()])
    except ValueError:
        raise DataError(
            f'setting line.stops_m: {line.stops_m!r} are not numbers; give chainages, as in '
            "'0 1700 3300'"
        ) from None
    if len(section) < 2 or not np.isfinite(section).all() or (np.diff(section) <= 0.0).any():
        raise DataError(
            f'setting line.stops_m: {line.stops_m!r}; give two or more chainages, increasing'
        )
    if section[0] < 0.0 or section[-1] > line.length_m:
        raise DataError(
            f'setting line.stops_m: {line.stops_m!r} leave the line of {line.length_m} m; '
            'lengthen line.length_m'
        )
    all_of_them = section + line.length_m * np.arange(line.sections)[:, None]
    return np.unique(all_of_them)


def _accelerating(rng: Generator, config: MotionErrors) -> Motion:
    """Return the paper's train: x(k+1) = F x(k) + G W(k), its jerk W constant for a second."""
    count = int(np.ceil(config.duration_s / STEP_S - 1e-9))
    time = np.minimum(STEP_S * np.arange(count + 1), config.duration_s)
    jerk = np.sqrt(config.jerk_variance) * rng.standard_normal(count)
    motion = _integrate(time, jerk, 0.0, config.start_speed_mps, config.acceleration_mps2)
    if motion.v.min() < 0.0:
        raise DataError(
            'setting motion.jerk_variance: the train runs backward; lessen it or raise '
            'motion.start_speed_mps'
        )
    return motion


def _between(rng: Generator, stops: Array, config: MotionErrors) -> Motion:
    """Return the motion from stop to stop, with a standstill at each."""
    parts = []
    stands = rng.uniform(*config.dwell_s, len(stops))
    for stop, stand, leg in zip(stops, stands, [*np.diff(stops), 0.0], strict=True):
        ramp = leg_times(leg, config.speed_mps, config.acceleration_mps2, config.jerk_mps3)
        span, jerk = np.concatenate([[stand], ramp]), config.jerk_mps3 * SENSE
        time = np.concatenate([[0.0], np.cumsum(span[span > 0.0])])
        parts.append(_integrate(time, jerk[span > 0.0], float(stop), 0.0, 0.0))
    return _end_to_end(parts, float(stops[-1]))


def _end_to_end(parts: list[Motion], end: float) -> Motion:
    """Return one motion; each part begins exactly at rest, whatever rounding left before it."""
    starts = np.concatenate([[0.0], np.cumsum([part.time_s[-1] for part in parts])])
    time = [part.time_s[:-1] + start for part, start in zip(parts, starts[:-1], strict=True)]
    return Motion(
        np.concatenate([*time, starts[-1:]]),
        np.append(np.concatenate([part.s[:-1] for part in parts]), end),
        np.append(np.concatenate([part.v[:-1] for part in parts]), 0.0),
        np.append(np.concatenate([part.a[:-1] for part in parts]), 0.0),
        np.concatenate([part.jerk for part in parts]),
    )


def leg_times(length: float, speed: float, acceleration: float, jerk: float) -> Array:
    """
    Return the lengths (7,) of the stretches from rest to rest [s], the quickest within the limits.

    Their jerks are +, 0, -, 0, -, 0, + times the greatest. A short leg does not reach ``speed``.
    """
    top = min(speed, _top_speed(length, acceleration, jerk))
    ramp = min(acceleration / jerk, np.sqrt(top / jerk))
    hold = max(top / acceleration - ramp, 0.0) if ramp == acceleration / jerk else 0.0
    cruise = max(length / top - (2.0 * ramp + hold), 0.0) if top > 0.0 else 0.0
    return np.array([ramp, hold, ramp, cruise, ramp, hold, ramp])


def _top_speed(length: float, acceleration: float, jerk: float) -> float:
    """Return the speed after which the train must brake at once, on a leg of this length."""
    without_hold = (0.25 * jerk * length**2) ** (1.0 / 3.0)
    if without_hold <= acceleration**2 / jerk:
        return float(without_hold)
    ramp = acceleration / jerk
    return float(0.5 * acceleration * (np.sqrt(ramp**2 + 4.0 * length / acceleration) - ramp))


def _integrate(time: Array, jerk: Array, s: float, v: float, a: float) -> Motion:
    rows = [(s, v, a)]
    for h, j in zip(np.diff(time).tolist(), jerk.tolist(), strict=True):
        s += h * (v + h * (a / 2.0 + h * j / 6.0))
        v += h * (a + h * j / 2.0)
        a += h * j
        rows.append((s, v, a))
    table = np.array(rows)
    return Motion(time, table[:, 0].copy(), table[:, 1].copy(), table[:, 2].copy(), jerk)

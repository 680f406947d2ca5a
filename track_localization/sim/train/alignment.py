"""
The line as engineers set it out: curvature, slope and cant by chainage, in closed form.

Every change runs along Bloss's curve 3x^2 - 2x^3, as railway transitions do, so that curvature,
slope and cant have continuous slopes themselves and the course is a polynomial.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.sim.train import bloss
from track_localization.sim.train.config import Line

Array = NDArray[np.float64]

MOST_TURNED = np.radians(50.0)
"""Further off than this from its first course the line turns back to it [rad]."""


class Angles(NamedTuple):
    """Course, slope and cant (N,) [rad], and how each changes by the metre [rad/m]."""

    course: Array
    course_rate: Array
    slope: Array
    slope_rate: Array
    cant: Array
    cant_rate: Array


@dataclasses.dataclass(frozen=True)
class Alignment:
    """
    A line by chainage; no two curves overlap, and no two changes of slope.

    Attributes:
        length: [m].
        course: at chainage 0, from east to north [rad].
        curve: (K, 2) where curves begin and end, transitions included [m].
        transition: (K,) length of their transitions [m].
        curvature: (K,) positive to the left [1/m].
        cant: (K,) how far the train leans into them, roll positive to the right [rad].
        bend: (M,) where the slope begins to change [m].
        bend_length: (M,) over so far [m].
        bend_slope: (M,) by so much, as an angle [rad].
    """

    length: float
    course: float
    curve: Array
    transition: Array
    curvature: Array
    cant: Array
    bend: Array
    bend_length: Array
    bend_slope: Array

    def at(self, s: Array) -> Angles:
        """Return the angles at chainages (N,)."""
        return Angles(*self._in_plan(s), *self._in_profile(s), *self._across(s))

    def _in_plan(self, s: Array) -> tuple[Array, Array]:
        """Return course and curvature (N,)."""
        if not len(self.curve):
            return np.full_like(s, self.course), np.zeros_like(s)
        begin, end = self.curve.T
        turns = self.curvature * (end - begin - self.transition)
        before = self.course + np.cumsum(turns) - turns
        i, up, down = self._ramps(s)
        way = self.transition[i] * (bloss.area(up) - bloss.area(down))
        share = bloss.value(up) - bloss.value(down)
        return before[i] + self.curvature[i] * way, self.curvature[i] * share

    def _across(self, s: Array) -> tuple[Array, Array]:
        """Return cant (N,) and how it changes."""
        if not len(self.curve):
            return np.zeros_like(s), np.zeros_like(s)
        i, up, down = self._ramps(s)
        steepness = (bloss.slope(up) - bloss.slope(down)) / self.transition[i]
        return self.cant[i] * (bloss.value(up) - bloss.value(down)), self.cant[i] * steepness

    def _in_profile(self, s: Array) -> tuple[Array, Array]:
        """Return slope (N,) and how it changes."""
        if not len(self.bend):
            return np.zeros_like(s), np.zeros_like(s)
        before = np.cumsum(self.bend_slope) - self.bend_slope
        i = _last(self.bend, s)
        x = (s - self.bend[i]) / self.bend_length[i]
        change = self.bend_slope[i]
        return before[i] + change * bloss.value(x), change * bloss.slope(x) / self.bend_length[i]

    def _ramps(self, s: Array) -> tuple[NDArray[np.int64], Array, Array]:
        """Return the last curve begun (N,), and how far its two transitions are run through."""
        begin, end = self.curve.T
        i = _last(begin, s)
        length = self.transition[i]
        return i, (s - begin[i]) / length, (s - end[i]) / length + 1.0


def set_out(rng: Generator, config: Line, length: float, speed: float) -> Alignment:
    """Return a line of this length [m] for trains of this speed [m/s]."""
    course = float(np.radians(rng.uniform(*config.course_deg)))
    curve, transition, curvature = _curves(rng, config, length)
    balance = np.arctan(speed**2 * np.abs(curvature) / GRAVITY)
    lean = np.minimum(config.cant_share * balance, np.radians(config.cant_deg))
    bend, bend_length, bend_slope = _bends(rng, config, length)
    cant = -np.sign(curvature) * lean
    return Alignment(
        length, course, curve, transition, curvature, cant, bend, bend_length, bend_slope
    )


def _curves(rng: Generator, config: Line, length: float) -> tuple[Array, Array, Array]:
    """Return where curves lie (K, 2), their transitions and curvatures (K,)."""
    spans, transitions, curvatures = [], [], []
    s, turned = float(rng.uniform(*config.straight_m)), 0.0
    while True:
        radius = float(rng.uniform(*config.radius_m))
        turn = np.radians(rng.uniform(*config.turn_deg))
        transition = float(rng.uniform(*config.transition_m))
        side = float(rng.choice([-1.0, 1.0]))
        if abs(turned) > MOST_TURNED:
            side = -float(np.sign(turned))
        span = max(turn * radius, transition) + transition
        straight = float(rng.uniform(*config.straight_m))
        if s + span > length:
            break
        spans.append((s, s + span))
        transitions.append(transition)
        curvatures.append(side / radius)
        turned += side * (span - transition) / radius
        s += span + straight
    return np.array(spans).reshape(-1, 2), np.array(transitions), np.array(curvatures)


def _bends(rng: Generator, config: Line, length: float) -> tuple[Array, Array, Array]:
    """Return where slopes change, over how far, and by how much, (M,) each."""
    steepest = float(np.arctan(config.grade))
    begins, lengths, changes = [], [], []
    s, slope = 0.0, 0.0
    while True:
        wanted = float(rng.uniform(-steepest, steepest))
        distance = float(rng.uniform(*config.grade_m))
        bend = max(bloss.STEEPEST * config.vertical_radius_m * abs(wanted - slope), 50.0)
        if s + bend > length:
            break
        begins.append(s)
        lengths.append(bend)
        changes.append(wanted - slope)
        slope = wanted
        s += max(bend, distance)
    return np.array(begins), np.array(lengths), np.array(changes)


def _last(begin: Array, s: Array) -> NDArray[np.int64]:
    """Return the last of the places (K,) not beyond chainages (N,), the first before it."""
    return np.maximum(np.searchsorted(begin, s, 'right') - 1, 0)

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
    slope: Array
    cant: Array
    course_rate: Array
    slope_rate: Array
    cant_rate: Array


@dataclasses.dataclass(frozen=True)
class Alignment:
    """
    A line by chainage.

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
        course, course_rate = np.full_like(s, self.course), np.zeros_like(s)
        slope, slope_rate = np.zeros_like(s), np.zeros_like(s)
        cant, cant_rate = np.zeros_like(s), np.zeros_like(s)
        rows = zip(self.curve, self.transition, self.curvature, self.cant, strict=True)
        for (begin, end), length, k, lean in rows:
            up, down = (s - begin) / length, (s - end) / length + 1.0
            course += k * length * (bloss.area(up) - bloss.area(down))
            share, share_rate = (
                bloss.value(up) - bloss.value(down),
                bloss.slope(up) - bloss.slope(down),
            )
            course_rate += k * share
            cant += lean * share
            cant_rate += lean * share_rate / length
        for begin, length, change in zip(self.bend, self.bend_length, self.bend_slope, strict=True):
            x = (s - begin) / length
            slope += change * bloss.value(x)
            slope_rate += change * bloss.slope(x) / length
        return Angles(course, slope, cant, course_rate, slope_rate, cant_rate)


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

"""How rails deviate from the line as set out, in long waves: sideways, upward, in cant."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.train.alignment import Angles
from track_localization.sim.train.config import Rails

Array = NDArray[np.float64]

COUNT = 16
"""Waves of each kind."""


@dataclasses.dataclass(frozen=True)
class Waves:
    """
    Waves (3, K) in what turns a train: course, slope, and cant.

    Attributes:
        number: 2 pi by their lengths [rad/m].
        phase: at chainage 0 [rad].
        angle: amplitudes of the angles [rad].
    """

    number: Array
    phase: Array
    angle: Array

    def on(self, angles: Angles, s: Array) -> Angles:
        """Return the angles of a line at chainages (N,) with the waves on it."""
        at = self.number[:, :, None] * s + self.phase[:, :, None]
        turned = np.einsum('ik,ikn->in', self.angle, np.cos(at))
        rate = np.einsum('ik,ikn->in', -self.angle * self.number, np.sin(at))
        return Angles(
            angles.course + turned[0],
            angles.course_rate + rate[0],
            angles.slope + turned[1],
            angles.slope_rate + rate[1],
            angles.cant + turned[2],
            angles.cant_rate + rate[2],
        )


def draw_waves(rng: Generator, config: Rails) -> Waves:
    """
    Return waves whose deviations have the rms that is set.

    Lengths are uniform in their logarithm. The longer a wave the higher it is, as on real track:
    so that all turn a train alike.
    """
    shortest, longest = config.wave_m
    length = shortest * (longest / shortest) ** rng.random((3, COUNT))
    phase = rng.uniform(-np.pi, np.pi, (3, COUNT))
    number = 2.0 * np.pi / length
    height = length / np.sqrt(0.5 * np.sum(length**2, axis=1, keepdims=True))
    aside, above, cross = config.aside_m, config.above_m, config.cross_m / config.gauge_m
    angle = height * np.array([[aside], [above], [cross]])
    angle[:2] *= number[:2]
    return Waves(number, phase, angle)

"""A train in closed form, and what its sensors tell."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from maglev_localization.measurements import (
    BalisePassing,
    LoopPosition,
    Measurement,
    RadarSpeed,
)
from track_localization.track.balise_table import BaliseTable


@dataclasses.dataclass(frozen=True)
class Train:
    """
    Rest for ``rest_s`` at ``start_m``, then ``pull`` up to ``top`` for good, from ``begin_s`` on.

    The loop counts crossings from ``zero_m`` on, the radar's scale is ``1 + scale``, balises lie
    where the table has them, and their readers know where they are to 2 cm.
    """

    rest_s: float = 4.0
    start_m: float = 5.03
    pull: float = 1.0
    top: float = 25.0
    begin_s: float = 1000.0
    seconds: float = 100.0
    loop_hz: float = 50.0
    radar_hz: float = 20.0
    pitch: float = 0.2
    zero_m: float = 0.0
    scale: float = 0.004
    balises: tuple[float, ...] = (300.0, 900.0, 1500.0, 2100.0)

    @property
    def table(self) -> BaliseTable:
        """The balises ``b0``, ``b1``, ... to 5 cm."""
        names = tuple(f'b{i}' for i in range(len(self.balises)))
        return BaliseTable(names, np.array(self.balises), np.full(len(names), 0.05))

    def at(self, time_s):
        """Return chainage and speed at stamps."""
        t = np.asarray(time_s) - self.begin_s - self.rest_s
        moving, pulling = np.clip(t, 0.0, None), self.top / self.pull
        speed = np.minimum(self.pull * moving, self.top)
        early = 0.5 * self.pull * moving**2
        late = self.top * (moving - 0.5 * pulling)
        return self.start_m + np.where(moving < pulling, early, late), speed

    def passing_s(self, chainage):
        """Return the stamp at which a place is passed."""
        far, pulling = chainage - self.start_m, self.top / self.pull
        if far < 0.5 * self.pull * pulling**2:
            return self.begin_s + self.rest_s + np.sqrt(2.0 * far / self.pull)
        return self.begin_s + self.rest_s + far / self.top + 0.5 * pulling

    def loop(self) -> list[Measurement]:
        """Return the loop's readings: whole crossings."""
        time_s = self.begin_s + np.arange(round(self.seconds * self.loop_hz)) / self.loop_hz
        count = np.floor((self.at(time_s)[0] - self.zero_m) / self.pitch + 1e-9)
        variance = self.pitch**2 / 12.0 + 0.02**2
        return [
            LoopPosition(float(t), float(self.pitch * n), variance)
            for t, n in zip(time_s, count, strict=True)
        ]

    def radar(self, rng) -> list[Measurement]:
        """Return the radar's speeds, nought below 0.5 m/s."""
        count = round(self.seconds * self.radar_hz)
        time_s = self.begin_s + 0.003 + np.arange(count) / self.radar_hz
        v = self.at(time_s)[1]
        told = np.where(v < 0.5, 0.0, (1.0 + self.scale) * v + 0.05 * rng.normal(size=count))
        return [RadarSpeed(float(t), float(z), 0.05**2) for t, z in zip(time_s, told, strict=True)]

    def passings(self, rng) -> list[Measurement]:
        """Return the passings of all balises that the train gets to."""
        stamps = [float(self.passing_s(s)) for s in self.balises]
        return [
            BalisePassing(t, f'b{i}', float(0.02 * rng.normal()), 0.02**2)
            for i, t in enumerate(stamps)
            if t < self.begin_s + self.seconds
        ]

    def measurements(self, rng=None) -> list[Measurement]:
        """Return everything in the order of stamps."""
        rng = np.random.default_rng(7) if rng is None else rng
        everything = self.radar(rng) + self.passings(rng) + self.loop()
        return sorted(everything, key=lambda z: z.time_s)

    def errors(self, estimates):
        """Return stamps, chainage errors, sigmas, speed errors and their sigmas of estimates."""
        time_s = np.array([e.time_s for e in estimates])
        s, v = self.at(time_s)
        along = np.array([e.chainage for e in estimates]) - s
        speed = np.array([e.speed for e in estimates]) - v
        sigma = np.array([e.sigma_along for e in estimates])
        return time_s, along, sigma, speed, np.array([e.sigma_speed for e in estimates])


@pytest.fixture(scope='session')
def make_train():
    """The class itself: ``make_train(top=10.0)``."""
    return Train


@pytest.fixture(scope='session')
def train():
    """One train."""
    return Train()

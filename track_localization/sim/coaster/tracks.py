"""Tracks of our own design, different in kind, each with its ride plan."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from track_localization.sim.coaster.elements import (
    Element,
    corkscrew,
    grade,
    hill,
    loop,
    straight,
    turn,
)
from track_localization.sim.coaster.layout import Layout, bank, close, to_track
from track_localization.sim.coaster.ride_plan import RidePlan, Zone
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Track:
    """A track with the plan of its ride; ``line_height_m`` of the plan applies to the file."""

    name: str
    title: str
    file: TrackFile
    plan: RidePlan


def _looping(x: Array) -> list[Element]:
    return [
        *straight(42.0, 'station'),
        *grade(34.0, 30.0, 14.0, 12.0, 'lift'),
        *turn(180.0, 10.0, -3.0),
        *grade(-35.0, 52.0, 13.0, 23.0, 'drop'),
        *loop(21.0, 8.0, 3.5),
        *straight(12.0 + x[0]),
        *grade(12.0, 26.0, 22.0, 25.0),
        *turn(-180.0, 15.0, -2.0),
        *grade(-9.0, 22.0, 25.0, 22.0),
        *corkscrew(33.0, 58.0, 1),
        *hill(9.0, 27.0, 22.0, 22.0, 'airtime'),
        *turn(540.0, 13.0, -5.0, 0.15, 'helix'),
        *hill(7.0, 22.0, 20.0, 22.0, 'airtime'),
        *grade(8.0, 20.0, 20.0, 27.0),
        *straight(45.0, 'brakes'),
        *turn(90.0, 12.0),
        *straight(20.0 + x[1], 'transfer'),
        *turn(90.0, 12.0),
        *straight(25.0, 'approach'),
    ]


def _looping_plan(at: Layout) -> RidePlan:
    brakes, transfer, end = at.span('brakes'), at.span('transfer'), at.length
    lift = at.span('lift')
    return RidePlan(
        start_m=26.0,
        line_height_m=1.1,
        vibration_mps2=1.5,
        gyro_vibration_radps=0.03,
        cross_track_m=0.010,
        zones=(
            Zone('tyres', 0.0, lift[0] + 16.0, 2.5, 1.2, 1.5),
            Zone('chain', lift[0] - 4.0, lift[1] + 5.0, 2.4, 12.0),
            Zone('brake', brakes[0], brakes[1] - 15.0, 3.0, 0.0, 4.0),
            Zone('block', brakes[1] - 15.0, brakes[1], 3.0, 1.0, 3.0),
            Zone('tyres', brakes[1] - 2.0, end, 3.0, 1.0, 1.0),
            Zone('station', end - 2.0, end + 40.0, 2.0, 1.0, 1.5, end + 26.0),
        ),
    )


@dataclasses.dataclass(frozen=True)
class _Design:
    title: str
    build: Callable[[Array], list[Element]]
    guess: tuple[float, ...]
    plan: Callable[[Layout], RidePlan]
    bank_share: float
    most_bank_deg: float
    bank_smooth_m: float


_DESIGNS = {
    'looping': _Design(
        'Looping steel coaster', _looping, (0.0, 0.0), _looping_plan, 0.95, 75.0, 3.0
    ),
}

TRACKS = tuple(_DESIGNS)
"""Names of the built-in tracks."""


@functools.lru_cache(maxsize=None)
def built_in(name: str) -> Track:
    """Return a built-in track; raise KeyError for an unknown name."""
    design = _DESIGNS[name]
    layout = close(design.build, np.array(design.guess))
    plan = design.plan(layout)
    layout, _ = bank(layout, plan, design.bank_share, design.most_bank_deg, design.bank_smooth_m)
    return Track(name, design.title, to_track(layout), plan)

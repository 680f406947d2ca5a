"""
Five tracks of our own, different in kind: their elements and ride plans.

``x`` holds the free lengths with which the circuit closes; heights add up to nothing by design.
Lengths in m, angles in deg; the second argument of a turn is its tightest radius.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from track_localization.sim.coaster.elements import (
    Element,
    corkscrew,
    grade,
    hill,
    loop,
    profile,
    roll_hill,
    straight,
    turn,
)
from track_localization.sim.coaster.layout import Layout
from track_localization.sim.coaster.ride_plan import Phase, RidePlan, Train, Zone

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Design:
    """
    How a track comes about.

    ``bank_share`` of the sideways force is banked away, up to ``most_bank_deg``, smoothed over
    ``bank_smooth_m``. An open track has an empty ``guess``.
    """

    title: str
    build: Callable[[Array], list[Element]]
    plan: Callable[[Layout], RidePlan]
    guess: tuple[float, ...] = (0.0, 0.0)
    bank_share: float = 0.95
    most_bank_deg: float = 75.0
    bank_smooth_m: float = 3.0


def _looping(x: Array) -> list[Element]:
    return [
        *straight(42.0, 'station'),
        *grade(34.0, 30.0, 14.0, 12.0, 'lift'),
        *turn(180.0, 10.0, -3.0),
        *grade(-35.0, 52.0, 13.0, 23.0, 'drop'),
        *loop(22.5, 8.2, 3.5),
        *straight(12.0 + x[0]),
        *grade(12.0, 26.0, 22.0, 25.0),
        *turn(-180.0, 15.0, -2.0),
        *grade(-9.0, 22.0, 25.0, 22.0),
        *corkscrew(33.0, 58.0, 1),
        *hill(9.0, 27.0, 22.0, 22.0, 'airtime'),
        *turn(540.0, 13.0, -5.0, 0.15, 'helix'),
        *profile([(0.0, 20.0), (7.0, 22.0), (0.0, 20.0), (8.0, 27.0)], [22.0, 22.0, 20.0]),
        *straight(45.0, 'brakes'),
        *turn(90.0, 12.0),
        *straight(20.0 + x[1], 'transfer'),
        *turn(90.0, 12.0),
        *straight(25.0, 'approach'),
    ]


def _looping_plan(at: Layout) -> RidePlan:
    lift, brakes, end = at.span('lift'), at.span('brakes'), at.length
    return RidePlan(
        start_m=26.0,
        line_height_m=1.1,
        vibration_mps2=1.5,
        gyro_vibration_radps=0.03,
        cross_track_m=0.010,
        zones=(
            Zone('tyres', 0.0, lift[0] + 16.0, 2.5, 1.2, 1.5),
            Zone('chain', lift[0] - 4.0, lift[1] + 5.0, 2.4, 12.0),
            *_brake_run(brakes, end, 26.0),
        ),
    )


def _brake_run(brakes: tuple[float, float], end: float, stop: float) -> tuple[Zone, ...]:
    """Return brakes, block, tyres to the station and the station, stopping at ``stop``."""
    start, block = brakes[0], brakes[1] - 16.0
    return (
        Zone('brake', start, block, 4.0, 0.0, 4.5),
        Zone('block', block, brakes[1], 3.6, 1.0, 3.5),
        Zone('tyres', brakes[1] - 4.0, end, 3.6, 1.0, 1.0),
        Zone('station', end - 2.0, end + stop + 15.0, 2.0, 1.0, 1.5, end + stop),
    )


def _mine(x: Array) -> list[Element]:
    return [
        *straight(36.0, 'station'),
        *grade(16.0, 22.0, 12.0, 10.0, 'lift'),
        *turn(180.0, 10.0, -2.0),
        *grade(-9.0, 28.0, 11.0, 16.0, 'drop'),
        *turn(-180.0, 12.0, 2.0),
        *hill(4.0, 22.0, 12.0, 11.0, 'airtime'),
        *turn(-35.0, 14.0),
        *turn(70.0, 14.0, -1.0),
        *turn(-35.0, 14.0),
        *straight(2.0 + x[0]),
        *turn(450.0, 12.0, -4.0, 0.15, 'helix'),
        *straight(8.0),
        *grade(11.0, 20.0, 12.0, 10.0, 'lift 2'),
        *turn(90.0, 11.0, -2.0),
        *profile([(0.0, 12.0), (-7.0, 15.0), (-3.0, 11.0), (-7.0, 13.0)], [25.0, 22.0, 22.0]),
        *turn(40.0, 14.0),
        *turn(-80.0, 14.0, -1.0),
        *turn(40.0, 14.0),
        *profile([(0.0, 13.0), (3.0, 11.0), (-3.0, 14.0)], [20.0, 20.0]),
        *straight(38.0, 'brakes'),
        *turn(90.0, 10.0),
        *straight(20.0 + x[1], 'transfer'),
        *turn(90.0, 10.0),
        *straight(20.0, 'approach'),
    ]


def _mine_plan(at: Layout) -> RidePlan:
    lift, second, brakes = at.span('lift'), at.span('lift 2'), at.span('brakes')
    return RidePlan(
        train=Train(
            cars=6,
            car_length_m=2.2,
            mass_kg=4800.0,
            friction=0.014,
            drag_area_m2=2.6,
            front_m=1.1,
            wheelbase_m=1.3,
            seat_height_m=0.75,
        ),
        start_m=24.0,
        line_height_m=0.0,
        vibration_mps2=3.0,
        gyro_vibration_radps=0.04,
        cross_track_m=0.015,
        joint_spacing_m=6.0,
        zones=(
            Zone('tyres', 0.0, lift[0] + 14.0, 2.6, 1.0, 1.5),
            Zone('chain', lift[0] - 4.0, lift[1] + 5.0, 2.5, 12.0),
            Zone('trim', second[0] - 12.0, second[0] + 4.0, 4.0, 0.0, 4.0),
            Zone('chain', second[0] - 6.0, second[1] + 5.0, 2.8, 12.0),
            *_brake_run(brakes, at.length, 24.0),
        ),
    )


def _launch(x: Array) -> list[Element]:
    return [
        *straight(112.0, 'launch'),
        *hill(32.0, 57.0, 23.0, 12.5, 'top hat'),
        *straight(8.0),
        *turn(-180.0, 19.0, 4.0),
        *grade(-4.0, 14.0, 30.0, 26.0),
        *roll_hill(16.0, 31.0, 26.0, 29.0, 1),
        *straight(10.0 + x[0]),
        *turn(180.0, 17.0, 3.0),
        *grade(-3.0, 14.0, 26.0, 24.0),
        *corkscrew(33.0, 58.0, -1),
        *hill(10.0, 28.0, 22.0, 21.0, 'airtime'),
        *turn(-540.0, 13.5, 5.0, 0.2, 'helix'),
        *profile(
            [(0.0, 20.0), (6.0, 18.0), (-3.0, 20.0), (3.0, 18.0), (-5.0, 24.0)],
            [22.0, 24.0, 21.0, 21.0],
        ),
        *straight(50.0, 'brakes'),
        *turn(-90.0, 12.0),
        *straight(20.0 + x[1], 'transfer'),
        *turn(-90.0, 12.0),
        *straight(20.0, 'approach'),
    ]


def _launch_plan(at: Layout) -> RidePlan:
    return RidePlan(
        train=Train(cars=5, car_length_m=2.8, mass_kg=7200.0, friction=0.009, drag_area_m2=2.8),
        start_m=22.0,
        line_height_m=1.1,
        vibration_mps2=0.8,
        gyro_vibration_radps=0.02,
        cross_track_m=0.008,
        joint_spacing_m=10.0,
        zones=(
            Zone('tyres', 0.0, 36.0, 2.5, 1.0, 1.5),
            Zone('launch', 34.0, 100.0, 40.0, 6.2),
            Zone('trim', at.span('airtime')[0] - 8.0, at.span('airtime')[0], 12.0, 0.0, 2.0),
            *_brake_run(at.span('brakes'), at.length, 22.0),
        ),
    )


def _wooden(x: Array) -> list[Element]:
    return [
        *straight(40.0, 'station'),
        *grade(28.0, 25.0, 14.0, 11.0, 'lift'),
        *turn(180.0, 12.0, -3.0),
        *profile(
            [
                *[(0.0, 14.0), (-27.0, 22.0), (-10.0, 14.0), (-27.0, 21.0), (-14.5, 17.0)],
                *[(-27.0, 21.0), (-18.0, 20.0)],
            ],
            [48.0, 38.0, 37.0, 32.0, 31.0, 25.0],
        ),
        *turn(-180.0, 17.0, -2.0),
        *profile(
            [(0.0, 20.0), (-7.0, 20.0), (3.0, 16.0), (-7.0, 18.0), (2.0, 16.0), (-7.0, 19.0)],
            [24.0, 29.0, 29.0, 28.0, 28.0],
        ),
        *straight(20.0 + x[0]),
        *hill(7.0, 26.0, 20.0, 16.0, 'airtime'),
        *turn(180.0, 17.0, 2.0),
        *profile(
            [(0.0, 17.0), (6.0, 14.0), (0.0, 15.0), (5.0, 13.0), (0.0, 17.0)],
            [25.0, 25.0, 23.0, 23.0],
        ),
        *straight(48.0, 'brakes'),
        *turn(90.0, 12.0),
        *straight(20.0 + x[1], 'transfer'),
        *turn(90.0, 12.0),
        *straight(24.0, 'approach'),
    ]


def _wooden_plan(at: Layout) -> RidePlan:
    lift = at.span('lift')
    return RidePlan(
        train=Train(
            cars=6,
            car_length_m=2.7,
            mass_kg=7800.0,
            friction=0.015,
            drag_area_m2=3.6,
            front_m=1.3,
            wheelbase_m=1.9,
            seat_height_m=0.7,
        ),
        start_m=26.0,
        line_height_m=0.0,
        vibration_mps2=8.0,
        gyro_vibration_radps=0.06,
        cross_track_m=0.020,
        joint_spacing_m=7.0,
        zones=(
            Zone('tyres', 0.0, lift[0] + 17.0, 2.6, 1.0, 1.5),
            Zone('chain', lift[0] - 4.0, lift[1] + 6.0, 2.5, 12.0),
            *_brake_run(at.span('brakes'), at.length, 26.0),
        ),
    )


def _shuttle(_: Array) -> list[Element]:
    return [
        *straight(3.0, 'top'),
        *grade(-39.0, 50.0, 9.0, 25.0, 'lift 1'),
        *straight(46.0, 'station'),
        *turn(60.0, 25.0),
        *straight(8.0),
        *corkscrew(30.0, 62.0, 1),
        *hill(4.0, 16.0, 24.0, 30.0, 'airtime'),
        *loop(20.0, 7.6, -3.5),
        *straight(12.0),
        *turn(-120.0, 24.0, 2.0),
        *grade(37.0, 50.0, 25.0, 9.0, 'lift 2'),
        *straight(3.0, 'top'),
    ]


def _shuttle_plan(at: Layout) -> RidePlan:
    lift, station, second = at.span('lift 1'), at.span('station'), at.span('lift 2')
    stop = station[0] + 30.0
    return RidePlan(
        train=Train(cars=7, car_length_m=2.0, mass_kg=6800.0, friction=0.011, front_m=1.0),
        start_m=stop,
        line_height_m=1.1,
        vibration_mps2=2.0,
        gyro_vibration_radps=0.035,
        cross_track_m=0.012,
        joint_spacing_m=7.0,
        zones=(
            Zone('chain', lift[0], station[1], 2.0, 14.0, 0.0, 0.0, 0),
            Zone('chain', second[0] + 8.0, second[1], 1.6, 14.0, 0.0, 0.0, 1),
            Zone('trim', station[0] + 2.0, station[1] - 2.0, 4.0, 0.0, 3.6, 0.0, 2),
            Zone('station', station[0] - 4.0, station[1], 9.0, 1.0, 5.0, stop, 3),
        ),
        phases=(
            Phase(-1, 'at', lift[0] + 16.0, 2.0),
            Phase(1, 'at', second[1] - 10.0, 2.0),
            Phase(-1, 'reversal'),
            Phase(1, 'stop'),
        ),
    )


DESIGNS = {
    'looping': Design('Looping steel coaster', _looping, _looping_plan),
    'mine': Design('Family mine train, two lifts', _mine, _mine_plan, bank_share=0.8),
    'launch': Design('Launched steel coaster', _launch, _launch_plan),
    'wooden': Design(
        'Wooden out-and-back coaster', _wooden, _wooden_plan, bank_share=0.65, most_bank_deg=45.0
    ),
    'shuttle': Design('Shuttle, ridden forward and backward', _shuttle, _shuttle_plan, ()),
}
"""The built-in designs by name."""

"""
How a train runs along its line: forces, integrated in time.

The train is a chain of even mass along the line with one degree of freedom. Its weight then acts
by the height difference of its two ends; rolling friction acts by the wheel load of each car.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.sim.coaster.kernels import LONGEST_S, STEP_S, integrate
from track_localization.sim.coaster.ride_plan import ENDS, RidePlan
from track_localization.track.centreline import Centreline

Array = NDArray[np.float64]

AIR_DENSITY = 1.2
_KIND = {'tyres': 0, 'chain': 1, 'launch': 2, 'trim': 3, 'brake': 4, 'block': 5, 'station': 6}
DONE, ROLLED_BACK, STUCK, TOO_LONG = 0, 1, 2, 3
WHY = {
    ROLLED_BACK: 'the train rolled back',
    STUCK: 'the train came to rest',
    TOO_LONG: f'the ride did not end within {LONGEST_S:.0f} s',
}


@dataclasses.dataclass(frozen=True)
class Run:
    """
    Motion of row 1 along the line from dispatch to the last stop.

    Attributes:
        time_s: (N,) since dispatch, every STEP_S.
        s, v, a: (N,) chainage, speed and acceleration along the line [m, m/s, m/s^2].
        outcome: DONE, or why it ended early (a key of WHY).
    """

    time_s: Array
    s: Array
    v: Array
    a: Array
    outcome: int


@dataclasses.dataclass(frozen=True)
class Conditions:
    """Factors of one run on the plan's values, and the wind."""

    mass: float = 1.0
    friction: float = 1.0
    drag: float = 1.0
    chain: float = 1.0
    tyres: float = 1.0
    launch: float = 1.0
    brake: float = 1.0
    brake_shift_m: tuple[float, ...] = ()
    start_shift_m: float = 0.0
    wind_mps: tuple[float, float] = (0.0, 0.0)
    gusts: tuple[float, ...] = (1.0,)


def run_train(line: Centreline, plan: RidePlan, conditions: Conditions = Conditions()) -> Run:
    """Run the train of ``plan`` along ``line``; how it ended is in ``outcome``."""
    train = plan.train
    directions = np.array([p.direction for p in plan.phases], dtype=np.int64)
    ends = np.array([ENDS.index(p.ends) for p in plan.phases])
    until = np.array([p.at_m for p in plan.phases])
    holds = np.array([p.hold_s for p in plan.phases])
    body = np.array(
        [
            train.length_m,
            train.front_m,
            float(train.cars),
            train.friction * conditions.friction,
            0.5
            * AIR_DENSITY
            * train.drag_area_m2
            * conditions.drag
            / (train.mass_kg * conditions.mass),
            *conditions.wind_mps,
        ]
    )
    out, count, outcome = integrate(
        plan.start_m + conditions.start_shift_m,
        _line_table(line),
        line.length,
        line.closed,
        _zone_table(plan, conditions),
        body,
        np.asarray(conditions.gusts, dtype=np.float64),
        directions,
        ends,
        until,
        holds,
    )
    time_s = np.arange(count) * STEP_S
    s, v, a = np.ascontiguousarray(out[:count].T)
    return Run(time_s, s, v, a, outcome)


def _line_table(line: Centreline) -> Array:
    """Return (N, 7) every 0.1 m: height, curvature left and up, gravity left and up, course."""
    grid = np.linspace(0.0, line.length, int(np.ceil(line.length / 0.1)) + 1)
    R = line.attitude(grid)
    k = line.curvature(grid)
    tangent = line.tangent(grid)
    return np.column_stack(
        [
            line.position(grid)[:, 2],
            k[:, 2],
            -k[:, 1],
            GRAVITY * R[:, 2, 1],
            GRAVITY * R[:, 2, 2],
            tangent[:, :2],
        ]
    )


def _zone_table(plan: RidePlan, c: Conditions) -> Array:
    """Return (Z, 8): kind, start, end, speed, drive, brake, stop, phase of each zone."""
    rows = []
    shifts = iter(c.brake_shift_m)
    for z in plan.zones:
        start, end, speed, drive, brake = (
            z.start_m,
            z.end_m,
            z.speed_mps,
            z.accel_mps2,
            z.brake_mps2,
        )
        if z.kind == 'chain':
            speed *= c.chain
        elif z.kind == 'launch':
            drive *= c.launch
        elif z.kind in ('tyres', 'block', 'station'):
            speed *= c.tyres
        if z.kind in ('trim', 'brake', 'block'):
            brake *= c.brake
            shift = next(shifts, 0.0)
            start, end = start + shift, end + shift
        drive, brake = drive / c.mass, brake / c.mass
        rows.append([_KIND[z.kind], start, end, speed, drive, brake, z.stop_m, z.phase])
    return np.array(rows, dtype=np.float64).reshape(-1, 8)

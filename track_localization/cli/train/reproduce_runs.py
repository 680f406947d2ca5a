"""The simulated runs behind ``reproduce train``: what is simulated, what estimates, figures."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import track_localization
import train_localization
from track_localization.cli.exam_runs import Run, Task, keeper
from track_localization.cli.kept import Figures, flat
from track_localization.cli.train.reproduce_floor import floors
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSample
from track_localization.evaluation.metrics import present
from track_localization.evaluation.navigation_metrics import (
    error_of_latest,
    navigation_errors,
    navigation_figures,
)
from track_localization.evaluation.provenance import fingerprint
from track_localization.geodesy import enu_from_geodetic
from track_localization.settings import override
from track_localization.sim.train import SimulatedRun, scenario, simulate_train
from track_localization.track.centreline import Centreline
from train_localization.config import TrainConfig
from train_localization.measurements import GnssFix, GnssQuality, Measurement, WheelSpeed
from train_localization.methods import (
    INS,
    MAP,
    PAPER,
    ROBUST,
    SMOOTHED,
    GivenStart,
    MethodResult,
    run_methods,
)

PLAIN, SMOOTHED_MAP = 'paper_no_fading', 'smoothed_map'
"""Entries that are a method with other settings, or with the map."""


@dataclasses.dataclass(frozen=True)
class Group:
    """Methods that run together: entry -> method, whether they have the track, their settings."""

    entries: Mapping[str, str]
    with_track: bool = False
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)


GROUPS = (
    Group({INS: INS, PAPER: PAPER, ROBUST: ROBUST, SMOOTHED: SMOOTHED}),
    Group({PLAIN: PAPER}, settings={'paper.fading': False}),
    Group({MAP: MAP, SMOOTHED_MAP: SMOOTHED}, with_track=True),
)
ENTRIES = (INS, PAPER, PLAIN, ROBUST, MAP, SMOOTHED, SMOOTHED_MAP)
"""All that take part, in the order of the tables."""
FLOOR = 'floor'
"""The best estimators there can be; see ``reproduce_floor``."""


@dataclasses.dataclass(frozen=True)
class Case:
    """What is simulated, and what all estimators are told of it."""

    scenario: str
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)


LINE = 'line'
FLOOR_CASES = ('paper', 'tactical', 'mems', 'slip')
"""Where the floor is known: one outage, and a map that is what it claims."""
CASES: Mapping[str, Case] = {
    'paper': Case('paper'),
    'tactical': Case('tactical', {'imu.grade': 'tactical'}),
    'mems': Case('mems', {'imu.grade': 'mems'}),
    'slip': Case('slip'),
    'wrongmap': Case('wrongmap'),
    LINE: Case('line'),
}
"""Everything that is examined."""


def run_task(task: Task) -> Run:
    """Simulate one run, estimate, return the figures; a failure is told, not raised."""
    case = CASES[task.case]
    entries: dict[str, Figures] = {}
    try:
        run = simulate_train(scenario(case.scenario), task.seed)
        for name, result in results(run, case, task.entries):
            entries[name] = flat(figures(result, run))
        if FLOOR in task.entries:
            entries[FLOOR] = dict(floors(run, scenario(case.scenario), task.seed))
    except (DataError, ArithmeticError, LookupError, ValueError) as error:
        failed = f'{type(error).__name__}: {error}'
        return Run(task.case, task.seed, {'failed': failed}, entries)
    about: Figures = {'duration_s': run.duration_s}
    floor = floor_of(run)
    return Run(task.case, task.seed, about | ({} if floor is None else {'floor_m': floor}), entries)


def results(
    run: SimulatedRun, case: Case, entries: tuple[str, ...]
) -> Iterator[tuple[str, MethodResult]]:
    """Yield what each entry makes of a run."""
    messages = list(measurements(run))
    start = None if run.start is None else GivenStart(*dataclasses.astuple(run.start))
    for group in GROUPS:
        wanted = {method: entry for entry, method in group.entries.items() if entry in entries}
        track = None
        if group.with_track:
            if run.track is None:
                continue
            track = Centreline.from_track(run.track)
        config = override(TrainConfig(), {**case.settings, **group.settings})
        for result in run_methods(messages, config, track, run.datum, list(wanted), None, start):
            yield wanted[result.name], result


def measurements(run: SimulatedRun) -> Iterator[Measurement]:
    """Yield what the sensors of a run tell, in the order of arrival."""
    gnss, wheel, imu = run.gnss, run.wheel, run.imu
    arrival = np.concatenate([run.imu_arrival_s, gnss.arrival_s, gnss.arrival_s, wheel.arrival_s])
    counts = [len(imu), len(gnss), len(gnss), len(wheel)]
    rank = np.repeat([3, 1, 0, 2], counts)
    row = np.concatenate([np.arange(n) for n in counts])
    for i in np.lexsort((row, rank, arrival)).tolist():
        k = int(row[i])
        if rank[i] == 3:
            yield ImuSample(float(imu.time_s[k]), imu.specific_force[k], imu.angular_rate[k])
        elif rank[i] == 2:
            yield WheelSpeed(
                float(wheel.time_s[k]), float(wheel.speed[k]), float(wheel.variance[k])
            )
        elif rank[i] == 1:
            place = float(gnss.latitude[k]), float(gnss.longitude[k]), float(gnss.height[k])
            stamp, valid = float(gnss.time_s[k]), bool(gnss.status[k])
            yield GnssFix(stamp, *place, gnss.covariance[k], valid)
        elif gnss.satellites[k] >= 0:
            yield GnssQuality(float(gnss.time_s[k]), int(gnss.satellites[k]), float(gnss.hdop[k]))


def figures(result: MethodResult, run: SimulatedRun) -> dict[str, Any]:
    """Return the figures of one method's estimates."""
    out: dict[str, Any] = {'runtime_s': result.runtime_s, 'estimates': len(result.trajectory)}
    if len(result.trajectory):
        errors = navigation_errors(result.trajectory, result.velocity_covariance, run.truth())
        if len(errors):
            out |= navigation_figures(errors, run.outages)
    out['rejected'] = {sensor: dict(counts) for sensor, counts in result.rejected.items()}
    return present(out)


def floor_of(run: SimulatedRun) -> float | None:
    """Return the level error of the last fix before the first outage [m]."""
    if not run.outages:
        return None
    gnss = run.gnss
    good = gnss.status & np.isfinite(gnss.latitude)
    place = gnss.latitude[good], gnss.longitude[good], gnss.height[good]
    position = enu_from_geodetic(*place, run.datum)
    return error_of_latest(gnss.time_s[good], position, run.truth(), run.outages[0][0])


KEEPER = keeper(run_task)
"""Runs the tasks and keeps what they give."""


def code_fingerprint() -> str:
    """Return a hash of the code and settings that the figures depend on."""
    system = Path(train_localization.__file__).parent
    shared = Path(track_localization.__file__).parent
    return fingerprint(
        [
            *(p for p in sorted(system.glob('*.py'))),
            *(shared / room for room in ('estimation', 'track', 'sim/train', 'cli/kept.py')),
            shared / 'cli' / 'exam_runs.py',
            *(shared / 'evaluation' / f'{n}.py' for n in ('metrics', 'navigation_metrics')),
            *(shared / f'{n}.py' for n in ('evaluation/interpolation', 'geodesy')),
            *(shared / 'cli' / 'train' / f'reproduce_{n}.py' for n in ('runs', 'floor')),
        ]
    )

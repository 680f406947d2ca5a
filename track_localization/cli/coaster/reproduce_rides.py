"""The simulated rides behind ``reproduce coaster``: run in worker processes, kept as CSV files."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import coaster_localization
import track_localization
from coaster_localization.config import CoasterConfig
from coaster_localization.methods import MethodResult, run_methods
from coaster_localization.track_map import line_map
from coaster_localization.track_rides import filter_ride
from track_localization.cli.coaster import reproduce_midride
from track_localization.cli.coaster import sweeps as coaster_sweeps
from track_localization.cli.coaster.results import Reference, figures, floor_figures
from track_localization.cli.kept import Figures, Keeper, flat, read_figures, write_figures
from track_localization.errors import DataError
from track_localization.evaluation.metrics import summary
from track_localization.evaluation.provenance import fingerprint
from track_localization.settings import override
from track_localization.sim.coaster import (
    SCENARIOS,
    CoasterSimConfig,
    SimulatedRide,
    scenario,
    simulate_coaster,
)

SMALL_MOUNT = 'mount1'
SMALL_MOUNT_DEG = 1.0
"""Nominal rides with the mount turned by exactly this about a random axis, as SMALL_MOUNT."""

START_OFF = 'start20'
START_OFF_M = 20.0
"""Nominal rides whose track filter is told a start so far ahead, and that it is unsure by that."""

MID_RIDE = 'midride'
"""Nominal rides that the track filter comes to late; the methods are the starts."""


@dataclasses.dataclass(frozen=True)
class Task:
    """One ride to simulate, the methods to run on it, and whether to sweep the covariance."""

    track: str
    scenario: str
    seed: int
    methods: tuple[str, ...]
    sweep: bool = False

    @property
    def file(self) -> str:
        """Name of the file that keeps its figures."""
        return f'{self.scenario}_{self.track}_{self.seed}.csv'


@dataclasses.dataclass(frozen=True)
class Ride:
    """
    Figures of one ride.

    Attributes:
        track, scenario, seed: which ride.
        about: of the ride itself: ``mount_deg``, ``duration_s``, or ``failed`` with the reason.
        methods: dotted names as in metrics.json, e.g. ``markers_m.mean``, by method.
    """

    track: str
    scenario: str
    seed: int
    about: Figures
    methods: Mapping[str, Figures]


def run_task(task: Task) -> Ride:
    """Simulate one ride, run its methods and return the figures; a failure is told, not raised."""
    about: Figures = {}
    methods: dict[str, Figures] = {}
    try:
        ride = simulate_coaster(task.track, simulation(task.scenario), task.seed)
        about = {
            'mount_deg': mount_angle_deg(ride.R_bm),
            'duration_s': float(ride.imu.time_s[-1] - ride.imu.time_s[0]),
        }
        if task.scenario == MID_RIDE:
            config = CoasterConfig().track_filter
            which = (task.track, task.seed, task.methods)
            methods |= reproduce_midride.run_starts(ride, *which, config)
        else:
            _run_methods(ride, task, about, methods)
    except DataError as error:
        about['failed'] = str(error)
    except reproduce_midride.BROKEN as error:
        about['failed'] = f'{type(error).__name__}: {error}'
    return Ride(task.track, task.scenario, task.seed, about, methods)


def simulation(name: str) -> CoasterSimConfig:
    """Return the errors of a scenario, or of the rides that are nominal but for one thing."""
    if name in (START_OFF, MID_RIDE):
        return scenario('nominal')
    if name == SMALL_MOUNT:
        changes = {'imu.mount': 'angle', 'imu.mount_angle_deg': SMALL_MOUNT_DEG}
        return override(scenario('nominal'), changes)
    return scenario(name)


def scenarios() -> tuple[str, ...]:
    """Return the names of the scenarios that every method can be run on."""
    return (*SCENARIOS, SMALL_MOUNT)


def mount_angle_deg(R_bm: NDArray[np.float64]) -> float:
    """Return by what angle the sensor is turned in the body [deg]."""
    return float(np.rad2deg(np.arccos(np.clip(0.5 * (np.trace(R_bm) - 1.0), -1.0, 1.0))))


def code_fingerprint() -> str:
    """Return a hash of the code and settings that the figures depend on."""
    system = Path(coaster_localization.__file__).parent
    shared = Path(track_localization.__file__).parent
    here = shared / 'cli' / 'coaster'
    return fingerprint(
        [
            *(p for p in sorted(system.glob('*.py'))),
            *(shared / room for room in ('estimation', 'track', 'sim/coaster', 'sim/imu_error.py')),
            *(shared / 'evaluation' / f'{n}.py' for n in ('metrics', 'interpolation')),
            shared / 'cli' / 'kept.py',
            *(here / f'{n}.py' for n in ('results', 'sweeps')),
            *(here / f'reproduce_{n}.py' for n in ('rides', 'midride')),
        ]
    )


def write_ride(path: Path, ride: Ride, code: str) -> None:
    """Keep a ride."""
    write_figures(path, ride.about, ride.methods, code)


def read_ride(path: Path, task: Task, code: str | None) -> Ride | None:
    """
    Return a kept ride, or None where there is none that serves.

    It serves when it was made by the same ``code`` (None: by any) and has all that the task wants.
    """
    found = read_figures(path, code)
    if found is None:
        return None
    about, methods = found
    wanted = set(task.methods) if 'failed' not in about else set()
    swept = 'failed' in about or not task.sweep or any(k.startswith('sweep.') for k in about)
    if not wanted <= set(methods) or not swept:
        return None
    return Ride(task.track, task.scenario, task.seed, about, methods)


KEEPER = Keeper(
    'rides',
    run_task,
    lambda task: task.file,
    read_ride,
    write_ride,
    lambda ride: f'{ride.scenario} {ride.track} {ride.seed}',
)
"""Runs the rides and keeps them."""


def _run_methods(
    ride: SimulatedRide, task: Task, about: Figures, methods: dict[str, Figures]
) -> None:
    config = CoasterConfig()
    reference = Reference.of(ride.truth, ride.design, ride.markers.time_s, ride.markers.position)
    about |= flat(floor_figures(reference), 'floor.')
    matches = {}
    if task.scenario == START_OFF:
        results = _run_off(ride, config, task.methods)
    else:
        results = run_methods(ride.imu, ride.design, config, task.methods)
    element_s = reproduce_midride.time_turned(ride.imu, reproduce_midride.ELEMENT_RAD)
    later = ride.markers.time_s >= element_s
    for result in results:
        duration_s = float(about['duration_s'])
        methods[result.name] = flat(figures(result, reference, duration_s))
        after = summary(reference.markers(result.trajectory).design[later])
        methods[result.name] |= flat(after, 'markers_after_element_m.')
        if result.match is not None:
            matches[result.name] = result.match
    if task.sweep:
        sweeps = coaster_sweeps.sweep(
            ride.imu, ride.design, config, matches, reference, lambda _: None
        )
        about |= flat(coaster_sweeps.as_figures(sweeps), 'sweep.')


def _run_off(
    ride: SimulatedRide, config: CoasterConfig, methods: Sequence[str]
) -> Iterator[MethodResult]:
    """Run the track filter with a start that is START_OFF_M off, as far as it is said unsure."""
    settings = override(config.track_filter, {'start_sigma_m': START_OFF_M})
    start_m = float(ride.design.chainage[0]) + START_OFF_M
    filtered = filter_ride(ride.imu, line_map(ride.design, settings), start_m, settings)
    outputs = {
        'track_filter': filtered.live,
        'track_filter_lag': filtered.lagged,
        'track_filter_smoothed': filtered.smoothed,
    }
    for name in methods:
        begin = time.perf_counter()
        trajectory = outputs[name]()
        runtime = {'filter': filtered.runtime_s, 'output': time.perf_counter() - begin}
        yield MethodResult(name, trajectory, None, None, filtered.rejected, runtime)

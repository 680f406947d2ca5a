"""The simulated runs behind ``reproduce maglev``: what is simulated, what estimates, figures."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import maglev_localization
import track_localization
from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import (
    BalisePassing,
    LoopPosition,
    Measurement,
    RadarSpeed,
)
from maglev_localization.methods import METHODS, run_methods
from track_localization.cli.exam_runs import Run, Task, keeper
from track_localization.cli.kept import Figures, flat
from track_localization.cli.maglev.reproduce_floor import linear_optimum, optimal
from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import at_times
from track_localization.evaluation.line_metrics import epoch_errors, line_figures, since
from track_localization.evaluation.metrics import present
from track_localization.evaluation.provenance import fingerprint
from track_localization.settings import override
from track_localization.sim.maglev import (
    MaglevSimConfig,
    SimulatedRun,
    scenario,
    simulate_maglev,
)

Array = NDArray[np.float64]

FLOORS = {'optimal': optimal, 'linear': linear_optimum}
"""Filters that are no methods, by name."""

SETTLED_S = 1.5
"""So long after its stamp even a balise that comes late is in the estimates: ``horizon_s`` [s]."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """
    One that takes part.

    Attributes:
        method: of METHODS, or of FLOORS.
        settings: told to it on top of the case's.
        balises: whether it hears them.
    """

    method: str
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    balises: bool = True


@dataclasses.dataclass(frozen=True)
class Case:
    """What is simulated, what all estimators are told of it, and which take part, by name."""

    scenario: str
    entries: Mapping[str, Entry]
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)


ALL = {name: Entry(name) for name in METHODS}
TWO = {name: Entry(name) for name in ('robust', 'kalman')}
MISSED_SETTINGS: Mapping[str, Any] = {
    'motion.jerk_density': 0.001,
    'loop.missed_share': 0.0014,
    'loop.slope_sigma': 1e-3,
    'radar.scale_sigma': 0.0005,
    'radar.slip_per_s': 0.0,
}
"""The train and the sensors of the paper's scenario with missed crossings."""
NO_FAULTS: Mapping[str, Any] = {
    'loop.burst_per_m': 0.0,
    'loop.noise_m': 0.001,
    'radar.outlier_share': 0.0,
    'radar.scale_walk': 0.0,
}
"""Further, that nothing else ever fails there."""

LINE, PAPER, MISSED = 'line', 'paper', 'paper_missed'
UNKNOWN, TOLD_WRONG, WRONG_ID, JUMP = 'startunknown', 'starttold', 'wrongid20', 'jumpbalise'
MULTI_MODAL = (WRONG_ID, UNKNOWN, JUMP)
DEAD = ('loopdead', 'loopfrozen', 'radardead', 'radarfrozen', 'balisedead')
FAULTS = (WRONG_ID, UNKNOWN, TOLD_WRONG, JUMP, *DEAD)

CASES: Mapping[str, Case] = {
    LINE: Case('line', ALL),
    **{name: Case(name, TWO) for name in (WRONG_ID, JUMP, *DEAD)},
    UNKNOWN: Case('startunknown', TWO, {'motion.start_known': False}),
    TOLD_WRONG: Case('startunknown', TWO),
    PAPER: Case(
        'paper',
        {
            'optimal': Entry('optimal'),
            'paper_1000': Entry('paper', {'particles': 1000}, balises=False),
            'paper_10000': Entry('paper', {'particles': 10000}, balises=False),
        },
    ),
    MISSED: Case(
        'paper_missed',
        {
            'paper_alone': Entry('paper', balises=False),
            'paper': Entry('paper'),
            'robust': Entry('robust', MISSED_SETTINGS),
            'robust_told': Entry('robust', {**MISSED_SETTINGS, **NO_FAULTS}),
            'robust_default': Entry('robust'),
            'linear': Entry('linear'),
        },
    ),
}
"""Everything that is examined; TOLD_WRONG takes the counter's first reading for the chainage."""


def run_task(task: Task) -> Run:
    """Simulate one run, estimate, return the figures; a failure is told, not raised."""
    case = CASES[task.case]
    simulation = scenario(case.scenario)
    entries: dict[str, Figures] = {}
    try:
        run = simulate_maglev(simulation, task.seed)
        for name in task.entries:
            begin = time.process_time()
            trajectory = estimate(run, simulation, case, case.entries[name])
            about = {'cpu_s': time.process_time() - begin, 'estimates': len(trajectory)}
            entries[name] = flat(about | figures(trajectory, run, _outage(simulation)))
    except (DataError, ArithmeticError, LookupError, ValueError) as error:
        failed = f'{type(error).__name__}: {error}'
        return Run(task.case, task.seed, {'failed': failed}, entries)
    return Run(task.case, task.seed, {'duration_s': run.duration_s}, entries)


def estimate(
    run: SimulatedRun, simulation: MaglevSimConfig, case: Case, entry: Entry
) -> Trajectory:
    """Return what one that takes part makes of a run."""
    if entry.method in FLOORS:
        return FLOORS[entry.method](run, simulation)
    config = override(MaglevConfig(), {**case.settings, **entry.settings})
    messages = list(measurements(run, entry.balises))
    length_m = simulation.line.length_m * simulation.line.sections
    (result,) = run_methods(messages, config, run.table, length_m, [entry.method])
    return result.trajectory


def measurements(run: SimulatedRun, balises: bool = True) -> Iterator[Measurement]:
    """Yield what the sensors of a run tell, in the order of arrival."""
    columns = {
        name: [column.tolist() for column in (s.time_s, s.value, s.variance)]
        for name, s in (('loop', run.loop), ('radar', run.radar), ('balise', run.balise))
    }
    for sensor, row in run.arrivals():
        time_s, value, variance = (column[row] for column in columns[sensor])
        if sensor == 'loop':
            yield LoopPosition(time_s, value, variance)
        elif sensor == 'radar':
            yield RadarSpeed(time_s, value, variance)
        elif balises:
            yield BalisePassing(time_s, run.balise.id[row], value, variance)


def figures(
    trajectory: Trajectory, run: SimulatedRun, outage: tuple[float, float] | None
) -> dict[str, Any]:
    """
    Return the figures of one estimate, ``since`` those from the arrival of the first balise on.

    ``outage`` is when a sensor was dead, stamps [s].
    """
    if not len(trajectory):
        return {}
    truth = run.truth()
    errors = epoch_errors(trajectory, truth)
    out = line_figures(errors)
    heard = [k for k, told in enumerate(run.balise.id) if run.table.index(told) is not None]
    if heard:
        out['since'] = line_figures(since(errors, float(run.balise.arrival_s[heard].min())))
    if outage is not None:
        out['outage'] = _around(trajectory, truth, outage, run.balise.time_s[heard])
    return present(out)


def _around(
    trajectory: Trajectory, truth: Trajectory, outage: tuple[float, float], balises_s: Array
) -> dict[str, float]:
    """
    Return how an estimate does while a sensor is dead, standing or not, and after the next balise.

    Where none of the balises heard (B,) comes later, there is nothing on what comes after.
    """
    s, sigma = at_times(truth, trajectory.time_s).chainage, trajectory.sigma_along
    assert s is not None
    assert sigma is not None
    error = trajectory.position[:, 0] - s
    during = (trajectory.time_s >= outage[0]) & (trajectory.time_s < outage[1]) & np.isfinite(s)
    if not during.any():
        return {}
    off = np.abs(error[during]) / sigma[during]
    out = {'share_inside': float(np.mean(off <= 3.0)), 'most_sigmas': float(off.max())}
    out['most_m'] = float(np.abs(error[during]).max())
    settled_s = balises_s[balises_s >= outage[1]] + SETTLED_S
    if len(settled_s) and trajectory.time_s[-1] >= settled_s[0]:
        k = int(np.searchsorted(trajectory.time_s, settled_s[0]))
        out |= {'after_m': abs(float(error[k])), 'after_sigma_m': float(sigma[k])}
    return out


def _outage(simulation: MaglevSimConfig) -> tuple[float, float] | None:
    """Return from when to when a sensor is dead, stamps [s]."""
    for sensor in (simulation.loop, simulation.radar, simulation.balise):
        if sensor.dead_for_s > 0.0:
            begin_s = simulation.clock.start_s + sensor.dead_from_s
            return begin_s, begin_s + sensor.dead_for_s
    return None


KEEPER = keeper(run_task)
"""Runs the tasks and keeps what they give."""


def code_fingerprint() -> str:
    """Return a hash of the code and settings that the figures depend on."""
    system = Path(maglev_localization.__file__).parent
    shared = Path(track_localization.__file__).parent
    here = shared / 'cli' / 'maglev'
    return fingerprint(
        [
            *(p for p in sorted(system.glob('*.py'))),
            *(shared / room for room in ('estimation', 'track', 'sim/maglev', 'cli/kept.py')),
            shared / 'cli' / 'exam_runs.py',
            *(shared / 'evaluation' / f'{n}.py' for n in ('metrics', 'line_metrics')),
            shared / 'evaluation' / 'interpolation.py',
            *(here / f'reproduce_{n}.py' for n in ('runs', 'floor')),
        ]
    )

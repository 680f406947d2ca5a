"""The maglev paper's Figures 2 to 6 and its claims beside ours, and what particles cost there."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_localization.config import MaglevConfig
from maglev_localization.methods import METHODS, run_methods
from track_localization.cli.common import guarded, say, seed_range
from track_localization.cli.kept import Figures, Keeper, read_figures, write_figures
from track_localization.cli.maglev import reproduce_runs
from track_localization.cli.maglev.reproduce_floor import optimal
from track_localization.cli.maglev.reproduce_runs import MISSED_SETTINGS, NO_FAULTS, measurements
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation import plots_maglev_paper, provenance
from track_localization.evaluation.interpolation import at_times
from track_localization.evaluation.plots_maglev_paper import Drive
from track_localization.evaluation.tabulate import Cell, Table
from track_localization.settings import override
from track_localization.sim.maglev import SimulatedRun, scenario, simulate_maglev

Array = NDArray[np.float64]

SEEDS = range(1000, 1200)
"""Seeds that nothing was tuned on."""

EARLY_S = 20.0
"""Before this the paper's error is small, its Figure 4 says; after that it grows [s]."""

CLAIMS: Mapping[str, tuple[str, str]] = {
    'early_m': (f'Fig. 4, no balises: error of the first {EARLY_S:g} s [m]', 'small'),
    'most_m': ('Fig. 4, no balises: greatest error [m]', '10, growing'),
    'speed_least': ('Fig. 5: speed error, least [m/s]', '-0.3'),
    'speed_most': ('Fig. 5: speed error, greatest [m/s]', '0.4'),
    'balises_early_m': ('Fig. 6: error up to the first balise [m]', 'as Fig. 4'),
    'balises_m': ('Fig. 6: greatest error after it [m]', '1'),
}
"""What the paper says, by figure: what it is of, and its value."""

STARTED_S = 1.0
"""From here on errors count: the first estimates are the first readings themselves [s]."""

COUNTS, FEEDBACKS = (100, 300, 1000, 3000, 10000), ('mean', 'mean_covariance')
LOST_M = 1.0


@dataclasses.dataclass(frozen=True)
class Loop:
    """A loop of the paper's scenario: which scenario it is, what robust and kalman are told."""

    scenario: str
    told: Mapping[str, Any]


LOOPS = {
    'absolute loop': Loop(
        'paper',
        {
            **MISSED_SETTINGS,
            **NO_FAULTS,
            'loop.pitch_m': 0.0,
            'loop.noise_m': 0.1,
            'loop.slope_sigma': 0.0,
            'loop.missed_share': 0.0,
        },
    ),
    'counter': Loop('paper_missed', MISSED_SETTINGS),
}
"""The loop as the paper's equations have it, and as one that misses 0.14 % of its crossings."""


@dataclasses.dataclass(frozen=True)
class Result:
    """Figures of one seed: by loop, method and claim (or by particles), and of the run itself."""

    seed: int
    about: Figures
    entries: Mapping[str, Figures]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what can be said of this part to a command line."""
    parser.add_argument(
        '--paper-seeds',
        type=seed_range,
        default=SEEDS,
        metavar='A:B',
        help=f"of the paper's scenarios ({SEEDS.start}:{SEEDS.stop})",
    )


def paper_tables(seeds: range, jobs: int, output: Path, reprint: bool = False) -> list[Table]:
    """
    Return the paper's claims beside ours, and what number of particles and feedback do.

    Draws ``fig2.png`` to ``fig6.png`` in ``output`` and keeps the runs' figures below it; with
    ``reprint`` those kept serve, whatever code made them.
    """
    results = KEEPER.gather(list(seeds), output / 'paper_runs', jobs, reprint, code_fingerprint())
    results.sort(key=lambda result: result.seed)
    draw(seeds[0], output)
    return [claims_table(results), particles_table(results)]


def run_seed(seed: int) -> Result:
    """Simulate one drive with either loop and return the figures of everything."""
    entries: dict[str, Figures] = {}
    for name, loop in LOOPS.items():
        run = simulate_maglev(scenario(loop.scenario), seed)
        for method in METHODS:
            alone, helped = (drive(run, loop, method, balises) for balises in (False, True))
            entries[f'{name}.{method}'] = figures(alone, helped, run)
    entries |= particle_figures(seed)
    return Result(seed, {}, entries)


def drive(run: SimulatedRun, loop: Loop, method: str, balises: bool) -> Drive:
    """Return what one method makes of a run, with or without its balises."""
    config = override(MaglevConfig(), {} if method == 'paper' else loop.told)
    length = scenario(loop.scenario).line.length_m
    messages = list(measurements(run, balises))
    (result,) = run_methods(messages, config, run.table, length, [method])
    return against(result.trajectory, run)


def against(estimate: Trajectory, run: SimulatedRun) -> Drive:
    """Return an estimate with its errors, from STARTED_S on."""
    estimate = estimate[estimate.time_s >= run.time_s[0] + STARTED_S]
    truth = at_times(run.truth(), estimate.time_s)
    assert estimate.chainage is not None
    assert estimate.speed is not None
    assert truth.chainage is not None
    assert truth.speed is not None
    return Drive(
        estimate.time_s - run.time_s[0],
        estimate.chainage,
        estimate.speed,
        estimate.chainage - truth.chainage,
        estimate.speed - truth.speed,
    )


def figures(alone: Drive, helped: Drive, run: SimulatedRun) -> Figures:
    """Return the figures of CLAIMS; those before a first balise are up to it."""
    first = float(run.balise.time_s[0] - run.time_s[0]) if len(run.balise) else np.inf
    before = helped.time_s < first
    return {
        'early_m': _most(alone.error[alone.time_s <= EARLY_S]),
        'most_m': _most(alone.error),
        'speed_least': float(alone.speed_error.min()),
        'speed_most': float(alone.speed_error.max()),
        'balises_early_m': _most(helped.error[before]),
        'balises_m': _most(helped.error[~before]),
    }


def particle_figures(seed: int) -> dict[str, Figures]:
    """Return the mean squares of errors by particles and feedback, absolute loop, no balises."""
    simulation = scenario('paper')
    run = simulate_maglev(simulation, seed)
    messages = list(measurements(run, balises=False))
    out = {'optimal': _squares(against(optimal(run, simulation), run))}
    for feedback in FEEDBACKS:
        for count in COUNTS:
            settings = {'particles': count, 'seed': seed, 'paper.feedback': feedback}
            config = override(MaglevConfig(), settings)
            (result,) = run_methods(messages, config, run.table, methods=['paper'])
            out[f'{feedback}.{count}'] = _squares(against(result.trajectory, run))
    return out


def claims_table(results: Sequence[Result]) -> Table:
    """Return what the paper says beside the median over runs, and the worst run."""
    rows: list[tuple[Cell, ...]] = []
    for claim, (what, paper) in CLAIMS.items():
        row: list[Cell] = [what, paper]
        for loop in LOOPS:
            for method in METHODS:
                values = np.array([float(r.entries[f'{loop}.{method}'][claim]) for r in results])
                worst = values[np.argmax(np.abs(values))]
                row.append(f'{np.median(values):.2f} ({worst:.2f})')
        rows.append(tuple(row))
    columns = [f'{loop}: {method}' for loop in LOOPS for method in METHODS]
    title = (
        f"The paper's claims and ours, {len(results)} runs: median (worst run); the counter misses "
        '0.14 % of the crossings'
    )
    return Table(title, ('', 'paper', *columns), rows)


def particles_table(results: Sequence[Result]) -> Table:
    """Return the paper's method over the optimal Kalman filter by particles and feedback."""

    def rms(entry: str, figure: str) -> float:
        return float(np.sqrt(np.mean([float(r.entries[entry][figure]) for r in results])))

    best = {figure: rms('optimal', figure) for figure in ('place', 'speed')}
    rows: list[tuple[Cell, ...]] = [
        ('optimal Kalman filter', None, best['place'], best['speed'], '1', '1', '0')
    ]
    for feedback in FEEDBACKS:
        for count in COUNTS:
            name = f'{feedback}.{count}'
            place, speed = rms(name, 'place'), rms(name, 'speed')
            lost = sum(float(r.entries[name]['most']) > LOST_M for r in results)
            over = (f'{place / best["place"]:.4f}', f'{speed / best["speed"]:.4f}')
            rows.append((feedback, count, place, speed, *over, f'{lost}'))
    title = (
        f"Feedback and particles: RMSE of the paper's method on its scenario, {len(results)} runs, "
        f'absolute loop, no balises; lost: an error beyond {LOST_M:g} m'
    )
    columns = ('feedback', 'particles', 'place [m]', 'speed [m/s]')
    return Table(title, (*columns, 'place, ratio', 'speed, ratio', 'lost'), rows)


def draw(seed: int, folder: Path) -> list[Path]:
    """Draw the paper's figures of one seed: each loop in a panel of its own."""
    alone: dict[str, dict[str, Drive]] = {}
    helped: dict[str, dict[str, Drive]] = {}
    balises = {}
    for name, loop in LOOPS.items():
        run = simulate_maglev(scenario(loop.scenario), seed)
        alone[name] = {method: drive(run, loop, method, False) for method in METHODS}
        helped[name] = {method: drive(run, loop, method, True) for method in METHODS}
        balises[name] = run.balise.time_s - run.time_s[0]
        truth = (run.time_s - run.time_s[0], run.chainage, run.speed)
    folder.mkdir(parents=True, exist_ok=True)
    return plots_maglev_paper.figures_2_to_6(folder, alone, helped, balises, truth)


def read_result(path: Path, seed: int, code: str | None) -> Result | None:
    """Return a kept result, or None where there is none that serves."""
    found = read_figures(path, code)
    return None if found is None else Result(seed, *found)


def write_result(path: Path, result: Result, code: str) -> None:
    """Keep a result."""
    write_figures(path, result.about, result.entries, code)


KEEPER: Keeper[int, Result] = Keeper(
    'drives',
    run_seed,
    lambda seed: f'{seed}.csv',
    read_result,
    write_result,
    lambda result: str(result.seed),
)
"""Runs the seeds and keeps what they give."""


def code_fingerprint() -> str:
    """Return a hash of the code and settings that the figures depend on."""
    return provenance.fingerprint([Path(__file__)]) + reproduce_runs.code_fingerprint()


def main(argv: Sequence[str] | None = None) -> int:
    """Print this part alone; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_arguments(parser)
    parser.add_argument('--jobs', type=int, default=2, help='worker processes (2)')
    parser.add_argument('--output', type=Path, default=Path('reproduce', 'maglev'), metavar='DIR')
    args = parser.parse_args(argv)

    def run() -> None:
        for table in paper_tables(args.paper_seeds, args.jobs, args.output):
            print(table.text(), end='\n\n')
        say(f'figures in {args.output}')

    return guarded(run)


def _most(error: Array) -> float:
    return float(np.abs(error).max()) if len(error) else float('nan')


def _squares(found: Drive) -> Figures:
    return {
        'place': float(np.mean(found.error**2)),
        'speed': float(np.mean(found.speed_error**2)),
        'most': _most(found.error),
    }


if __name__ == '__main__':
    raise SystemExit(main())

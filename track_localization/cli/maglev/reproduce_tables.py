"""What the runs of ``reproduce maglev`` come to, as tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from track_localization.cli.exam_runs import Run
from track_localization.cli.maglev.reproduce_runs import (
    CASES,
    DEAD,
    FAULTS,
    LINE,
    MISSED,
    PAPER,
    TOLD_WRONG,
    UNKNOWN,
)
from track_localization.evaluation.tabulate import Cell, Table

Array = NDArray[np.float64]

NAN, INF = float('nan'), float('inf')

RMSE, MOST, INSIDE, NEES = 'position_m.rmse', 'position_m.max', 'inside_2_sigma', 'nees_mean'
SINCE = 'since.'
"""Before the figures from the first balise on."""

LOST_M = 1.0
"""A run of the paper's scenario with an error beyond this, ten sigmas of the loop, is lost [m]."""
FOUND_M = 0.5
"""An error within this, or 2 sigma, after a balise: the train is found again [m]."""


class Runs:
    """Runs of one case, and statistics over them."""

    def __init__(self, runs: Sequence[Run]) -> None:
        self.all = [run for run in runs if 'failed' not in run.about]

    def values(self, entry: str, figure: str) -> Array:
        """Return a figure of every run in which ``entry`` took part; infinite where it has none."""
        taken = (run.entries[entry] for run in self.all if entry in run.entries)
        return np.array([float(figures.get(figure, INF)) for figures in taken], dtype=np.float64)

    def known(self, entry: str, figure: str) -> Array:
        """Return the same of those runs only that have it."""
        values = self.values(entry, figure)
        return values[np.isfinite(values)]

    def median(self, entry: str, figure: str) -> float:
        """Return the median over runs; NaN without any."""
        return _of(np.median, self.values(entry, figure))

    def mean(self, entry: str, figure: str) -> float:
        """Return the mean over runs; NaN without any."""
        return _of(np.mean, self.values(entry, figure))

    def worst(self, entry: str, figure: str) -> float:
        """Return the greatest over runs; NaN without any."""
        return _of(np.max, self.values(entry, figure))

    def pooled(self, entry: str, figure: str) -> float:
        """Return the root of the mean square over runs; NaN without any."""
        return _of(lambda values: np.sqrt(np.mean(values**2)), self.values(entry, figure))

    def share(self, entry: str, figure: str, limit: float) -> float:
        """Return the share of runs whose figure is within a limit; NaN without any."""
        return _of(np.mean, (self.values(entry, figure) <= limit).astype(np.float64))

    def times_real_time(self, entry: str) -> float:
        """Return how much faster than the train it was by processor time, median over runs."""
        times = [
            float(run.about['duration_s']) / float(run.entries[entry]['cpu_s'])
            for run in self.all
            if entry in run.entries
        ]
        return _of(np.median, np.array(times))


Exam = Mapping[str, Runs]
"""The runs of each case of CASES."""


def exam_of(runs: Sequence[Run]) -> Exam:
    """Return runs by case; every case is there."""
    return {case: Runs([run for run in runs if run.case == case]) for case in CASES}


def judged_by(case: str) -> str:
    """Return the figure by which methods are compared: no start is known before a balise tells."""
    return SINCE + RMSE if case in (UNKNOWN, TOLD_WRONG) else RMSE


def ratio(runs: Runs, statistic: Callable[[Runs, str], float]) -> float:
    """Return the figure of ``robust`` over that of ``kalman``; NaN where one is missing."""
    robust, kalman = statistic(runs, 'robust'), statistic(runs, 'kalman')
    return robust / kalman if kalman > 0.0 else NAN


def medians(case: str) -> Callable[[Runs, str], float]:
    """Return how to take the median of the figure that judges a case."""
    return lambda runs, entry: runs.median(entry, judged_by(case))


def worsts(case: str) -> Callable[[Runs, str], float]:
    """Return how to take the worst run's."""
    return lambda runs, entry: runs.worst(entry, judged_by(case))


def line_table(exam: Exam) -> Table:
    """Return every method on the line with the usual faults."""
    runs = exam[LINE]
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            runs.median(name, RMSE),
            runs.worst(name, RMSE),
            runs.median(name, SINCE + RMSE),
            runs.worst(name, SINCE + RMSE),
            runs.worst(name, SINCE + MOST),
            100.0 * runs.mean(name, INSIDE),
            100.0 * runs.mean(name, SINCE + INSIDE),
            runs.mean(name, NEES),
            runs.mean(name, SINCE + NEES),
            runs.median(name, 'speed_mps.rmse'),
            runs.times_real_time(name),
        )
        for name in CASES[LINE].entries
        if len(runs.values(name, RMSE))
    ]
    columns = (
        *('method', 'RMSE: median', 'worst run', 'after a balise: median', 'worst run'),
        *('greatest error', 'in 2 sigma [%]', 'after a balise [%]', 'NEES', 'after a balise'),
        *('speed RMSE [m/s]', 'x real time'),
    )
    title = f'Scenario line, {len(runs.all)} runs: errors of the place [m] while the train moves'
    return Table(title, columns, rows)


def faults_table(exam: Exam) -> Table:
    """Return robust beside kalman where posteriors have several modes or sensors fail."""
    rows: list[tuple[Cell, ...]] = []
    for case in (LINE, *FAULTS):
        runs, figure = exam[case], judged_by(case)
        if not runs.all:
            continue
        both = [
            value
            for name in ('robust', 'kalman')
            for value in (runs.median(name, figure), runs.worst(name, figure))
        ]
        inside = 100.0 * runs.mean('robust', figure.replace(RMSE, INSIDE))
        rows.append(
            (
                case,
                len(runs.all),
                *both,
                ratio(runs, medians(case)),
                ratio(runs, worsts(case)),
                inside,
            )
        )
    columns = (
        *('scenario', 'runs', 'robust: median', 'worst', 'kalman: median', 'worst'),
        *('ratio of medians', 'of worst', 'robust in 2 sigma [%]'),
    )
    title = (
        f'RMSE [m] of robust beside kalman; {UNKNOWN} and {TOLD_WRONG}: from the first balise on'
    )
    return Table(title, columns, rows)


def dead_table(exam: Exam) -> Table:
    """Return how robust and kalman do while a sensor is dead for a minute, and after that."""
    rows: list[tuple[Cell, ...]] = []
    for case in DEAD:
        for name in ('robust', 'kalman'):
            runs = exam[case]
            if len(runs.values(name, RMSE)):
                after = runs.known(name, 'outage.after_m')
                rows.append(
                    (
                        case,
                        name,
                        runs.median(name, 'outage.most_m'),
                        runs.worst(name, 'outage.most_m'),
                        100.0 * runs.mean(name, 'outage.share_inside'),
                        runs.worst(name, 'outage.most_sigmas'),
                        100.0 * runs.share(name, 'outage.most_sigmas', 3.0),
                        _of(np.max, after),
                        f'{int(recovered(runs, name).sum())} of {len(after)}',
                    )
                )
    columns = (
        *('scenario', 'method', 'greatest error: median', 'worst run', 'in 3 sigma [% of time]'),
        *('most sigmas', 'runs always in 3 sigma [%]', 'error after the next balise: worst'),
        'found again',
    )
    return Table('A sensor dead for 60 s: error of the place [m]', columns, rows)


def recovered(runs: Runs, entry: str) -> NDArray[np.bool_]:
    """Return for each run with a balise after the outage whether the train is found again."""
    error, sigma = (runs.known(entry, f'outage.{n}') for n in ('after_m', 'after_sigma_m'))
    found: NDArray[np.bool_] = (error <= FOUND_M) | (error <= 2.0 * sigma)
    return found


def optimum_table(exam: Exam) -> Table:
    """Return the paper's method beside the optimum on the paper's scenario."""
    runs = exam[PAPER]
    rows: list[tuple[Cell, ...]] = []
    for name in CASES[PAPER].entries:
        if len(runs.values(name, RMSE)):
            place, speed = (runs.pooled(name, f) for f in (RMSE, 'speed_mps.rmse'))
            best = runs.pooled('optimal', RMSE)
            share = place / best if best > 0.0 else NAN
            rows.append((name, place, share, speed, runs.worst(name, MOST), lost(runs, name)))
    columns = ('', 'RMSE [m]', 'over the optimum', 'speed RMSE [m/s]', 'greatest [m]', 'runs lost')
    title = (
        f"The paper's scenario, {len(runs.all)} runs, absolute loop, no balises; a number is that "
        f'of particles, optimal the Kalman filter; lost: beyond {LOST_M:g} m'
    )
    return Table(title, columns, rows)


def lost(runs: Runs, entry: str) -> int:
    """Return how many runs of the paper's scenario are lost."""
    return int((runs.values(entry, MOST) > LOST_M).sum())


MISSED_ROWS = {
    'paper_alone': 'paper, without balises',
    'paper': 'paper',
    'robust_default': 'robust, default settings',
    'robust': 'robust, told train, radar and share of misses',
    'robust_told': 'robust, told further that nothing else fails',
    'linear': 'best linear filter, told everything',
}
"""Entries of MISSED, and what they are."""


def missed_table(exam: Exam) -> Table:
    """Return what is made of a counter that misses crossings."""
    runs = exam[MISSED]
    rows: list[tuple[Cell, ...]] = []
    for name, what in MISSED_ROWS.items():
        figure = MOST if name == 'paper_alone' else SINCE + MOST
        values = runs.values(name, figure)
        if len(values):
            rmse = runs.pooled(name, figure.replace(MOST, RMSE))
            speed = runs.median(name, 'speed_mps.max')
            below = 100.0 * runs.share(name, figure, 1.0)
            rows.append((what, rmse, float(np.median(values)), float(values.max()), below, speed))
    columns = (
        *('', 'RMSE', 'greatest of a run: median', 'worst run', 'runs within 1 m [%]'),
        'greatest speed error: median [m/s]',
    )
    title = (
        f'The loop as a counter that misses 0.14 % of the crossings, {len(runs.all)} runs: error '
        'of the place [m], from the first balise on where there are balises'
    )
    return Table(title, columns, rows)


def _of(statistic: Callable[[Array], np.floating | float], values: Array) -> float:
    return float(statistic(values)) if len(values) else NAN

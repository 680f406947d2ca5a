"""What the runs of ``reproduce train`` come to, as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from track_localization.cli.exam_runs import Run
from track_localization.cli.train.reproduce_runs import (
    CASES,
    ENTRIES,
    FLOOR,
)
from track_localization.evaluation.tabulate import Cell, Table

Array = NDArray[np.float64]

NAN, INF = float('nan'), float('inf')

MOST, END = 'outage.max_m.max', 'outage.end_m.max'
"""Greatest level error in a run's outages, and at the end of one [m]."""
PLACES = {'open_sky': 'with fixes', 'outage': 'in outages'}
HONESTY = {
    'inside_2_sigma': 'position in 2 sigma [%]',
    'velocity_inside_2_sigma': 'velocity in 2 sigma [%]',
    'nees_position_over_3': 'NEES / 3',
    'nees_velocity_over_3': 'velocity NEES / 3',
}


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
        return quantile(self.values(entry, figure), 0.5)

    def p95(self, entry: str, figure: str) -> float:
        """Return the 95th percentile over runs; NaN without any."""
        return quantile(self.values(entry, figure), 0.95)

    def mean(self, entry: str, figure: str) -> float:
        """Return the mean over the runs that have it; NaN without any."""
        known = self.known(entry, figure)
        return float(known.mean()) if len(known) else NAN

    def worst(self, entry: str, figure: str) -> float:
        """Return the greatest over runs; NaN without any."""
        values = self.values(entry, figure)
        return float(values.max()) if len(values) else NAN

    def share(self, entry: str, figure: str, limit: float) -> float:
        """Return the share of runs whose figure is within a limit; NaN without any."""
        values = self.values(entry, figure)
        return float(np.mean(values <= limit)) if len(values) else NAN

    def floor(self, entry: str) -> Array:
        """Return what the best estimator has in place of ``entry``'s MOST, (draws, runs) [m]."""
        taken = [run.entries[FLOOR] for run in self.all if FLOOR in run.entries]
        drawn = [[float(v) for n, v in f.items() if n.startswith(f'{entry}.')] for f in taken]
        return (
            np.array(drawn, dtype=np.float64).reshape(len(taken), -1).T
            if taken
            else np.zeros((0, 0))
        )

    def about(self, name: str) -> Array:
        """Return a number of every run itself, where it has it."""
        return np.array([float(run.about[name]) for run in self.all if name in run.about])

    def times_real_time(self, entry: str) -> float:
        """Return how much faster than the train it was by processor time, median over runs."""
        times = [
            float(run.about['duration_s']) / float(run.entries[entry]['runtime_s'])
            for run in self.all
            if entry in run.entries
        ]
        return quantile(np.array(times), 0.5)


Exam = Mapping[str, Runs]
"""The runs of each case of CASES."""


def exam_of(runs: Sequence[Run]) -> Exam:
    """Return runs by case; every case is there."""
    return {case: Runs([run for run in runs if run.case == case]) for case in CASES}


def quantile(values: Array, share: float) -> float:
    """Return a quantile of values that may be infinite; NaN without any."""
    if not len(values):
        return NAN
    if np.isfinite(values).all():
        return float(np.quantile(values, share))
    return float(np.quantile(values, share, method='higher'))


def outage_table(exam: Exam) -> Table:
    """Return the level errors in the outages, every case and entry."""
    rows: list[tuple[Cell, ...]] = []
    for case, runs in exam.items():
        floor = runs.about('floor_m')
        if len(floor):
            rows.append((case, 'fix before', len(floor), *_spread(floor), *[None] * 6))
        rows += [
            (
                case,
                entry,
                len(runs.values(entry, MOST)),
                runs.median(entry, MOST),
                runs.p95(entry, MOST),
                runs.worst(entry, MOST),
                runs.median(entry, END),
                runs.p95(entry, END),
                *(_first(runs, entry, name) for name in ('entry_m', 'along_max_m', 'cross_max_m')),
                runs.median(entry, 'horizontal_m.median'),
            )
            for entry in ENTRIES
            if len(runs.values(entry, MOST))
        ]
    columns = (
        *('scenario', 'method', 'runs', 'max: median', '95 %', 'worst', 'end: median', '95 %'),
        *('at entry: median', 'along, max: median', 'across, max: median', 'whole run: median'),
    )
    return Table('Level error in the outage [m]', columns, rows)


def floor_table(exam: Exam) -> Table:
    """Return the greatest errors of the best estimators there can be, and of ours."""
    rows: list[tuple[Cell, ...]] = []
    for case, runs in exam.items():
        for entry in ENTRIES:
            best, untold = runs.floor(entry), runs.floor(f'untold.{entry}')
            if best.size:
                row: list[Cell] = [case, entry, best.size]
                for values in (best.ravel(), untold.ravel(), runs.values(entry, MOST)):
                    row += [quantile(values, 0.5), quantile(values, 0.95)]
                rows.append(tuple(row))
    columns = ['scenario', 'in place of', 'drawn', 'told all: median', '95 %']
    columns += ['not scale and map: median', '95 %', 'ours: median', '95 %']
    return Table('Best there can be: greatest level error in the outage [m]', columns, rows)


def honesty_table(exam: Exam) -> Table:
    """Return what sigma is worth, with fixes and in outages: means over runs."""
    rows: list[tuple[Cell, ...]] = []
    for case, runs in exam.items():
        for entry in ENTRIES:
            if not len(runs.values(entry, MOST)):
                continue
            row: list[Cell] = [case, entry]
            for place in PLACES:
                for name in HONESTY:
                    scale = 100.0 if name.endswith('sigma') else 1.0
                    row.append(scale * runs.mean(entry, f'{place}.{name}'))
            rows.append(tuple(row))
    columns = ['scenario', 'method']
    columns += [f'{where}: {title}' for where in PLACES.values() for title in HONESTY.values()]
    return Table('What sigma is worth; an honest one gives 95.4 % and 1', columns, rows)


def speed_table(exam: Exam) -> Table:
    """Return how much faster than the train each entry is, by processor time."""
    cases = [case for case, runs in exam.items() if runs.all]
    rows: list[tuple[Cell, ...]] = [
        (entry, *(exam[case].times_real_time(entry) for case in cases))
        for entry in ENTRIES
        if any(len(exam[case].values(entry, 'runtime_s')) for case in cases)
    ]
    return Table('Times real time, medians', ('method', *cases), rows)


def _spread(values: Array) -> tuple[float, float, float]:
    return float(np.median(values)), quantile(values, 0.95), float(values.max())


def _first(runs: Runs, entry: str, name: str) -> float:
    """Return the median over runs of a figure of their first outage."""
    return quantile(runs.known(entry, f'outages.0.{name}'), 0.5)

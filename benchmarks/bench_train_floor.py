"""
What fixes are worth to the train: ``robust``, and the best there can be, as fixes err otherwise.

The greatest level error in the outage of the scenario ``paper``, median and 95 %. With seeds A:B as
argument along more lines than the few that tell only that it works.
"""

from __future__ import annotations

import sys

import numpy as np

from track_localization.cli.common import seed_range
from track_localization.cli.train.reproduce_floor import DRAWS, TOLD, floor_errors, greatest
from track_localization.cli.train.reproduce_runs import CASES, figures, results
from track_localization.evaluation.tabulate import Table
from track_localization.settings import override
from track_localization.sim.train import TrainSimConfig, scenario, simulate_train

FEW = range(1, 7)
FIXES = {
    'as they are: 0.8 m, 200 to 600 s': {},
    'slow error 0.64 m (1 m rms in all)': {'gnss.drift_m': 0.64},
    'slow error over 60 to 100 s': {'gnss.drift_s': (60.0, 100.0)},
    'slow error over 1000 to 2000 s': {'gnss.drift_s': (1000.0, 2000.0)},
}


def greatest_errors(config: TrainSimConfig, seed: int) -> tuple[float, np.ndarray]:
    """Return the greatest level error in the outage [m] of ``robust`` and of the best (draws,)."""
    run = simulate_train(config, seed)
    ((_, result),) = results(run, CASES['paper'], ('robust',))
    time_s, errors = floor_errors(run, config, np.random.default_rng(seed), DRAWS, False, TOLD)
    ours = figures(result, run)['outage']['max_m']['max']
    return ours, greatest(time_s, errors.filtered, run.outages[0])


def main() -> None:
    """Print the table."""
    seeds = seed_range(sys.argv[1]) if sys.argv[1:] else FEW
    rows = []
    for name, settings in FIXES.items():
        config = override(scenario('paper'), settings)
        found = [greatest_errors(config, seed) for seed in seeds]
        row = [name]
        for values in ([ours for ours, _ in found], np.concatenate([best for _, best in found])):
            row += np.quantile(values, (0.5, 0.95)).tolist()
        rows.append(row)
    columns = ('fixes', 'robust: median', '95 %', 'best there can be: median', '95 %')
    title = f'greatest level error in the outage [m], seeds {seeds.start} to {seeds.stop - 1}'
    print(Table(title, columns, rows).text())


if __name__ == '__main__':
    main()

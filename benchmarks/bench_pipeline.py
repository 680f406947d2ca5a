"""
Cost of the coaster's filter: per IMU sample, and per method against real time.

Figures are medians over rides on this machine, as it is loaded now; compare them only with others
of the same run.
"""

from __future__ import annotations

import statistics
import time

from coaster_localization.config import CoasterConfig, EskfConfig
from coaster_localization.methods import METHODS, observations, run_methods
from coaster_localization.pipeline import CoasterEskf
from coaster_localization.smoothing import run_filter
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_filter import CoasterTrackFilter
from coaster_localization.track_map import line_map
from track_localization.estimation.imu import clean
from track_localization.evaluation.tabulate import Table
from track_localization.sim.coaster import SimulatedRide, scenario, simulate_coaster

RUNS = 3
"""Of each ride; the fastest counts, as others are slowed by what else the machine does."""


def method_table(rides: list[SimulatedRide]) -> Table:
    """Return the run time of every method, each with what it is fed by."""
    times: dict[str, list[float]] = {}
    for ride in rides:
        imu, _ = clean(ride.imu)
        length = float(imu.time_s[-1] - imu.time_s[0])
        fastest = dict.fromkeys(METHODS, 0.0)
        for _ in range(RUNS):
            for result in run_methods(imu, ride.design, CoasterConfig(), METHODS):
                factor = length / sum(result.runtime_s.values())
                fastest[result.name] = max(fastest[result.name], factor)
        for name, factor in fastest.items():
            times.setdefault(name, []).append(factor)
    rows = [[name, round(statistics.median(factors))] for name, factors in times.items()]
    return Table('Whole rides at 100 Hz, after warm-up', ['method', 'x real time'], rows)


def step_table(ride: SimulatedRide) -> Table:
    """Return the filter's cost per IMU sample, without and with matches."""
    imu, _ = clean(ride.imu)
    result = next(run_methods(imu, ride.design, CoasterConfig(), ['dtw_penalised']))
    assert result.match is not None
    rows: list[list[str | float]] = []
    for label, feed in (
        ('IMU only', []),
        ('with 5 matches a second', observations(result.match, 5)),
    ):
        filter_ = CoasterEskf(ride.design, EskfConfig())
        begin = time.perf_counter()
        run_filter(filter_, imu, feed)
        rows.append(['ESKF, ' + label, 1e6 * (time.perf_counter() - begin) / len(imu)])
    line = line_map(ride.design, TrackFilterConfig())
    track = CoasterTrackFilter(line, float(ride.design.chainage[0]), TrackFilterConfig())
    begin = time.perf_counter()
    for i in range(len(imu)):
        track.push(imu.sample(i))
    rows.append(['track filter', 1e6 * (time.perf_counter() - begin) / len(imu)])
    return Table('Filters, per IMU sample', ['', 'us'], rows)


def main() -> None:
    """Print both tables."""
    rides = [simulate_coaster('looping', scenario('nominal'), seed) for seed in (1, 2)]
    warm = rides[0]
    for _ in run_methods(clean(warm.imu)[0], warm.design, CoasterConfig(), METHODS):
        pass
    print(step_table(rides[0]).text(), '\n', method_table(rides).text(), sep='\n')


if __name__ == '__main__':
    main()

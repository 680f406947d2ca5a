"""
Cost of the maglev's methods: per message, a line of two hours against real time, memory in time.

Times are processor times, so that other work on the machine counts little. The radar's 20 Hz and
the loop's 50 Hz make 70 messages a second.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Sequence

import numpy as np

from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import Measurement
from maglev_localization.methods import METHODS
from maglev_localization.pipeline import MaglevPipeline
from track_localization.cli.maglev.reproduce_runs import measurements
from track_localization.evaluation.tabulate import Table
from track_localization.settings import override
from track_localization.sim.maglev import SimulatedRun, scenario, simulate_maglev

PARTICLES = 1000
GOAL = 100.0
"""Times real time that a line of two hours must be evaluated at."""
MEASURED, EVERY = 60000, 500
"""Memory is looked at in the first so many messages, after every so many."""
WARM = 2000


def pipeline_of(method: str, run: SimulatedRun, length_m: float) -> MaglevPipeline:
    """Return a pipeline of a method with its default settings, at PARTICLES."""
    config = override(MaglevConfig(), {'method': method, 'particles': PARTICLES})
    return MaglevPipeline(config, run.table, length_m)


def seconds(pipeline: MaglevPipeline, messages: Sequence[Measurement]) -> tuple[float, int]:
    """Return the processor time that it takes [s], and how many estimates came of it."""
    begin, count = time.process_time(), 0
    for message in messages:
        count += len(pipeline.push(message))
    return time.process_time() - begin, count


def cost_table(name: str, methods: Sequence[str]) -> Table:
    """Return what each method costs on a run of a scenario."""
    simulation = scenario(name)
    run = simulate_maglev(simulation, 1)
    length_m = simulation.line.length_m * simulation.line.sections
    messages = list(measurements(run))
    rows = []
    for method in methods:
        seconds(pipeline_of(method, run, length_m), messages[:WARM])
        spent, estimates = seconds(pipeline_of(method, run, length_m), messages)
        factor = run.duration_s / spent
        met = 'met' if factor >= GOAL else 'NOT met'
        rows.append((method, estimates, 1e6 * spent / len(messages), factor, met))
    columns = ('method', 'estimates', 'us a message', 'x real time', f'goal >= {GOAL:g}')
    title = f'Scenario {name}: {run.duration_s / 3600.0:.2f} h, {len(messages)} messages'
    return Table(f'{title}, N = {PARTICLES}', columns, rows)


def memory_table(methods: Sequence[str]) -> Table:
    """Return what each method holds in each quarter of a stretch of line, in kB."""
    simulation = scenario('long')
    run = simulate_maglev(simulation, 1)
    messages = list(measurements(run))[:MEASURED]
    rows = []
    for method in methods:
        pipeline = pipeline_of(method, run, simulation.line.length_m * simulation.line.sections)
        seconds(pipeline, messages[:WARM])  # compiles what is compiled
        pipeline.reset()
        tracemalloc.start()
        held = []
        for begin in range(0, len(messages), EVERY):
            seconds(pipeline, messages[begin : begin + EVERY])
            held.append(tracemalloc.get_traced_memory()[0] / 1024.0)
        tracemalloc.stop()
        quarters = [float(part.mean()) for part in np.array_split(np.array(held), 4)]
        rows.append((method, *quarters, max(held)))
    columns = ('method', *(f'quarter {k + 1}' for k in range(4)), 'most')
    title = f'Memory held, mean of each quarter of {len(messages)} messages on the long line [kB]'
    return Table(title, columns, rows)


def main() -> None:
    """Print the tables."""
    print(cost_table('line', METHODS).text(), end='\n\n')
    print(cost_table('long', METHODS).text(), end='\n\n')
    print(memory_table(METHODS).text())


if __name__ == '__main__':
    main()

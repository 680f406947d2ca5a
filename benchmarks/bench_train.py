"""
Cost of the train's methods: an hour of line against real time, and ``train_kf`` as it runs.

Processor time, so that other work on the machine counts little. The IMU's 100 Hz, the odometer's
10 and the receiver's fix and quality make 112 messages a second. The node is a process of its own;
``sensor_publisher`` sends it the messages of a bag in real time over DDS.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from pathlib import Path

from bench_nodes import BIN, cpu_s, start

from track_localization.cli.train.reproduce_runs import measurements
from track_localization.evaluation.tabulate import Table
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.track.centreline import Centreline
from train_localization.config import METHODS, TrainConfig
from train_localization.pipeline import TrainPipeline

GOAL = 200.0
"""Times real time that an hour of line is to be evaluated at."""
LEGS = 10
"""Between stations; about an hour."""
WARM = 15000
PER_S = 112.0
SETTLE_S, MEASURED_S = 15.0, 25.0
"""Of the node's run: before and in what is measured."""


def hour_table() -> Table:
    """Return what each method costs on a line with tunnels, stations and slip."""
    run = simulate_train(override(scenario('line'), {'motion.legs': LEGS}), 1)
    assert run.track is not None
    track, messages = Centreline.from_track(run.track), list(measurements(run))
    lasted = float(run.time_s[-1] - run.time_s[0])
    rows = []
    for method in METHODS:
        config = override(TrainConfig(), {'method': method})
        line = track if method == 'robust_map' else None
        warm = TrainPipeline(config, line, run.datum)
        for message in messages[:WARM]:
            warm.push(message)
        pipeline, count, begin = TrainPipeline(config, line, run.datum), 0, time.process_time()
        for message in messages:
            count += len(pipeline.push(message))
        spent = time.process_time() - begin
        met = 'met' if lasted / spent >= GOAL else 'NOT met'
        rows.append((method, count, 1e6 * spent / len(messages), lasted / spent, met))
    columns = ('method', 'estimates', 'us a message', 'x real time', f'goal >= {GOAL:g}')
    return Table(f'{lasted / 3600.0:.2f} h of line, {len(messages)} messages', columns, rows)


def node_table(folder: Path) -> Table:
    """Return what the node costs while a recording is sent to it in real time."""
    simulate = [str(BIN / 'simulate'), 'train', '--scenario', 'paper', '--seed', '1']
    subprocess.run([*simulate, '--output', str(folder)], check=True, stdout=subprocess.DEVNULL)
    rows = []
    for method in ('robust', 'robust_map'):
        given = [f'datum.file:={folder}/datum.yaml', f'method:={method}']
        given += [f'track:={folder}/track.csv'] if method == 'robust_map' else []
        node = start('train_kf', *given)
        sender = start('sensor_publisher', f'source:={folder}/bag', 'wait_timeout:=60.0')
        try:
            time.sleep(SETTLE_S)
            before, begin = [cpu_s(p) for p in (node, sender)], time.monotonic()
            time.sleep(MEASURED_S)
            used = [cpu_s(p) - b for p, b in zip((node, sender), before, strict=True)]
            wall = time.monotonic() - begin
        finally:
            for process in (sender, node):
                process.terminate()
                process.wait()
        rows.append((method, 100.0 * used[0] / wall, 1e6 * used[0] / wall / PER_S))
    columns = ('method', '% of a core', 'us a message')
    return Table(f'train_kf in real time over DDS, {PER_S:g} messages a second', columns, rows)


def main() -> None:
    """Print the tables."""
    os.environ.setdefault('ROS_DOMAIN_ID', '97')
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    print(hour_table().text(), end='\n\n', flush=True)
    with tempfile.TemporaryDirectory() as folder:
        print(node_table(Path(folder)).text())


if __name__ == '__main__':
    main()

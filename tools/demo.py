"""
The demo: a recorded ride, ROS 2 nodes that locate its train live in two ways, and the evaluation.

Simulates a ride into a bag, starts ``srdtw_matcher`` and ``coaster_eskf``, beside them
``coaster_track_filter`` in a namespace of its own, and a recorder, each as a process, replays the
bag into them over DDS, and compares what the nodes published with the ride's truth; then runs
``evaluate`` on the same bag. Everything is left under ``demo/``.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

BIN = Path(sys.executable).parent
TRACK_FILTER = 'track_filter'
"""Namespace of the track filter: the names of its topics are the ESKF's."""
LIVE = {
    'ESKF': 'odometry',
    'track filter': f'{TRACK_FILTER}/odometry',
    'track filter, smoothed 1 s late': f'{TRACK_FILTER}/odometry_lag',
}
"""What is compared, and the topic it comes on."""


def run(*command: str) -> None:
    """Run one command of the package, shown as a user would type it."""
    print(f'\n$ {" ".join(command)}', flush=True)
    code = subprocess.run([str(BIN / command[0]), *command[1:]], check=False).returncode
    if code:
        sys.exit(f'{command[0]} ended with exit code {code}')


def start(
    environment: dict[str, str], name: str, remap: tuple[str, ...] = (), **parameters: str
) -> subprocess.Popen[bytes]:
    """Start a node in the background; ``remap`` are rules ``from:=to``."""
    command = [name, '--ros-args']
    for rule in remap:
        command += ['-r', rule]
    for key, value in parameters.items():
        command += ['-p', f'{key}:={value}']
    print(f'\n$ {" ".join(command)} &', flush=True)
    return subprocess.Popen([str(BIN / command[0]), *command[1:]], env=environment)


def live(ride: Path, recorded: Path, rate: str) -> None:
    """Replay the ride's bag through the nodes and record what they publish."""
    environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    environment.setdefault('ROS_DOMAIN_ID', str(os.getpid() % 100 + 1))
    files = {'track': str(ride / 'track.csv'), 'design_ride': str(ride / 'design_ride.csv')}
    nodes = [
        start(environment, 'srdtw_matcher', **files),
        start(environment, 'coaster_eskf', **files),
        start(
            environment,
            'coaster_track_filter',
            (f'__ns:=/{TRACK_FILTER}', 'imu/data_raw:=/imu/data_raw'),
            **files,
        ),
        start(
            environment,
            'bag_recorder',
            topics=f'[{", ".join((*LIVE.values(), "srdtw/pose", "track/pose"))}]',
            output=str(recorded),
            reliable='true',
        ),
    ]
    try:
        time.sleep(3.0)  # the nodes import and compile; the publisher itself waits for them
        print('the nodes compile at their first start; that takes a minute or two', flush=True)
        # It waits for all three that listen; at rate 0 the slower estimator sets the pace.
        publisher = start(
            environment,
            'imu_publisher',
            source=str(ride / 'bag'),
            rate=rate,
            subscribers='3',
            wait_timeout='300.0',
            pace_topic=LIVE['ESKF'],
        )
        code = publisher.wait()
        time.sleep(1.0)
    finally:
        for node in nodes:
            node.send_signal(signal.SIGINT)
        codes = [node.wait(timeout=20) for node in nodes]
    if code or any(codes):
        sys.exit(f'a node failed: publisher {code}, others {codes}')


def compare(ride: Path, recorded: Path) -> None:
    """Print how far the nodes' odometry was from the truth, as it was published."""
    from track_localization.evaluation.metrics import marker_errors, ride_errors, summary
    from track_localization.evaluation.tabulate import Table
    from track_localization.io.bags import read_imu, read_odometry
    from track_localization.io.tables import read_markers

    truth = read_odometry(ride / 'bag', 'ground_truth/odometry')
    markers = read_markers(ride / 'markers.csv')
    found: dict[str, dict[str, Sequence[float]]] = {}
    for name, topic in LIVE.items():
        estimate = read_odometry(recorded, topic)
        if truth is None or estimate is None or not len(estimate):
            sys.exit(f'{topic}: the nodes published nothing')
        errors = ride_errors(estimate, truth)
        at_markers = marker_errors(estimate, markers.time_s, markers.position, truth)
        found[name] = {
            'position, whole ride': errors.distance,
            'along the track': abs(errors.along),
            'across the track': errors.cross,
            f'at {len(markers.time_s)} markers': at_markers.design,
        }
        print(f'{name}: {len(estimate)} poses on {topic}')
    rows = [
        [label, name, *(summary(values[label])[key] for key in ('mean', 'median', 'p95', 'max'))]
        for label in found['ESKF']
        for name, values in found.items()
    ]
    sent = len(read_imu(ride / 'bag')[0])
    title = f'\nLive over DDS: {sent} samples through the nodes, error [m]'
    print(Table(title, ['', '', 'mean', 'median', '95 %', 'max'], rows).text())


def main() -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--track', default='looping', help='see simulate coaster --list')
    parser.add_argument('--seed', default='7')
    parser.add_argument(
        '--rate', default='0.0', help='factor of real time; 0: as fast as the nodes keep up'
    )
    parser.add_argument('--output', type=Path, default=Path('demo'))
    options = parser.parse_args()
    ride, recorded = options.output / 'ride', options.output / 'live'
    shutil.rmtree(options.output, ignore_errors=True)
    run(
        *('simulate', 'coaster', '--track', options.track, '--seed', options.seed),
        *('--output', str(ride)),
    )
    live(ride, recorded, options.rate)
    report = options.output / 'report'
    run('evaluate', 'coaster', str(ride / 'bag'), '--output', str(report))
    compare(ride, recorded)
    pictures = ', '.join(sorted(p.name for p in report.glob('*.png')))
    print(f'\nReport: {report / "report.html"}\nPictures in {report}: {pictures}')


if __name__ == '__main__':
    main()

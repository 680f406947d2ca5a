"""
The demo: a recorded ride, three ROS 2 nodes that locate its train live, and the evaluation.

Simulates a ride into a bag, starts ``srdtw_matcher``, ``coaster_eskf`` and a recorder as processes
of their own, replays the bag into them over DDS, and compares what the nodes published with the
ride's truth; then runs ``evaluate`` on the same bag. Everything is left under ``demo/``.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

BIN = Path(sys.executable).parent


def run(*command: str) -> None:
    """Run one command of the package, shown as a user would type it."""
    print(f'\n$ {" ".join(command)}', flush=True)
    code = subprocess.run([str(BIN / command[0]), *command[1:]], check=False).returncode
    if code:
        sys.exit(f'{command[0]} ended with exit code {code}')


def start(environment: dict[str, str], name: str, **parameters: str) -> subprocess.Popen[bytes]:
    """Start a node in the background."""
    command = [name, '--ros-args']
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
            'bag_recorder',
            topics='[odometry, srdtw/pose, track/pose]',
            output=str(recorded),
            reliable='true',
        ),
    ]
    try:
        time.sleep(3.0)  # the nodes import and compile; the publisher itself waits for them
        publisher = start(environment, 'imu_publisher', source=str(ride / 'bag'), rate=rate)
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
    from track_localization.io.bags import read_odometry
    from track_localization.io.tables import read_markers

    truth = read_odometry(ride / 'bag', 'ground_truth/odometry')
    estimate = read_odometry(recorded, 'odometry')
    if truth is None or estimate is None or not len(estimate):
        sys.exit('the nodes published no odometry')
    markers = read_markers(ride / 'markers.csv')
    errors = ride_errors(estimate, truth)
    at_markers = marker_errors(estimate, markers.time_s, markers.position, truth)
    rows = [
        [name, *(summary(values)[key] for key in ('mean', 'median', 'p95', 'max'))]
        for name, values in (
            ('position, whole ride', errors.distance),
            ('along the track', abs(errors.along)),
            ('across the track', errors.cross),
            ('at 16 markers', at_markers.design),
        )
    ]
    title = f'\nLive over DDS: {len(estimate)} poses from the nodes, error [m]'
    print(Table(title, ['', 'mean', 'median', '95 %', 'max'], rows).text())


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

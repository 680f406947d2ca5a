"""
Cost of the nodes as they run: share of a core, time per Imu message, messages lost.

A simulated ride goes through imu_publisher into srdtw_matcher, coaster_eskf and
coaster_track_filter, processes of their own over DDS in real time, at 100 Hz and at 1 kHz.
Processor time is the kernel's, user and system, over the middle of the run; losses are what was
sent less what each node says that it received. Anything else that runs on the machine counts
against the nodes.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray

from track_localization.evaluation.tabulate import Table
from track_localization.io.bag_writer import BagWriter
from track_localization.settings import override
from track_localization.sim.coaster import scenario, simulate_coaster
from track_localization.track.design_ride import write_design_ride

BIN = Path(sys.executable).parent
NODES = ('imu_publisher', 'srdtw_matcher', 'coaster_eskf', 'coaster_track_filter')
MEASURED_S = 25.0
"""Length of the measured middle."""
SETTLE_S = 3.0
LENGTH_S = MEASURED_S + 2.0 * SETTLE_S


def write_ride(folder: Path, rate_hz: float) -> None:
    """Write bag and design ride of the fast part of a ride at this rate."""
    settings = {'imu.rate_hz': rate_hz, 'ride.dwell_before_s': [4.0, 4.0]}
    ride = simulate_coaster('launch', override(scenario('nominal'), settings), seed=1)
    write_design_ride(folder / 'design_ride.csv', ride.design)
    with BagWriter(folder / 'bag') as bag:
        bag.write_imu('imu/data_raw', ride.imu[: round(LENGTH_S * rate_hz)])


def cpu_s(process: subprocess.Popen[str]) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f'/proc/{process.pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def start(name: str, *parameters: str, remaps: Sequence[str] = ()) -> subprocess.Popen[str]:
    """Start a node."""
    given = [part for p in parameters for part in ('-p', p)]
    command = [str(BIN / name), '--ros-args', *given, *remaps]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def measure(folder: Path, rate_hz: float) -> list[list[str | float]]:
    """Run the nodes over a ride; return a row for each."""
    received: dict[str, int] = {}

    def on_diagnostics(msg: DiagnosticArray) -> None:
        for status in msg.status:
            values = {item.key: item.value for item in status.values}
            if status.name.endswith(': imu'):
                received[status.name.removesuffix(': imu')] = int(values['received'])

    listener = rclpy.create_node('bench')
    listener.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, 10)

    def spin(until: Callable[[], bool], seconds: float = 60.0) -> None:
        deadline = time.monotonic() + seconds
        while not until() and time.monotonic() < deadline:
            rclpy.spin_once(listener, timeout_sec=0.1)

    design = f'design_ride:={folder}/design_ride.csv'
    own = {'coaster_track_filter': ['-r', 'odometry:=odometry_track']}
    processes = {name: start(name, design, remaps=own.get(name, [])) for name in NODES[1:]}
    spin(lambda: len(received) == len(NODES) - 1)
    sender = start(
        'imu_publisher', f'source:={folder}/bag', 'rate:=1.0', f'subscribers:={len(NODES) - 1}'
    )
    processes['imu_publisher'] = sender
    try:
        spin(lambda: min(received.values()) > 0)
        spin(lambda: False, SETTLE_S)
        before, begin = {n: cpu_s(p) for n, p in processes.items()}, time.monotonic()
        spin(lambda: False, MEASURED_S - 2.0)
        wall = time.monotonic() - begin
        used = {n: cpu_s(p) - before[n] for n, p in processes.items()}
        sent = int(re.search(r'sent (\d+)', sender.communicate(timeout=60)[0])[1])
        spin(lambda: False, 2.5)
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGINT)
            process.wait()
        listener.destroy_node()
    rows: list[list[str | float]] = []
    for name in NODES:
        lost = '' if name == 'imu_publisher' else sent - received[name]
        share = used[name] / wall
        rows.append([name, f'{rate_hz:g}', 100.0 * share, 1e6 * share / rate_hz, sent, lost])
    total = sum(used[name] for name in NODES[:3]) / wall
    rows.append(['the first three', f'{rate_hz:g}', 100.0 * total, 1e6 * total / rate_hz, sent, ''])
    return rows


def main() -> None:
    """Print the table."""
    os.environ.setdefault('ROS_DOMAIN_ID', '99')
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init()
    rows: list[list[str | float]] = []
    for rate_hz in (100.0, 1000.0):
        with tempfile.TemporaryDirectory() as folder:
            write_ride(Path(folder), rate_hz)
            rows += measure(Path(folder), rate_hz)
    rclpy.try_shutdown()
    columns = ['node', 'Hz', '% of a core', 'us a message', 'sent', 'lost']
    print(Table('Nodes in real time over DDS', columns, rows).text())


if __name__ == '__main__':
    main()

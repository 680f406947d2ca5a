"""The executables as processes: signals, exit codes, one-line reasons, help."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from track_localization.estimation.imu import ImuSeries
from track_localization.io.bag_writer import BagWriter

NODES = {
    'imu_publisher': 'coaster_localization.nodes.imu_publisher',
    'srdtw_matcher': 'coaster_localization.nodes.srdtw_matcher',
    'coaster_eskf': 'coaster_localization.nodes.eskf',
    'coaster_track_filter': 'coaster_localization.nodes.track_filter',
    'maglev_federated_pf': 'maglev_localization.nodes.federated_pf',
    'sensor_publisher': 'track_localization.ros.replay',
    'train_kf': 'train_localization.nodes.train_kf',
}


@pytest.fixture
def start():
    """Return a function that starts a node's executable; what still runs in the end is killed."""
    processes = []

    def run(name: str, *ros_args: str, plain: tuple[str, ...] = ()) -> subprocess.Popen[str]:
        script = f'from {NODES[name]} import main; sys.argv[0] = {name!r}; sys.exit(main())'
        command = [sys.executable, '-c', f'import sys; {script}', *plain]
        if ros_args:
            command += ['--ros-args', *(part for given in ros_args for part in ('-p', given))]
        pipe = subprocess.PIPE
        processes.append(
            subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=dict(os.environ))
        )
        return processes[-1]

    yield run
    for process in processes:
        if process.poll() is None:
            process.kill()
            process.communicate()


def finish(process: subprocess.Popen[str], timeout: float = 60.0) -> tuple[int, str, str]:
    """Return exit code, stdout and stderr; a process that does not end fails the test."""
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        pytest.fail(f'did not end; stdout: {out}; stderr: {err}')
    return process.returncode, out, err


@pytest.fixture(scope='module')
def bag(tmp_path_factory) -> Path:
    rng = np.random.default_rng(1)
    path = tmp_path_factory.mktemp('ride') / 'bag'
    n = 3000
    force = rng.normal([0.0, 0.0, 9.81], 0.01, (n, 3))
    with BagWriter(path) as out:
        imu = ImuSeries(50.0 + np.arange(n) / 100, force, rng.normal(0.0, 1e-3, (n, 3)))
        out.write_imu('imu/data_raw', imu)
    return path


def appears(ros, node_name: str) -> bool:
    watcher = ros.node('watcher')
    return ros.spin_until(lambda: node_name in watcher.get_node_names(), 60.0)


@pytest.mark.parametrize('sign', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('name', ['coaster_eskf', 'coaster_track_filter', 'srdtw_matcher'])
def test_a_signal_ends_an_estimator_cleanly(ros, start, circle_file, name, sign):
    process = start(name, f'design_ride:={circle_file}')
    assert appears(ros, name)
    process.send_signal(sign)
    begin = time.monotonic()
    code, out, err = finish(process)
    assert (code, out) == (0, '')
    assert 'Traceback' not in err
    assert time.monotonic() - begin < 60.0  # that it ends, not how fast a loaded machine is


@pytest.mark.parametrize('sign', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_maglev_node_cleanly(ros, start, maglev_files, sign):
    process = start('maglev_federated_pf', *(f'{k}:={v}' for k, v in maglev_files.items()))
    assert appears(ros, 'maglev_federated_pf')
    process.send_signal(sign)
    code, out, err = finish(process)
    assert (code, out) == (0, '')
    assert 'Traceback' not in err


@pytest.mark.parametrize('sign', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_train_s_node_cleanly(ros, start, sign):
    process = start('train_kf', 'datum.place:=[45.0,9.0,120.0]')
    assert appears(ros, 'train_kf')
    process.send_signal(sign)
    code, out, err = finish(process)
    assert (code, out) == (0, '')
    assert 'Traceback' not in err


@pytest.mark.parametrize('sign', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('name', ['imu_publisher', 'sensor_publisher'])
def test_a_signal_ends_a_replay_cleanly_and_it_says_how_far_it_came(ros, start, bag, name, sign):
    listener = ros.node('listener')
    received = ros.listen(listener, Imu, 'imu/data_raw')
    process = start(name, f'source:={bag}', 'rate:=1.0')
    assert ros.spin_until(lambda: len(received) > 20, 60.0)
    process.send_signal(sign)
    code, out, err = finish(process)
    assert code == 0
    assert 'Traceback' not in err
    assert 'sent ' in out
    assert 'real time' in out


def test_a_whole_chain_of_processes(ros, start, bag, circle_file):
    """A bag at rate 0 through the ESKF: as many odometries as samples, and the sender ends."""
    listener = ros.node('listener')
    odometries = ros.listen(listener, Odometry, 'odometry')
    filter_ = start('coaster_eskf', f'design_ride:={circle_file}')
    assert ros.spin_until(lambda: listener.count_publishers('odometry') == 1, 60.0)
    ros.spin_for(0.5)
    sender = start('imu_publisher', f'source:={bag}', 'rate:=0')
    assert ros.spin_until(lambda: sender.poll() is not None, 60.0)
    code, out, _ = finish(sender)
    assert (code, out.count('3000 x imu/data_raw')) == (0, 1)
    complete = ros.spin_until(lambda: len(odometries) >= 3000, 20.0)
    assert complete, f'{len(odometries)} from {odometries[0].header.stamp}; {out}'
    filter_.send_signal(signal.SIGINT)
    assert finish(filter_)[0] == 0
    assert len(odometries) == 3000


@pytest.mark.parametrize(
    ('name', 'given', 'said'),
    [
        ('imu_publisher', 'source:=/none', 'imu_publisher: parameter source: /none: '),
        ('imu_publisher', 'rate:=-2', 'parameter rate: -2.0 x real time is below'),
        ('sensor_publisher', 'rate:=fast', "parameter rate: 'fast' cannot stand for"),
        ('coaster_eskf', 'design_ride:=/none.csv', 'parameter design_ride: /none.csv'),
        ('coaster_eskf', 'eskf.rest_s:=1000', 'parameter eskf.rest_s: 1000.0 s is above'),
        ('coaster_track_filter', 'design_ride:=/none.csv', 'parameter design_ride: /none.csv'),
        ('coaster_track_filter', 'track_filter.lag_s:=99', 'lag_s: 99.0 s is above'),
        ('srdtw_matcher', 'matcher.method:=guess', "parameter matcher.method: 'guess' is not one"),
        ('srdtw_matcher', 'matcher.method:=srdtw', 'method: srdtw: live matching is an open-end'),
        ('maglev_federated_pf', 'balises:=/none.csv', 'parameter balises: /none.csv'),
        ('maglev_federated_pf', 'particles:=many', "parameter particles: 'many' cannot stand for"),
        (
            'train_kf',
            'track:=/none.csv',
            'parameter track: a line means nothing without the',
        ),
        ('train_kf', 'datum.file:=/none.yaml', 'parameter datum.file: /none.yaml: no such file'),
        ('train_kf', 'datum.place:=[91.0,0.0,0.0]', 'parameter datum.place: latitude_deg is 91.0'),
        ('train_kf', 'method:=robust_map', 'parameter method: robust_map needs the line'),
    ],
)
def test_a_bad_parameter_gives_one_line_and_exit_code_1(start, name, given, said):
    code, out, err = finish(start(name, given))
    assert (code, out) == (1, '')
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_wrong_usage_gives_exit_code_2(start):
    code, _, err = finish(start('imu_publisher', 'source='))
    assert code == 2
    assert err.startswith('wrong usage: ')
    assert 'Traceback' not in err
    code, _, err = finish(start('imu_publisher', plain=('ride.mcap',)))
    assert code == 2
    assert "'ride.mcap' is not understood" in err


@pytest.mark.parametrize('name', sorted(NODES))
def test_help_lists_parameters_with_units(start, name):
    code, out, err = finish(start(name, plain=('--help',)))
    assert (code, err) == (0, '')
    assert out.startswith(f'{name}: ')
    wanted = 'mount_rpy_deg = (0.0, 0.0, 0.0) [deg]'
    if 'publisher' in name:
        wanted = 'start_offset = 0.0 [s]'
    elif name == 'maglev_federated_pf':
        wanted = 'loop.pitch_m = 0.2 [m]'
    elif name == 'train_kf':
        wanted = 'alignment.rest_s = 2.0 [s]'
    assert wanted in out


def test_help_that_is_not_read_to_its_end_is_no_failure(start):
    """As ``coaster_eskf --help | head -2`` does."""
    with start('coaster_eskf', plain=('--help',)) as process:
        process.stdout.close()
        assert process.wait(60.0) == 0
        assert process.stderr.read() == ''

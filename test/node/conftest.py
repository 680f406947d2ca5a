"""Files that several tests of nodes need."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.replayed import START_S, series

from track_localization.estimation.trajectory import Trajectory
from track_localization.io.bag_writer import BagWriter
from track_localization.track.balise_table import BaliseTable, write_balises
from track_localization.track.track_file import TrackFile, write_track


@pytest.fixture(scope='session')
def maglev_files(tmp_path_factory) -> dict[str, str]:
    """
    Return the paths of a balise table and a track file.

    Balises a, b, c lie a kilometre apart from 500 m on; the line goes 3 km straight from
    (100, 200, 5) along (0.6, 0.8, 0).
    """
    folder = tmp_path_factory.mktemp('line')
    table = BaliseTable(('a', 'b', 'c'), np.array([500.0, 1500.0, 2500.0]), np.full(3, 0.05))
    write_balises(folder / 'balises.csv', table)
    forward, left, up = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    points = np.array([100.0, 200.0, 5.0]) + np.arange(0.0, 3001.0, 10.0)[:, None] * forward
    axes = (np.tile(axis, (len(points), 1)) for axis in (forward, left, up))
    write_track(folder / 'track.csv', TrackFile(points, *axes))
    return {'balises': str(folder / 'balises.csv'), 'track': str(folder / 'track.csv')}


@pytest.fixture
def talk(ros):
    """Return a function that sends a message on a topic once somebody listens."""
    node, publishers = ros.node('talker'), {}

    def publish(topic, msg):
        if topic not in publishers:
            publishers[topic] = node.create_publisher(type(msg), topic, 100)
            ros.wait_matched(publishers[topic])
            ros.spin_for(0.2)
        publishers[topic].publish(msg)

    return publish


@pytest.fixture
def write_bag(tmp_path):
    def write(n=500, rate_hz=100.0):
        path = tmp_path / 'bag'
        with BagWriter(path, overwrite=True) as bag:
            bag.write_imu('imu/data_raw', series(n, rate_hz))
            truth = Trajectory(START_S + np.arange(20.0) / 10, np.zeros((20, 3)))
            bag.write_odometry('ground_truth/odometry', truth)
            bag.write_pose('uwb/pose', truth.time_s + 0.004, truth.position)
        return str(path)

    return write

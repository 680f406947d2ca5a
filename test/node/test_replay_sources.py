"""Replay: which topics are sent, and of which sources."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from helpers.replayed import Consumer, series
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from coaster_localization.nodes.imu_publisher import ImuPublisherNode
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.io.bag_writer import BagWriter
from track_localization.ros.replay import SensorPublisherNode


def test_sensor_publisher_sends_every_topic_but_the_truth(ros, write_bag):
    listener = ros.node('listener')
    imus = ros.listen(listener, Imu, 'imu/data_raw')
    poses = ros.listen(listener, PoseWithCovarianceStamped, 'uwb/pose')
    truths = ros.listen(listener, Odometry, 'ground_truth/odometry')
    node = ros.make_apart(SensorPublisherNode, source=write_bag(200), rate=20.0)
    ros.run_replay(node)
    assert (len(imus), len(poses), len(truths)) == (200, 20, 0)


def test_sensor_publisher_sends_the_truth_when_asked(ros, write_bag):
    listener = ros.node('listener')
    truths = ros.listen(listener, Odometry, 'ground_truth/odometry')
    node = ros.make_apart(SensorPublisherNode, source=write_bag(200), rate=20.0, ground_truth=True)
    ros.run_replay(node)
    assert len(truths) == 20
    assert node.replayer.sent['/imu/data_raw'] == 200


def test_sensor_publisher_sends_only_the_topics_named(ros, write_bag):
    listener = ros.node('listener')
    poses = ros.listen(listener, PoseWithCovarianceStamped, 'uwb/pose')
    node = ros.make_apart(SensorPublisherNode, source=write_bag(200), rate=20.0, topics='uwb/pose')
    ros.run_replay(node)
    assert len(poses) == 20
    assert dict(node.replayer.sent) == {'uwb/pose': 20}


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({}, 'parameter source: not given'),
        ({'source': '/nowhere/bag'}, '/nowhere/bag: no such file'),
        ({'source': __file__}, 'give a ROS 2 bag'),
    ],
)
def test_a_source_that_cannot_be_read_is_named(ros, parameters, said):
    with pytest.raises(DataError, match=said):
        ros.make(SensorPublisherNode, **parameters)


def test_a_topic_that_the_bag_lacks_is_named(ros, write_bag):
    with pytest.raises(DataError, match=r'no topic gnss/fix; it has /ground_truth'):
        ros.make(SensorPublisherNode, source=write_bag(), topics='gnss/fix')


def test_the_only_imu_topic_is_found_under_another_name(ros, tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_imu('phone/imu', series(50, 100.0), 'phone')
    consumer = Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=str(tmp_path / 'bag'), rate=50.0)
    ros.run_replay(node)
    assert consumer.numbers == list(range(50))
    assert consumer.received[0].header.frame_id == 'phone'


def test_several_imu_topics_must_be_chosen_from(ros, tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_imu('left/imu', series(20, 100.0))
        bag.write_imu('right/imu', series(30, 100.0))
    source = str(tmp_path / 'bag')
    with pytest.raises(DataError, match=r'Imu topics: /left/imu, /right/imu; name one'):
        ros.make(ImuPublisherNode, source=source)
    node = ros.make_apart(
        ImuPublisherNode, source=source, topic='right/imu', rate=50.0, subscribers=0
    )
    ros.run_replay(node)
    assert node.replayer.sent['imu/data_raw'] == 30


def test_a_recording_in_g_is_converted_and_one_is_told(ros, tmp_path):
    """Bytes as recorded would be wrong by a factor of 9.8 for every consumer."""
    rng = np.random.default_rng(1)
    imu = series(500, 100.0)
    force = imu.specific_force / 9.80665 + rng.normal(0.0, 1e-3, (500, 3))
    rate = imu.angular_rate + rng.normal(0.0, 1e-3, (500, 3))
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_imu('imu/data_raw', ImuSeries(imu.time_s, force, rate))
    consumer = Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=str(tmp_path / 'bag'), rate=50.0)
    ros.run_replay(node)
    z = [msg.linear_acceleration.z for msg in consumer.received]
    assert np.mean(z) == pytest.approx(9.81, abs=0.01)
    assert any('in g' in finding.what for finding in node.findings)

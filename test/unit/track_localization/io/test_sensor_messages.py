"""Messages of sensors that tell one number: written in order of arrival, read as they were."""

import numpy as np
import pytest

from track_localization.estimation.trajectory import Trajectory
from track_localization.io import codec
from track_localization.io.bag_writer import BagWriter, Message
from track_localization.io.bags import messages, read_odometry
from track_localization.io.sensor_messages import (
    odometry_messages,
    pose_messages,
    twist_messages,
)
from track_localization.io.sensors import ScalarTopic, read_sensors

TIME = np.array([10.0, 10.1, 10.2, 10.3])
ARRIVAL = np.array([10.05, 10.5, 10.25, 10.35])  # the second one is late
VALUE = np.array([1.5, -2.5, 3.5, 4.5])
VARIANCE = np.array([0.01, 0.02, 0.03, 0.04])
WANTED = [
    ScalarTopic('loop', 'loop/pose', codec.POSE),
    ScalarTopic('radar', 'radar/twist', codec.TWIST),
]


def write(path, *streams, **options):
    with BagWriter(path, **options) as bag:
        bag.write_in_order(*streams)
    return path


@pytest.mark.parametrize('kind', [pose_messages, twist_messages])
def test_read_back_in_order_of_arrival(kind, tmp_path):
    """Stamps are the times of measurement, log times those of arrival."""
    sensor, topic, frame = (
        ('loop', 'loop/pose', 'track')
        if kind is pose_messages
        else ('radar', 'radar/twist', 'base_link')
    )
    path = write(tmp_path / 'bag', kind(topic, TIME, ARRIVAL, VALUE, VARIANCE, frame))
    readings = read_sensors(path, WANTED)
    order = [0, 2, 3, 1]
    assert readings.sensor == (sensor,) * 4
    assert readings.frame == (frame,) * 4
    np.testing.assert_allclose(readings.time_s, TIME[order])
    np.testing.assert_allclose(readings.arrival_s, ARRIVAL[order])
    np.testing.assert_array_equal(readings.value, VALUE[order])
    np.testing.assert_array_equal(readings.variance, VARIANCE[order])


def test_the_other_numbers_are_neutral(tmp_path):
    """No turn, no sideways speed, no covariance but of x."""
    path = write(
        tmp_path / 'bag',
        pose_messages('loop/pose', TIME, ARRIVAL, VALUE, VARIANCE, 'track'),
        twist_messages('radar/twist', TIME, ARRIVAL, VALUE, VARIANCE),
    )
    for topic, _, message in messages(path):
        if topic == '/loop/pose':
            pose = message.pose.pose
            q = pose.orientation
            assert (q.x, q.y, q.z, q.w) == (0.0, 0.0, 0.0, 1.0)
            assert (pose.position.y, pose.position.z) == (0.0, 0.0)
            covariance = message.pose.covariance
        else:
            twist = message.twist.twist
            assert (twist.linear.y, twist.linear.z) == (0.0, 0.0)
            assert (twist.angular.x, twist.angular.y, twist.angular.z) == (0.0, 0.0, 0.0)
            covariance = message.twist.covariance
        assert np.count_nonzero(covariance) == 1
        assert covariance[0] > 0.0


def test_a_frame_for_each_message(tmp_path):
    """Frames go with their rows, whatever the order of arrival."""
    frames = ['balise_A', 'balise_longer', 'balise_A', 'balise_B']
    path = write(
        tmp_path / 'bag', pose_messages('loop/pose', TIME, ARRIVAL, VALUE, VARIANCE, frames)
    )
    readings = read_sensors(path, WANTED)
    assert readings.frame == ('balise_A', 'balise_A', 'balise_B', 'balise_longer')
    np.testing.assert_array_equal(readings.value, VALUE[[0, 2, 3, 1]])


def test_topics_are_written_into_one_another(tmp_path):
    """In the file too, not only by its index; of the same time the first stream leads."""
    streams = [
        [Message(topic, codec.POSE, ns, b'\x00\x01\x00\x00') for ns in times]
        for topic, times in (('a', (3, 5, 5)), ('b', (1, 5, 9)), ('c', ()))
    ]
    written = []
    bag = BagWriter(tmp_path / 'bag')
    bag.write_raw = lambda topic, msgtype, ns, cdr: written.append((ns, topic))
    bag.write_in_order(*streams)
    assert written == [(1, 'b'), (3, 'a'), (5, 'a'), (5, 'a'), (5, 'b'), (9, 'b')]


def test_truth_is_logged_at_its_stamps(tmp_path):
    trajectory = Trajectory(
        TIME, np.stack([VALUE, 0 * VALUE, 0 * VALUE], axis=1), velocity=np.ones((4, 3))
    )
    path = write(tmp_path / 'bag', odometry_messages('ground_truth/odometry', trajectory))
    back = read_odometry(path)
    np.testing.assert_allclose(back.time_s, TIME)
    np.testing.assert_array_equal(back.position, trajectory.position)
    logged = [ns for _, ns, _ in messages(path)]
    np.testing.assert_allclose(np.array(logged) * 1e-9, TIME)


def test_compressed_reads_the_same(tmp_path):
    """And is many times smaller: the messages are mostly zeros."""
    n = np.arange(3000.0)
    made = [
        write(
            tmp_path / name,
            pose_messages('loop/pose', 1.0 + n, 1.0 + n, np.sin(n), 1.0 + n, 'track'),
            compress=compress,
        )
        for name, compress in (('plain', False), ('small', True))
    ]
    plain, small = (read_sensors(path, WANTED) for path in made)
    np.testing.assert_array_equal(plain.value, small.value)
    np.testing.assert_array_equal(plain.time_s, small.time_s)
    sizes = [sum(f.stat().st_size for f in path.glob('*.mcap')) for path in made]
    assert sizes[1] < sizes[0] / 5


def test_nothing_to_write(tmp_path):
    """A sensor that heard nothing has no topic."""
    none = np.zeros(0)
    path = write(
        tmp_path / 'bag',
        pose_messages('balise/pose', none, none, none, none, []),
        twist_messages('radar/twist', none, none, none, none),
        pose_messages('loop/pose', TIME, ARRIVAL, VALUE, VARIANCE, 'track'),
    )
    assert {topic for topic, _, _ in messages(path)} == {'/loop/pose'}

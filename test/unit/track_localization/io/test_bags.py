"""Bags: what is written comes back; damaged, foreign and odd bags are told, not swallowed."""

import logging
import shutil

import numpy as np
import pytest
from helpers.bags_by_hand import STORE, imu_rows, imu_series, raw_imu, write_foreign
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.io import bags
from track_localization.io.bags import BagWriter


@pytest.mark.parametrize('named', ['folder', 'file', 'no metadata'])
def test_imu_comes_back_to_the_nanosecond(bag, named):
    if named == 'no metadata':
        (bag / 'metadata.yaml').unlink()
    series, rejected = bags.read_imu(bag / 'bag.mcap' if named == 'file' else bag)
    expected = imu_series()
    assert rejected == {}
    np.testing.assert_allclose(series.time_s, expected.time_s, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(series.specific_force, expected.specific_force)
    np.testing.assert_array_equal(series.angular_rate, expected.angular_rate)


@pytest.mark.parametrize('storage', list(StoragePlugin))
@pytest.mark.parametrize('compression', [None, CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize('version', [8, 9])
def test_foreign_bags_of_each_kind(tmp_path, storage, compression, version):
    path = tmp_path / 'b'
    topics = {'/imu/data_raw': ('sensor_msgs/msg/Imu', imu_rows(5))}
    write_foreign(path, topics, storage, compression, version)
    series, rejected = bags.read_imu(path)
    assert rejected == {}
    np.testing.assert_array_equal(series.time_s, 100.5 + np.arange(5))
    np.testing.assert_array_equal(series.specific_force[:, 0], np.arange(5))
    np.testing.assert_array_equal(series.angular_rate[0], [0.1, 0.2, 0.3])


def test_a_db3_alone_and_a_split_recording(tmp_path):
    for k in (2, 10):  # part 10 comes after part 2
        topics = {'/imu/data_raw': ('sensor_msgs/msg/Imu', imu_rows(3, start=100 * k))}
        write_foreign(tmp_path / f'p{k}', topics, StoragePlugin.SQLITE3)
    both = tmp_path / 'both'
    both.mkdir()
    for k in (2, 10):
        shutil.copy(tmp_path / f'p{k}' / f'p{k}.db3', both / f'ride_{k}.db3')
    alone, _ = bags.read_imu(tmp_path / 'p2' / 'p2.db3')
    np.testing.assert_array_equal(alone.time_s, [200.5, 201.5, 202.5])
    joined, rejected = bags.read_imu(both)
    assert rejected == {}
    np.testing.assert_array_equal(joined.time_s, [200.5, 201.5, 202.5, 1000.5, 1001.5, 1002.5])


def test_an_mcap_without_the_ros2_profile_is_whole(tmp_path):
    """Other tools write ROS 2 messages without naming the profile: nothing is lost or blamed."""
    write_foreign(tmp_path / 'b', {'/imu/data_raw': ('sensor_msgs/msg/Imu', imu_rows(5))})
    content = (tmp_path / 'b' / 'b.mcap').read_bytes()
    (tmp_path / 'other.mcap').write_bytes(content.replace(b'\x04\0\0\0ros2', b'\x04\0\0\0mine', 1))
    series, rejected = bags.read_imu(tmp_path / 'other.mcap')
    assert len(series) == 5
    assert rejected == {}


def test_series_are_written_as_rosbags_serialises_each_message(tmp_path):
    """The bulk writer's bytes decode to the fields that were given, frame ids included."""
    with BagWriter(tmp_path / 'b') as writer:
        writer.write_imu('imu/data_raw', imu_series(3), frame_id='phone')
        pose = np.arange(3.0)[None]
        writer.write_pose('p', np.array([2.5]), pose, quaternion=np.array([[0.0, 0.6, 0.0, 0.8]]))
    *imus, (_, _, pose) = sorted(bags.messages(tmp_path / 'b'), key=lambda m: m[0])
    for k, (_, log_ns, message) in enumerate(imus):
        assert log_ns == 5_000_000_000 + k * 10_000_000
        assert message.header.stamp.nanosec == k * 10_000_000
        assert message.header.frame_id == 'phone'
        assert message.orientation.w == 1.0
        assert message.orientation_covariance[0] == -1.0
        assert message.linear_acceleration_covariance[0] == 0.0
        assert message.linear_acceleration.y == imu_series(3).specific_force[k, 1]
        assert message.angular_velocity.z == imu_series(3).angular_rate[k, 2]
    assert pose.header.stamp.nanosec == 500_000_000
    assert (pose.pose.pose.orientation.y, pose.pose.pose.orientation.w) == (0.6, 0.8)


def test_no_gyro_is_kept_as_no_gyro(tmp_path):
    series = imu_series(10)
    series.angular_rate[:] = np.nan
    with BagWriter(tmp_path / 'b') as writer:
        writer.write_imu('imu/data_raw', series)
    back, rejected = bags.read_imu(tmp_path / 'b')
    assert len(back) == 10
    assert rejected == {}
    assert not back.has_gyro


def test_bad_samples_are_counted(tmp_path):
    rows = imu_rows(40)
    rows[2][1].linear_acceleration.y = float('nan')
    rows[4] = rows[3]
    rows[6] = (rows[6][0], rows[1][1])
    write_foreign(tmp_path / 'b', {'/imu/data_raw': ('sensor_msgs/msg/Imu', rows)})
    series, rejected = bags.read_imu(tmp_path / 'b')
    assert rejected == {'not_finite': 1, 'repeated_time': 1, 'backward_time': 1}
    np.testing.assert_array_equal(series.time_s, 100.5 + np.array([0, 1, 3, 5, *range(7, 40)]))


def test_header_stamps_win_over_log_times_unless_all_are_zero(tmp_path):
    late = [(ns + 7 * 10**9, message) for ns, message in imu_rows(4)]
    write_foreign(tmp_path / 'late', {'/imu/data_raw': ('sensor_msgs/msg/Imu', late)})
    series, _ = bags.read_imu(tmp_path / 'late')
    assert series.time_s[0] == 100.5
    zero = [((9 + k) * 10**9, raw_imu(0, 0)) for k in range(4)]
    write_foreign(tmp_path / 'zero', {'/imu/data_raw': ('sensor_msgs/msg/Imu', zero)})
    series, rejected = bags.read_imu(tmp_path / 'zero')
    np.testing.assert_array_equal(series.time_s, [9, 10, 11, 12])
    assert rejected == {'no_header_stamp': 4}


def test_topics_are_found_with_and_without_slash_and_in_one_namespace(tmp_path, caplog):
    topics = {'/car1/imu/data_raw': ('sensor_msgs/msg/Imu', imu_rows(2))}
    write_foreign(tmp_path / 'one', topics)
    for name in ('car1/imu/data_raw', '/car1/imu/data_raw'):
        assert len(bags.read_imu(tmp_path / 'one', name)[0]) == 2
    with caplog.at_level(logging.WARNING):
        assert len(bags.read_imu(tmp_path / 'one')[0]) == 2
    assert '/car1/imu/data_raw' in caplog.text
    topics['/car2/imu/data_raw'] = ('sensor_msgs/msg/Imu', imu_rows(2))
    write_foreign(tmp_path / 'two', topics)
    with pytest.raises(DataError, match='several namespaces'):
        bags.read_imu(tmp_path / 'two')
    with pytest.raises(DataError, match=r'no topic phone/imu.*car1.*--remap'):
        bags.read_imu(tmp_path / 'two', 'phone/imu')
    assert bags.read_odometry(tmp_path / 'two') is None


def test_wrong_type_names_both(tmp_path):
    text = STORE.types['std_msgs/msg/String'](data='hello')
    write_foreign(tmp_path / 'b', {'/imu/data_raw': ('std_msgs/msg/String', [(1, text)])})
    with pytest.raises(DataError, match=r'std_msgs/msg/String.*sensor_msgs/msg/Imu'):
        bags.read_imu(tmp_path / 'b')
    write_foreign(tmp_path / 'c', {'/imu/data_raw': ('sensor_msgs/msg/Imu', [])})
    with pytest.raises(DataError, match='empty'):
        bags.read_imu(tmp_path / 'c')


def test_unknown_types_beside_the_imu_do_no_harm(tmp_path, caplog):
    with Writer(tmp_path / 'b', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        odd = writer.add_connection(
            '/odd', 'acme_msgs/msg/Odd', msgdef='uint8 x\n', rihs01='RIHS01_' + '0' * 64
        )
        writer.write(odd, 1, b'\x00\x01\x00\x00\x07')
        good = writer.add_connection('/imu/data_raw', 'sensor_msgs/msg/Imu', typestore=STORE)
        writer.write(good, 2, STORE.serialize_cdr(raw_imu(1, 0), 'sensor_msgs/msg/Imu'))
    assert len(bags.read_imu(tmp_path / 'b')[0]) == 1
    assert [topic for topic, _, _ in bags.messages(tmp_path / 'b')] == ['/imu/data_raw']
    assert 'acme_msgs' in caplog.text
    assert len(list(bags.raw_messages(tmp_path / 'b'))) == 2
    with pytest.raises(DataError, match='unknown type'):
        list(bags.messages(tmp_path / 'b', ['odd']))


def test_odometry_keeps_covariance_and_turns_velocity_into_map(tmp_path):
    half = np.sqrt(0.5)
    truth = Trajectory(
        np.array([1.0, 2.0]),
        np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        quaternion=np.array([[0.0, 0.0, half, half]] * 2),  # facing +y
        velocity=np.array([[0.0, 3.0, 0.0], [0.0, 5.0, 0.0]]),
        covariance=np.array([[[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]] * 2),
        sigma_speed=np.array([0.5, 0.25]),
    )
    with BagWriter(tmp_path / 'b') as writer:
        writer.write_odometry('ground_truth/odometry', truth)
    message = next(iter(bags.messages(tmp_path / 'b')))[2]
    assert message.child_frame_id == 'base_link'
    assert message.twist.twist.linear.x == pytest.approx(3.0)
    assert message.twist.twist.linear.y == pytest.approx(0.0)
    assert message.pose.covariance.reshape(6, 6)[0, 1] == 1.0
    back = bags.read_odometry(tmp_path / 'b')
    np.testing.assert_allclose(back.velocity, truth.velocity, atol=1e-12)
    np.testing.assert_array_equal(back.position, truth.position)
    np.testing.assert_array_equal(back.covariance, truth.covariance)
    np.testing.assert_allclose(back.speed, [3.0, 5.0])
    np.testing.assert_allclose(back.sigma_speed, truth.sigma_speed)


def test_odometry_without_orientation_and_covariance(tmp_path):
    with BagWriter(tmp_path / 'b') as writer:
        writer.write_odometry('odometry', Trajectory(np.arange(3.0), np.ones((3, 3))))
    rows = list(bags.messages(tmp_path / 'b'))
    with BagWriter(tmp_path / 'zero') as writer:
        for _, ns, message in rows:
            message.pose.pose.orientation.w = 0.0
            message.twist.twist.linear.y = 2.0
            writer.write('odometry', 'nav_msgs/msg/Odometry', ns, message)
    back = bags.read_odometry(tmp_path / 'zero', 'odometry')
    assert back.quaternion is None
    assert back.velocity is None
    assert back.covariance is None
    np.testing.assert_array_equal(back.speed, [2.0, 2.0, 2.0])


def test_odometry_rows_that_cannot_be_used_are_counted(tmp_path):
    with BagWriter(tmp_path / 'b') as writer:
        writer.write_odometry('o', Trajectory(np.array([1.0, 2.0, 2.0, 1.5, 3.0]), np.ones((5, 3))))
        writer.write_odometry('o', Trajectory(np.array([4.0]), np.full((1, 3), np.nan)))
    counts = {}
    back = bags.read_odometry(tmp_path / 'b', 'o', counts)
    np.testing.assert_array_equal(back.time_s, [1.0, 1.5, 2.0, 3.0])
    assert counts == {'repeated_time': 1, 'not_finite': 1}


def test_poses_keep_stamp_apart_from_arrival(tmp_path):
    with BagWriter(tmp_path / 'b') as writer:
        writer.write_pose(
            'srdtw/pose',
            np.array([1.0]),
            np.array([[1.0, 2.0, 3.0]]),
            covariance=np.diag([1.0, 2.0, 3.0])[None],
            log_time_s=np.array([4.5]),
        )
    ((topic, log_ns, message),) = bags.messages(tmp_path / 'b', ['srdtw/pose'])
    assert (topic, log_ns, message.header.stamp.sec) == ('srdtw/pose', 4_500_000_000, 1)
    assert message.pose.pose.position.z == 3.0
    np.testing.assert_array_equal(np.diag(message.pose.covariance.reshape(6, 6))[:3], [1, 2, 3])


def test_messages_of_several_topics_come_in_order_of_log_time(tmp_path):
    with BagWriter(tmp_path / 'b') as writer:
        writer.write_imu('imu/data_raw', imu_series(5, start=5.0))
        writer.write_odometry('odom', Trajectory(np.array([5.005, 5.025]), np.zeros((2, 3))))
    seen = [(topic, ns) for topic, ns, _ in bags.messages(tmp_path / 'b', ['imu/data_raw', 'odom'])]
    assert [ns for _, ns in seen] == sorted(ns for _, ns in seen)
    assert [topic for topic, _ in seen][:2] == ['imu/data_raw', 'odom']
    assert bags.list_topics(tmp_path / 'b') == {
        '/imu/data_raw': 'sensor_msgs/msg/Imu',
        '/odom': 'nav_msgs/msg/Odometry',
    }


def test_writer_refuses_to_overwrite_and_to_delete_strangers(tmp_path, bag):
    with pytest.raises(DataError, match='exists already'), BagWriter(bag):
        pass
    with BagWriter(bag, overwrite=True) as writer:
        writer.write_imu('imu/data_raw', imu_series(3))
    assert len(bags.read_imu(bag)[0]) == 3
    (bag / 'thesis.doc').touch()
    with pytest.raises(DataError, match=r'thesis\.doc'), BagWriter(bag, overwrite=True):
        pass
    assert (bag / 'bag.mcap').exists()
    with pytest.raises(DataError, match='cannot be written'), BagWriter(tmp_path / 'x') as writer:
        writer.write_imu('imu/data_raw', imu_series(3, start=-5.0))


def test_what_was_written_before_an_error_can_be_read(tmp_path):
    def write_and_fail():
        with BagWriter(tmp_path / 'b') as writer:
            writer.write_imu('imu/data_raw', imu_series(7))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_and_fail()
    assert len(bags.read_imu(tmp_path / 'b')[0]) == 7

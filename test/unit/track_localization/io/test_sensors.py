"""Sensors that tell one number: values, order of arrival, bags that lack them."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from track_localization.errors import DataError
from track_localization.io.sensors import ScalarTopic, read_sensors

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
TWIST = 'geometry_msgs/msg/TwistWithCovarianceStamped'
MAGLEV = (
    ScalarTopic('loop', 'loop/pose', POSE),
    ScalarTopic('radar', 'radar/twist', TWIST),
    ScalarTopic('balise', 'balise/pose', POSE),
)
MS = 10**6


def stamped(kind, stamp_ms, frame, **content):
    t = STORE.types
    sec, ms = divmod(stamp_ms, 1000)
    stamp = t['builtin_interfaces/msg/Time'](sec=sec, nanosec=ms * MS)
    return t[kind](header=t['std_msgs/msg/Header'](stamp=stamp, frame_id=frame), **content)


def pose(stamp_ms, x, variance, frame='track'):
    """Return a pose built field by field, every other number one that must not be taken for x."""
    t = STORE.types
    covariance = np.full(36, 77.0)
    covariance[0] = variance
    inner = t['geometry_msgs/msg/Pose'](
        position=t['geometry_msgs/msg/Point'](x=x, y=-5.0, z=-6.0),
        orientation=t['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    both = t['geometry_msgs/msg/PoseWithCovariance'](pose=inner, covariance=covariance)
    return stamped(POSE, stamp_ms, frame, pose=both)


def twist(stamp_ms, x, variance):
    t = STORE.types
    covariance = np.full(36, 88.0)
    covariance[0] = variance
    vector = t['geometry_msgs/msg/Vector3']
    inner = t['geometry_msgs/msg/Twist'](
        linear=vector(x=x, y=-7.0, z=-8.0), angular=vector(x=-1.0, y=-2.0, z=-3.0)
    )
    both = t['geometry_msgs/msg/TwistWithCovariance'](twist=inner, covariance=covariance)
    return stamped(TWIST, stamp_ms, 'base_link', twist=both)


def write(path, topics, storage=StoragePlugin.MCAP):
    """Write {topic: (type, [(arrival [ms], message)])}."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        for topic, (kind, rows) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for arrival_ms, message in rows:
                writer.write(connection, arrival_ms * MS, STORE.serialize_cdr(message, kind))
    return path


@pytest.fixture
def topics():
    """A loop whose second message is late, a radar, and a balise between them."""
    return {
        '/loop/pose': (
            POSE,
            [
                (1_000_010, pose(1_000_000, 12.5, 0.01)),
                (1_000_300, pose(1_000_020, 12.7, 0.02)),
                (1_000_050, pose(1_000_040, 12.9, 0.03)),
            ],
        ),
        '/radar/twist': (TWIST, [(1_000_030, twist(1_000_025, 27.0, 0.04))]),
        '/balise/pose': (POSE, [(1_000_060, pose(1_000_031, 0.25, 0.05, 'balise_B7'))]),
    }


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_every_number_comes_back_in_order_of_arrival(tmp_path, topics, storage):
    readings = read_sensors(write(tmp_path / 'bag', topics, storage), MAGLEV)
    assert readings.sensor == ('loop', 'radar', 'loop', 'balise', 'loop')
    np.testing.assert_allclose(
        readings.arrival_s, [1000.01, 1000.03, 1000.05, 1000.06, 1000.3], rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(
        readings.time_s, [1000.0, 1000.025, 1000.04, 1000.031, 1000.02], rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(readings.value, [12.5, 27.0, 12.9, 0.25, 12.7])
    np.testing.assert_array_equal(readings.variance, [0.01, 0.04, 0.03, 0.05, 0.02])
    assert readings.frame == ('track', 'base_link', 'track', 'balise_B7', 'track')
    assert readings.topics == {'loop': '/loop/pose', 'radar': '/radar/twist',
                               'balise': '/balise/pose'}  # fmt: skip
    assert readings.rejected == {}
    assert readings.duration_s == pytest.approx(0.29)
    assert [readings.count(s.sensor) for s in MAGLEV] == [3, 1, 1]


def test_nan_and_negative_variance_are_handed_on(tmp_path):
    rows = [(1, pose(1, float('nan'), 0.01)), (2, pose(2, 1.0, -4.0))]
    readings = read_sensors(write(tmp_path / 'bag', {'/loop/pose': (POSE, rows)}), MAGLEV)
    np.testing.assert_array_equal(readings.value, [np.nan, 1.0])
    np.testing.assert_array_equal(readings.variance, [0.01, -4.0])


def test_a_sensor_that_is_missing_is_left_out(tmp_path, topics):
    del topics['/radar/twist']
    readings = read_sensors(write(tmp_path / 'bag', topics), MAGLEV)
    assert set(readings.topics) == {'loop', 'balise'}
    assert readings.count('radar') == 0


def test_topics_in_a_namespace_and_remapped_ones(tmp_path, topics):
    renamed = {'/train1' + topic: rows for topic, rows in topics.items()}
    renamed['/speed'] = renamed.pop('/train1/radar/twist')
    bag = write(tmp_path / 'bag', renamed)
    wanted = [s._replace(topic='/speed') if s.sensor == 'radar' else s for s in MAGLEV]
    readings = read_sensors(bag, wanted)
    assert readings.topics == {
        'loop': '/train1/loop/pose', 'radar': '/speed', 'balise': '/train1/balise/pose'
    }  # fmt: skip
    assert readings.count('loop') == 3


def test_a_topic_without_any_header_stamp_takes_the_time_of_arrival(tmp_path, topics):
    kind, rows = topics['/loop/pose']
    topics['/loop/pose'] = (kind, [(arrival, pose(0, 1.0, 0.01)) for arrival, _ in rows])
    readings = read_sensors(write(tmp_path / 'bag', topics), MAGLEV)
    loop = np.array(readings.sensor) == 'loop'
    np.testing.assert_array_equal(readings.time_s[loop], readings.arrival_s[loop])
    assert readings.time_s[1] == pytest.approx(1000.025)
    assert readings.rejected == {'loop': {'no_header_stamp': 3}}


def test_another_message_type_is_told_with_topic_and_remedy(tmp_path, topics):
    topics['/radar/twist'] = (POSE, topics['/loop/pose'][1])
    with pytest.raises(DataError) as error:
        read_sensors(write(tmp_path / 'bag', topics), MAGLEV)
    for word in ('/radar/twist', POSE, TWIST, '--remap radar/twist:='):
        assert word in str(error.value)


def test_a_bag_of_something_else_is_told_with_what_it_has(tmp_path, topics):
    bag = write(tmp_path / 'bag', {'/gnss/pose': topics['/loop/pose']})
    with pytest.raises(DataError) as error:
        read_sensors(bag, MAGLEV)
    for word in ('loop/pose', 'radar/twist', 'balise/pose', '/gnss/pose', '--remap'):
        assert word in str(error.value)


def test_empty_topics_and_empty_files_are_told(tmp_path):
    with pytest.raises(DataError, match=r'/loop/pose.*empty'):
        read_sensors(write(tmp_path / 'bag', {'/loop/pose': (POSE, [])}), MAGLEV)
    (tmp_path / 'none.mcap').touch()
    with pytest.raises(DataError, match=r'none\.mcap'):
        read_sensors(tmp_path / 'none.mcap', MAGLEV)


def test_a_bag_cut_short_gives_what_it_still_has(tmp_path):
    rows = [(k, pose(k, 0.2 * k, 0.01)) for k in range(3000)]
    bag = write(tmp_path / 'bag', {'/loop/pose': (POSE, rows)})
    content = (bag / 'bag.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(content[: len(content) // 2])
    readings = read_sensors(tmp_path / 'cut.mcap', MAGLEV)
    assert 1000 < len(readings) < 2000
    np.testing.assert_allclose(readings.value, 0.2 * np.arange(len(readings)))
    assert readings.rejected['bag']['unreadable'] >= 1


def test_a_message_of_damaged_bytes_is_counted(tmp_path):
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/loop/pose', POSE, typestore=STORE)
        whole = bytes(STORE.serialize_cdr(pose(1, 3.0, 0.01), POSE))
        for k, cdr in enumerate((whole, whole[:40], whole)):
            writer.write(connection, k, cdr)
    readings = read_sensors(tmp_path / 'bag', MAGLEV)
    np.testing.assert_array_equal(readings.value, [3.0, 3.0])
    assert readings.rejected == {'bag': {'undecodable': 1}}

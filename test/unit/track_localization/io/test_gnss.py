"""A train's bag: values and units, order of arrival, qualities of either type, what is missing."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from track_localization.errors import DataError
from track_localization.io.gnss import GNSS, IMU, QUALITY, WHEEL, read_recorded
from track_localization.io.start_pose import read_start

STORE = get_typestore(Stores.ROS2_JAZZY)
KINDS = {
    'imu/data_raw': 'sensor_msgs/msg/Imu',
    'gnss/fix': 'sensor_msgs/msg/NavSatFix',
    'gnss/quality': 'diagnostic_msgs/msg/DiagnosticArray',
    'wheel/twist': 'geometry_msgs/msg/TwistWithCovarianceStamped',
    'initialpose': 'geometry_msgs/msg/PoseWithCovarianceStamped',
}
STATUS = 'diagnostic_msgs/msg/DiagnosticStatus'
MS = 10**6


def make(kind, **content):
    return STORE.types[kind](**content)


def vector(*xyz):
    return make('geometry_msgs/msg/Vector3', **dict(zip('xyz', xyz, strict=True)))


def header(stamp_ms, frame):
    sec, ms = divmod(stamp_ms, 1000)
    stamp = make('builtin_interfaces/msg/Time', sec=sec, nanosec=ms * MS)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def imu(stamp_ms, force=(0.1, 0.2, 9.8), rate=(0.01, 0.02, 0.03)):
    unknown = np.zeros(9)
    return make(
        KINDS['imu/data_raw'],
        header=header(stamp_ms, 'imu_link'),
        orientation=make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=unknown,
        angular_velocity=vector(*rate),
        angular_velocity_covariance=unknown,
        linear_acceleration=vector(*force),
        linear_acceleration_covariance=unknown,
    )


def fix(stamp_ms, status=0, kind=3):
    return make(
        KINDS['gnss/fix'],
        header=header(stamp_ms, 'gnss'),
        status=make('sensor_msgs/msg/NavSatStatus', status=status, service=1),
        latitude=40.0,
        longitude=-116.0,
        altitude=500.0,
        position_covariance=np.arange(1.0, 10.0),
        position_covariance_type=kind,
    )


def status(**values):
    pairs = [make('diagnostic_msgs/msg/KeyValue', key=k, value=v) for k, v in values.items()]
    return make(STATUS, level=0, name='gnss', message='', hardware_id='', values=pairs)


def quality(stamp_ms, **values):
    return make(KINDS['gnss/quality'], header=header(stamp_ms, 'gnss'), status=[status(**values)])


def twist(stamp_ms, speed, variance):
    covariance = np.full(36, 88.0)
    covariance[0] = variance
    inner = make('geometry_msgs/msg/Twist', linear=vector(speed, -7.0, -8.0),
                 angular=vector(-1.0, -2.0, -3.0))  # fmt: skip
    both = make('geometry_msgs/msg/TwistWithCovariance', twist=inner, covariance=covariance)
    return make(KINDS['wheel/twist'], header=header(stamp_ms, 'base_link'), twist=both)


def pose(stamp_ms, w=1.0, variance=0.25):
    inner = make(
        'geometry_msgs/msg/Pose',
        position=make('geometry_msgs/msg/Point', x=1.0, y=2.0, z=3.0),
        orientation=make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=w),
    )
    both = make('geometry_msgs/msg/PoseWithCovariance', pose=inner,
                covariance=(variance * np.eye(6)).ravel())  # fmt: skip
    return make(KINDS['initialpose'], header=header(stamp_ms, 'map'), pose=both)


def write(path, topics, kinds=KINDS):
    """Write {topic: [(arrival [ms], message)]} and return the bag."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, rows in topics.items():
            connection = writer.add_connection(f'/{topic}', kinds[topic], typestore=STORE)
            for arrival_ms, message in rows:
                cdr = STORE.serialize_cdr(message, kinds[topic])
                writer.write(connection, arrival_ms * MS, cdr)
    return path


@pytest.fixture
def topics():
    """Return a second of a run: the fix of 1.0 s and its quality come 80 ms late."""
    return {
        'imu/data_raw': [(t, imu(t)) for t in range(1000, 1300, 100)],
        'gnss/fix': [(1080, fix(1000))],
        'gnss/quality': [(1080, quality(1000, satellites_used='7', hdop='1.2'))],
        'wheel/twist': [(1060, twist(1050, 20.0, 0.04))],
    }


def test_values_come_in_si_and_in_order_of_arrival(tmp_path, topics):
    found = read_recorded(write(tmp_path / 'bag', topics))
    order = [sensor for sensor, _ in found.arrivals()]
    assert order[:2] == [IMU, WHEEL]
    assert set(order[2:4]) == {GNSS, QUALITY}
    assert order[4:] == [IMU, IMU]
    assert [row for sensor, row in found.arrivals() if sensor == IMU] == [0, 1, 2]
    np.testing.assert_allclose(found.imu.time_s, [1.0, 1.1, 1.2])
    np.testing.assert_allclose(found.imu.specific_force[0], [0.1, 0.2, 9.8])
    np.testing.assert_allclose(found.imu.angular_rate[0], [0.01, 0.02, 0.03])
    np.testing.assert_allclose(found.fixes.latitude, np.pi * 40.0 / 180.0)
    np.testing.assert_allclose(found.fixes.longitude, -np.pi * 116.0 / 180.0)
    np.testing.assert_allclose(found.fixes.covariance[0], np.arange(1.0, 10.0).reshape(3, 3))
    assert (found.fixes.time_s[0], found.fixes.height[0], found.fixes.valid[0]) == (
        1.0,
        500.0,
        True,
    )
    assert (found.qualities.time_s[0], found.qualities.satellites[0]) == (1.0, 7)
    assert found.qualities.hdop[0] == pytest.approx(1.2)
    assert (found.speeds.time_s[0], found.speeds.speed[0], found.speeds.variance[0]) == (
        1.05,
        20.0,
        0.04,
    )
    assert found.duration_s == pytest.approx(0.2)
    assert not found.rejected


def test_no_fix_and_no_covariance_are_told(tmp_path, topics):
    topics['gnss/fix'] = [(1080, fix(1000, status=-1)), (1090, fix(1001, kind=0))]
    found = read_recorded(write(tmp_path / 'bag', topics)).fixes
    assert found.valid.tolist() == [False, True]
    assert np.isfinite(found.covariance[0]).all()
    assert np.isnan(found.covariance[1]).all()


@pytest.mark.parametrize(
    ('values', 'satellites', 'hdop'),
    [
        ({'hdop': '1.5'}, -1, 1.5),
        ({'satellites_used': '5'}, 5, np.nan),
        ({'satellites_used': 'many', 'hdop': '--'}, -1, np.nan),
        ({'satellites_used': '-4', 'hdop': '99.99'}, -1, 99.99),
        ({'satellites_used': 'inf'}, -1, np.nan),
        ({}, -1, np.nan),
    ],
)
def test_a_quality_may_lack_anything(tmp_path, topics, values, satellites, hdop):
    topics['gnss/quality'] = [(1080, quality(1000, **values))]
    found = read_recorded(write(tmp_path / 'bag', topics)).qualities
    assert found.satellites.tolist() == [satellites]
    np.testing.assert_equal(found.hdop, [hdop])


def test_a_bare_status_belongs_to_the_fix_that_it_came_with(tmp_path, topics):
    """It has no stamp: 80 ms after the fix's own it would be that of no fix."""
    topics['gnss/fix'] = [(1080, fix(1000)), (2075, fix(2000))]
    one = status(satellites_used='6', hdop='2')
    topics['gnss/quality'] = [(1081, one), (2074, one), (5000, one)]
    kinds = {**KINDS, 'gnss/quality': STATUS}
    found = read_recorded(write(tmp_path / 'bag', topics, kinds))
    np.testing.assert_allclose(found.qualities.time_s, [1.0, 2.0, 5.0])
    assert found.qualities.satellites.tolist() == [6, 6, 6]
    assert not found.rejected


def test_what_was_never_stamped_gets_its_time_of_arrival(tmp_path, topics):
    topics['wheel/twist'] = [(1060, twist(0, 20.0, 0.04))]
    found = read_recorded(write(tmp_path / 'bag', topics))
    np.testing.assert_allclose(found.speeds.time_s, [1.06])
    assert found.rejected == {WHEEL: {'no_header_stamp': 1}}


@pytest.mark.parametrize('missing', ['wheel/twist', 'gnss/quality'])
def test_odometer_and_quality_may_be_missing(tmp_path, topics, missing):
    del topics[missing]
    found = read_recorded(write(tmp_path / 'bag', topics))
    sensor = {'wheel/twist': WHEEL, 'gnss/quality': QUALITY}[missing]
    assert sensor not in found.topics
    assert found.count(sensor) == 0


@pytest.mark.parametrize('missing', ['imu/data_raw', 'gnss/fix'])
def test_imu_and_fixes_must_be_there(tmp_path, topics, missing):
    del topics[missing]
    with pytest.raises(DataError, match=rf'no topic {missing}; it has .*wheel/twist.*--remap'):
        read_recorded(write(tmp_path / 'bag', topics))


def test_a_topic_of_another_type_is_told(tmp_path, topics):
    kinds = {**KINDS, 'wheel/twist': KINDS['gnss/fix']}
    topics['wheel/twist'] = topics['gnss/fix']
    with pytest.raises(DataError, match=r'wheel/twist holds .*NavSatFix, not .*Twist.*--remap'):
        read_recorded(write(tmp_path / 'bag', topics, kinds))


def test_topics_can_be_named(tmp_path, topics):
    topics['odo'] = topics.pop('wheel/twist')
    bag = write(tmp_path / 'bag', topics, {**KINDS, 'odo': KINDS['wheel/twist']})
    assert read_recorded(bag, {WHEEL: 'odo'}).speeds.speed.tolist() == [20.0]
    with pytest.raises(DataError, match='no topic speed'):
        read_recorded(bag, {WHEEL: 'speed'})


def test_the_start_that_a_bag_tells(tmp_path, topics):
    assert read_start(write(tmp_path / 'none', topics), 'initialpose') is None
    topics['initialpose'] = [(900, pose(850)), (5000, pose(5000))]
    time_s, position, quaternion, covariance = read_start(
        write(tmp_path / 'bag', topics), 'initialpose'
    )
    assert time_s == pytest.approx(0.85)
    assert position.tolist() == [1.0, 2.0, 3.0]
    assert quaternion.tolist() == [0.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(covariance, 0.25 * np.eye(6))


@pytest.mark.parametrize(('change', 'words'), [({'w': 0.0}, 'length'), ({'variance': 0.0}, 'sure')])
def test_a_start_that_cannot_be_used_is_told(tmp_path, topics, change, words):
    topics['initialpose'] = [(900, pose(850, **change))]
    with pytest.raises(DataError, match=words):
        read_start(write(tmp_path / 'bag', topics), 'initialpose')

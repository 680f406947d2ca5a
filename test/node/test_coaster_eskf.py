"""The ESKF node: messages in, odometry out; the filter itself is tested elsewhere."""

from __future__ import annotations

import dataclasses
import sys
import types

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from coaster_localization.nodes.eskf import PATH_LENGTH, CoasterEskfNode
from coaster_localization.observation import MatchObservation
from track_localization.errors import DataError
from track_localization.ros.convert import seconds, set_stamp


@dataclasses.dataclass
class FakeEstimate:
    """Figures that differ from each other, so that a mix-up shows."""

    time_s: float
    position: np.ndarray = dataclasses.field(default_factory=lambda: np.array([1.0, 2.0, 3.0]))
    quaternion: np.ndarray = dataclasses.field(default_factory=lambda: np.array([0, 0, 0.6, 0.8]))
    velocity_body: np.ndarray = dataclasses.field(default_factory=lambda: np.array([4.0, 5, 6]))
    angular_rate: np.ndarray = dataclasses.field(default_factory=lambda: np.array([7.0, 8, 9]))
    pose_covariance: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(6) * 2.0)
    twist_covariance: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(6) * 3.0)
    chainage: float = 55.5
    sigma_along: float = 0.5


class FakeFilter:
    """Stands for CoasterEskf: keeps what it was given, answers every sample."""

    def __init__(self, design, config, line) -> None:
        self.design, self.config, self.line = design, config, line
        self.pushed, self.starts, self.resets = [], [], 0
        self.rejected = {'imu': {'backward_time': 2}}

    def push(self, measurement):
        self.pushed.append(measurement)
        is_match = isinstance(measurement, MatchObservation)
        return [] if is_match else [FakeEstimate(measurement.time_s)]

    def reset(self) -> None:
        self.resets += 1

    def set_start(self, position, covariance, R_nb=None) -> None:
        self.starts.append((position, covariance, R_nb))

    def diagnostics(self):
        return {'speed_mps': 3.5, 'status': 'running'}


def imu(time_s, force=(0.0, 0.0, 9.81), rate=(0.0, 0.0, 0.0), frame='imu_link') -> Imu:
    msg = Imu()
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    a, g = msg.linear_acceleration, msg.angular_velocity
    a.x, a.y, a.z = map(float, force)
    g.x, g.y, g.z = map(float, rate)
    return msg


def pose(time_s, x=1.0, frame='map', variance=(4.0, 1.0, 1.0)) -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    msg.pose.pose.position.x = x
    for k in range(3):
        msg.pose.covariance[7 * k] = variance[k]
    return msg


@pytest.fixture
def fake(ros, circle_file):
    def make(**parameters):
        return ros.make(CoasterEskfNode, FakeFilter, design_ride=str(circle_file), **parameters)

    return make


@pytest.fixture
def talk(ros):
    """Return (node, publish), which sends a message on a topic once somebody listens."""
    node = ros.node('talker')
    publishers = {}

    def publish(topic, msg):
        if topic not in publishers:
            publishers[topic] = node.create_publisher(type(msg), topic, 100)
            ros.wait_matched(publishers[topic])
            ros.spin_for(0.2)
        publishers[topic].publish(msg)

    return node, publish


def test_an_estimate_is_published_as_odometry_and_chainage(ros, fake, talk):
    fake(frame_map='site', frame_base='train')
    node, publish = talk
    odometries = ros.listen(node, Odometry, 'odometry')
    chainages = ros.listen(node, PoseWithCovarianceStamped, 'track/pose')
    publish('imu/data_raw', imu(12.25))
    assert ros.spin_until(lambda: odometries and chainages)
    msg = odometries[0]
    assert (msg.header.frame_id, msg.child_frame_id) == ('site', 'train')
    assert msg.header.stamp == Time(sec=12, nanosec=250_000_000)
    assert msg.pose.pose.position.z == 3.0
    assert msg.pose.pose.orientation.w == 0.8
    assert msg.twist.twist.linear.x == 4.0
    assert msg.twist.twist.angular.z == 9.0
    np.testing.assert_array_equal(msg.pose.covariance.reshape(6, 6), np.eye(6) * 2.0)
    np.testing.assert_array_equal(msg.twist.covariance.reshape(6, 6), np.eye(6) * 3.0)
    along = chainages[0]
    assert along.header.frame_id == 'track'
    assert along.header.stamp == msg.header.stamp
    assert along.pose.pose.position.x == 55.5
    assert along.pose.covariance[0] == 0.25


def test_the_mount_is_applied_before_the_filter(fake):
    """Yaw 90 deg: the sensor's x points to the vehicle's left."""
    node = fake(mount_rpy_deg=[0, 0, 90])
    node.on_imu(imu(1.0, force=(1.0, 0.0, 9.81), rate=(0.0, 0.2, 0.0)))
    sample = node.filter.pushed[0]
    np.testing.assert_allclose(sample.specific_force, [0.0, 1.0, 9.81], atol=1e-12)
    np.testing.assert_allclose(sample.angular_rate, [-0.2, 0.0, 0.0], atol=1e-12)


def test_a_match_is_passed_on_with_its_own_stamp(ros, fake, talk):
    node = fake()
    _, publish = talk
    node.on_imu(imu(20.0))
    publish('srdtw/pose', pose(17.5, x=8.0))
    assert ros.spin_until(lambda: len(node.filter.pushed) == 2)
    match = node.filter.pushed[1]
    assert match.time_s == 17.5
    np.testing.assert_array_equal(match.position, [8.0, 0.0, 0.0])
    np.testing.assert_array_equal(match.covariance, np.diag([4.0, 1.0, 1.0]))
    assert np.isnan(match.chainage)
    assert node.match.latency_s == pytest.approx(2.5)


def test_initialpose_in_map_sets_the_start(ros, fake, talk):
    node = fake()
    _, publish = talk
    publish('initialpose', pose(1.0, x=5.0))
    assert ros.spin_until(lambda: node.filter.starts)
    position, covariance, R_nb = node.filter.starts[0]
    np.testing.assert_array_equal(position, [5.0, 0.0, 0.0])
    np.testing.assert_array_equal(covariance, np.diag([4.0, 1.0, 1.0]))
    np.testing.assert_allclose(R_nb, np.eye(3), atol=1e-12)


@pytest.mark.parametrize('s', [3.0, 100.0, 200.0, 251.3])
def test_a_start_surer_than_any_along_the_track_stays_a_covariance(fake, s):
    """1e-300 would be lost in rounding beside what is unsure across it."""
    node = fake()
    node.on_initialpose(pose(1.0, x=s, frame='track', variance=(1e-300, 0.0, 0.0)))
    ((_, covariance, R_nb),) = node.filter.starts
    assert R_nb[:, 0] @ covariance @ R_nb[:, 0] == pytest.approx(1e-8, rel=0.1)


def test_initialpose_along_the_track_sets_the_start(fake):
    """A quarter round of the 40 m circle: on the y axis, heading along -x."""
    node = fake()
    node.on_initialpose(pose(1.0, x=20.0 * np.pi, frame='track'))
    position, covariance, R_nb = node.filter.starts[0]
    np.testing.assert_allclose(position, [0.0, 40.0, 0.0], atol=0.05)
    np.testing.assert_allclose(R_nb[:, 0], [-1.0, 0.0, 0.0], atol=5e-3)
    assert covariance[0, 0] == pytest.approx(4.0, rel=1e-3)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_a_bad_initialpose_changes_nothing_and_is_counted(fake):
    node = fake()
    node.on_initialpose(pose(1.0, variance=(0.0, 0.0, 0.0)))
    node.on_initialpose(pose(1.0, frame='odom'))
    node.on_initialpose(pose(1.0, frame='track', variance=(-1.0, 0.0, 0.0)))
    assert node.filter.starts == []
    assert dict(node.start.rejected) == {'covariance_not_positive': 2, 'wrong_frame': 1}


def test_the_path_is_decimated_bounded_and_published(ros, fake, talk):
    node = fake(eskf__path_rate_hz=5.0)
    listener, _ = talk
    paths = ros.listen(listener, Path, 'path')
    for i in range(1000):
        node.on_imu(imu(10.0 + i / 100.0))
    assert ros.spin_until(lambda: paths, 5.0)
    stamps = [seconds(p.header.stamp) for p in paths[-1].poses]
    assert len(stamps) == pytest.approx(50, abs=1)
    assert np.diff(stamps) == pytest.approx(0.2, abs=0.011)
    assert paths[-1].header.frame_id == 'map'
    for i in range(5 * PATH_LENGTH):
        node.on_imu(imu(100.0 + i))
    assert len(node._path) == PATH_LENGTH


def test_reset_starts_anew(ros, fake, talk):
    node = fake()
    caller, _ = talk
    node.on_imu(imu(10.0))
    client = caller.create_client(Trigger, 'coaster_eskf/reset')
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().success
    assert node.filter.resets == 1
    assert len(node._path) == 0


def test_diagnostics_tell_counts_reasons_and_figures(ros, fake, talk):
    node = fake()
    listener, _ = talk
    arrays = ros.listen(listener, DiagnosticArray, '/diagnostics')
    for i in range(50):
        node.on_imu(imu(10.0 + i / 100.0))
    node.on_imu(imu(10.5, frame=''))
    node.on_imu(imu(10.5, force=(np.nan, 0.0, 0.0)))
    node.on_imu(imu(10.6))
    assert ros.spin_until(lambda: arrays, 5.0)
    status = {s.name: s for s in arrays[0].status}
    values = {k.key: k.value for k in status['coaster_eskf: imu'].values}
    assert status['coaster_eskf: imu'].level == DiagnosticStatus.WARN
    assert (values['received'], values['rejected']) == ('53', '4')
    assert values['rejected.empty_frame'] == '1'
    assert values['rejected.not_finite'] == '1'
    assert values['rejected.backward_time'] == '2'
    assert (values['gaps'], values['lost']) == ('1', '10')
    assert {k.key: k.value for k in status['coaster_eskf'].values}['speed_mps'] == '3.5'


def test_diagnostics_are_told_when_simulated_time_stands_still(ros, fake, talk):
    fake(use_sim_time=True)
    listener, publish = talk
    arrays = ros.listen(listener, DiagnosticArray, '/diagnostics')
    publish('/clock', Clock(clock=Time(sec=77)))
    assert ros.spin_until(lambda: len(arrays) >= 2, 5.0)
    assert arrays[-1].header.stamp == Time(sec=77)


def test_transforms_are_sent_where_tf_is_installed(fake, monkeypatch):
    sent = []
    module = types.ModuleType('tf2_ros')
    module.TransformBroadcaster = lambda node: types.SimpleNamespace(sendTransform=sent.append)
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    node = fake(publish_tf=True, frame_map='site', frame_base='train')
    node.on_imu(imu(3.5))
    assert (sent[0].header.frame_id, sent[0].child_frame_id) == ('site', 'train')
    assert sent[0].header.stamp == Time(sec=3, nanosec=500_000_000)
    assert sent[0].transform.translation.y == 2.0
    assert sent[0].transform.rotation.w == 0.8


def test_without_tf_the_node_works_all_the_same(fake, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    node = fake(publish_tf=True)
    node.on_imu(imu(3.5))
    assert len(node.filter.pushed) == 1


def test_no_transforms_by_default(fake, monkeypatch):
    module = types.ModuleType('tf2_ros')
    module.TransformBroadcaster = lambda node: pytest.fail('made a broadcaster')
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    fake().on_imu(imu(3.5))


def test_settings_reach_the_filter(fake):
    node = fake(eskf__history_s=3, eskf__preset='paper')
    assert node.filter.config.history_s == 3.0
    assert node.filter.config.preset == 'paper'
    assert len(node.filter.design) == 3300


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({}, r'parameter design_ride: not given; .* \(-p design_ride:=PATH\)'),
        ({'design_ride': '/none.csv'}, r'parameter design_ride: /none\.csv'),
        ({'design_ride': __file__}, r'parameter design_ride: .*column'),
        ({'eskf__history_s': -1.0}, r'parameter eskf\.history_s: -1\.0 s is below'),
        ({'mount_rpy_deg': [0.0, 0.0, 360.0]}, r'parameter mount_rpy_deg: 360\.0 deg is above'),
        ({'publish_tf': 'maybe'}, 'parameter publish_tf'),
    ],
)
def test_bad_parameters_are_refused_in_one_line(ros, parameters, said):
    with pytest.raises(DataError, match=said) as caught:
        ros.make(CoasterEskfNode, FakeFilter, **parameters)
    assert '\n' not in str(caught.value)


def test_parameters_cannot_change_at_run_time(fake):
    result = fake().set_parameters([Parameter('eskf.history_s', value=3.0)])[0]
    assert not result.successful
    assert 'read at start' in result.reason


def test_the_real_filter_follows_the_circle(ros, circle_file, circle, talk):
    """
    Perfect IMU data, no match: 3 s at rest, 12 s of ride.

    The acceleration's step of 2 m/s^2 falls between two samples: 0.01 m/s, 0.12 m after 12 s; 0.25
    is twice that. A frame, sign or stamp gone wrong is off by metres.
    """
    ros.make(CoasterEskfNode, design_ride=str(circle_file))
    listener, publish = talk
    odometries = ros.listen(listener, Odometry, 'odometry')
    chainages = ros.listen(listener, PoseWithCovarianceStamped, 'track/pose')
    for i in range(1500):
        publish(
            'imu/data_raw', imu(circle.time_s[i], circle.specific_force[i], circle.angular_rate[i])
        )
        if i % 20 == 0:
            ros.spin_until(lambda least=i - 130: len(odometries) > least, 1.0)
    assert ros.spin_until(lambda: len(odometries) >= 1500 <= len(chainages))
    assert [round(seconds(m.header.stamp) * 100) for m in odometries] == list(range(1500))
    for m, s in zip(odometries[::50], chainages[::50], strict=True):
        i = round(seconds(m.header.stamp) * 100)
        p, v = m.pose.pose.position, m.twist.twist.linear
        assert np.linalg.norm(np.array([p.x, p.y, p.z]) - circle.position[i]) < 0.25
        assert v.x == pytest.approx(np.linalg.norm(circle.velocity[i]), abs=0.05)
        assert abs(v.y) < 0.1
        assert s.pose.pose.position.x == pytest.approx(circle.chainage[i], abs=0.25)

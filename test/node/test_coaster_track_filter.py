"""The track filter's node: messages in, odometry out; the filter itself is tested elsewhere."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger

from coaster_localization.nodes.track_filter import CoasterTrackFilterNode
from coaster_localization.track_live import LiveTrackFilter
from track_localization.errors import DataError
from track_localization.ros.convert import seconds, set_stamp

ROUND_M = 80.0 * np.pi
"""Length of the circle of conftest."""


@dataclasses.dataclass
class FakeEstimate:
    """Figures that differ from each other, so that a mix-up shows."""

    time_s: float
    chainage: float = 55.5
    position: np.ndarray = dataclasses.field(default_factory=lambda: np.array([1.0, 2.0, 3.0]))
    quaternion: np.ndarray = dataclasses.field(default_factory=lambda: np.array([0, 0, 0.6, 0.8]))
    velocity_body: np.ndarray = dataclasses.field(default_factory=lambda: np.array([4.0, 5, 6]))
    angular_rate: np.ndarray = dataclasses.field(default_factory=lambda: np.array([7.0, 8, 9]))
    pose_covariance: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(6) * 2.0)
    twist_covariance: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(6) * 3.0)
    sigma_along: float = 0.5


class FakeFilter:
    """Stands for LiveTrackFilter: answers every sample, smooths one a second before."""

    def __init__(self, design, config) -> None:
        self.design, self.config = design, config
        self.pushed, self.resets, self.laps = [], 0, 0
        self.rejected = {'imu': {'backward_time': 2}}

    def push(self, sample):
        self.pushed.append(sample)
        return [FakeEstimate(sample.time_s)]

    def smoothed(self):
        return [FakeEstimate(self.pushed[-1].time_s - 1.0, position=np.array([9.0, 8.0, 7.0]))]

    def lap_completed(self, estimate) -> bool:
        done = estimate.time_s == 20.0
        self.laps += 3 * done
        return done

    def reset(self) -> None:
        self.resets += 1

    def diagnostics(self):
        return {'speed_mps': 3.5, 'lost_probability': 0.25, 'status': 'running'}


def imu(time_s, force=(0.0, 0.0, 9.81), rate=(0.0, 0.0, 0.0), frame='imu_link') -> Imu:
    msg = Imu()
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    a, g = msg.linear_acceleration, msg.angular_velocity
    a.x, a.y, a.z = map(float, force)
    g.x, g.y, g.z = map(float, rate)
    return msg


def pose(x, y=0.0, frame='map', variance=(4.0, 1.0, 1.0)) -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = frame
    msg.pose.pose.position.x, msg.pose.pose.position.y = float(x), float(y)
    for k in range(3):
        msg.pose.covariance[7 * k] = variance[k]
    return msg


@pytest.fixture
def fake(ros, circle_file):
    def make(**parameters):
        return ros.make(
            CoasterTrackFilterNode, FakeFilter, design_ride=str(circle_file), **parameters
        )

    return make


@pytest.fixture
def real(ros, circle_file):
    return ros.make(CoasterTrackFilterNode, design_ride=str(circle_file))


def test_an_estimate_is_published_as_odometry_and_chainage(ros, fake):
    node = fake(frame_map='site', frame_base='train')
    listener = ros.node('listener')
    odometries = ros.listen(listener, Odometry, 'odometry')
    chainages = ros.listen(listener, PoseWithCovarianceStamped, 'track/pose')
    ros.wait_matched(node._odometry_pub)
    ros.wait_matched(node._chainage_pub)
    node.on_imu(imu(12.25))
    assert ros.spin_until(lambda: odometries and chainages)
    msg, along = odometries[0], chainages[0]
    assert (msg.header.frame_id, msg.child_frame_id) == ('site', 'train')
    assert msg.header.stamp == Time(sec=12, nanosec=250_000_000) == along.header.stamp
    assert (msg.pose.pose.position.z, msg.pose.pose.orientation.w) == (3.0, 0.8)
    assert (msg.twist.twist.linear.x, msg.twist.twist.angular.z) == (4.0, 9.0)
    np.testing.assert_array_equal(msg.pose.covariance.reshape(6, 6), np.eye(6) * 2.0)
    np.testing.assert_array_equal(msg.twist.covariance.reshape(6, 6), np.eye(6) * 3.0)
    assert along.header.frame_id == 'track'
    assert (along.pose.pose.position.x, along.pose.covariance[0]) == (55.5, 0.25)


def test_smoothed_odometry_has_its_own_stamp_and_topic(ros, fake):
    node = fake(frame_map='site', frame_base='train')
    lagged = ros.listen(ros.node('listener'), Odometry, 'odometry_lag')
    ros.wait_matched(node._lag_pub)
    node.on_imu(imu(12.25))
    assert ros.spin_until(lambda: lagged)
    assert (lagged[0].header.frame_id, lagged[0].child_frame_id) == ('site', 'train')
    assert lagged[0].header.stamp == Time(sec=11, nanosec=250_000_000)
    assert lagged[0].pose.pose.position.x == 9.0


def test_a_lap_is_told_once(ros, fake):
    node = fake()
    laps = ros.listen(ros.node('listener'), UInt32, 'lap')
    ros.wait_matched(node._lap_pub)
    for time_s in (19.99, 20.0, 20.01):
        node.on_imu(imu(time_s))
    assert ros.spin_until(lambda: laps)
    ros.spin_for(0.2)
    assert [msg.data for msg in laps] == [3]


def test_the_mount_is_applied_before_the_filter(fake):
    """Yaw 90 deg: the sensor's x points to the vehicle's left."""
    node = fake(mount_rpy_deg=[0, 0, 90])
    node.on_imu(imu(1.0, force=(1.0, 0.0, 9.81), rate=(0.0, 0.2, 0.0)))
    sample = node.filter.pushed[0]
    np.testing.assert_allclose(sample.specific_force, [0.0, 1.0, 9.81], atol=1e-12)
    np.testing.assert_allclose(sample.angular_rate, [-0.2, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ('start', 'expected'),
    [
        (pose(60.0, frame='track', variance=(0.25, 0.0, 0.0)), (60.0, 0.5)),
        (pose(60.0 + ROUND_M, frame='track', variance=(0.25, 0.0, 0.0)), (60.0, 0.5)),
        # A quarter round, 2 m outside: along the circle is -x there, of variance 1.
        (pose(0.0, 42.0, variance=(1.0, 4.0, 4.0)), (20.0 * np.pi, 1.0)),
    ],
)
def test_initialpose_says_where_the_train_stands(ros, real, start, expected):
    """Heard over DDS; the estimates that follow are there, that uncertain."""
    talker = ros.node('talker')
    publisher = talker.create_publisher(PoseWithCovarianceStamped, 'initialpose', 10)
    ros.wait_matched(publisher)
    publisher.publish(start)
    assert ros.spin_until(lambda: real.start.received)
    assert not real.start.rejected
    for i in range(150):
        real.on_imu(imu(10.0 + i / 100.0))
    along = real._chainage
    assert along.pose.pose.position.x == pytest.approx(expected[0], abs=0.05)
    assert along.pose.covariance[0] ** 0.5 == pytest.approx(expected[1], rel=0.1)


def test_initialpose_moves_a_train_that_rides(real, circle):
    for i in range(1000):
        real.on_imu(imu(circle.time_s[i], circle.specific_force[i], circle.angular_rate[i]))
    before = real._chainage.pose.pose.position.x
    real.on_initialpose(pose(before + 20.0, frame='track', variance=(0.01, 0.0, 0.0)))
    i = 1000
    real.on_imu(imu(circle.time_s[i], circle.specific_force[i], circle.angular_rate[i]))
    assert real._chainage.pose.pose.position.x == pytest.approx(before + 20.1, abs=0.3)


def test_a_bad_initialpose_changes_nothing_and_is_counted(real):
    bad = [
        pose(40.0, variance=(0.0, 0.0, 0.0)),
        pose(40.0, frame='odom'),
        pose(40.0, frame=''),
        pose(40.0, frame='track', variance=(-1.0, 0.0, 0.0)),
        pose(float('nan'), frame='track'),
        pose(400.0, 0.0),
    ]
    for msg in bad:
        real.on_initialpose(msg)
    assert dict(real.start.rejected) == {
        'covariance_not_positive': 2,
        'wrong_frame': 1,
        'empty_frame': 1,
        'not_finite': 1,
        'off_track': 1,
    }
    for i in range(150):
        real.on_imu(imu(10.0 + i / 100.0))
    assert real._chainage.pose.pose.position.x % ROUND_M == pytest.approx(0.0, abs=0.05)


def test_reset_starts_anew(ros, fake):
    node = fake()
    paths = ros.listen(ros.node('listener'), Path, 'path')
    node.on_imu(imu(10.0))
    assert ros.spin_until(lambda: paths, 5.0)
    caller = ros.node('caller')
    client = caller.create_client(Trigger, 'coaster_track_filter/reset')
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().success
    assert node.filter.resets == 1
    assert len(node._path) == 0


def test_diagnostics_tell_counts_reasons_and_figures(ros, fake):
    node = fake()
    arrays = ros.listen(ros.node('listener'), DiagnosticArray, '/diagnostics')
    for i in range(50):
        node.on_imu(imu(10.0 + i / 100.0))
    node.on_imu(imu(10.5, frame=''))
    node.on_imu(imu(10.5, force=(np.nan, 0.0, 0.0)))
    assert ros.spin_until(lambda: arrays, 5.0)
    status = {s.name: s for s in arrays[0].status}
    values = {k.key: k.value for k in status['coaster_track_filter: imu'].values}
    assert status['coaster_track_filter: imu'].level == DiagnosticStatus.WARN
    assert (values['received'], values['rejected']) == ('52', '4')
    assert values['rejected.empty_frame'] == values['rejected.not_finite'] == '1'
    assert values['rejected.backward_time'] == '2'
    core = status['coaster_track_filter']
    assert core.message == 'running'
    assert {k.key: k.value for k in core.values}['lost_probability'] == '0.25'


def test_diagnostics_of_the_real_filter(ros, real, circle):
    """After 13 s of the ride: chainage, speed, sigma, doubt and lag, and what it is doing."""
    assert real.filter.diagnostics()['status'].startswith('waiting')
    for i in range(1300):
        real.on_imu(imu(circle.time_s[i], circle.specific_force[i], circle.angular_rate[i]))
    figures = real.filter.diagnostics()
    assert figures['status'] == 'running'
    assert figures['chainage_m'] == pytest.approx(circle.chainage[1299], abs=0.5)
    assert figures['speed_mps'] == pytest.approx(12.0, abs=0.2)
    assert 0.0 < figures['chainage_sigma_m'] < 2.0
    assert figures['lost_probability'] < 0.01
    assert 1.0 <= figures['lag_latency_s'] < 1.3
    assert figures['laps'] == 0


def test_health_is_told_when_simulated_time_stands_still(ros, fake):
    fake(use_sim_time=True)
    listener = ros.node('listener')
    clock = listener.create_publisher(Clock, '/clock', 10)
    arrays = ros.listen(listener, DiagnosticArray, '/diagnostics')
    ros.wait_matched(clock)
    clock.publish(Clock(clock=Time(sec=77)))
    assert ros.spin_until(lambda: len(arrays) >= 2, 5.0)
    assert arrays[-1].header.stamp == Time(sec=77)


def test_settings_reach_the_filter(fake):
    node = fake(track_filter__lag_s=3, track_filter__rest_s=2.5)
    assert (node.filter.config.lag_s, node.filter.config.rest_s) == (3.0, 2.5)
    assert len(node.filter.design) == 3300
    result = node.set_parameters([Parameter('track_filter.lag_s', value=2.0)])[0]
    assert not result.successful
    assert 'read at start' in result.reason


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({}, r'parameter design_ride: not given; .* \(-p design_ride:=PATH\)'),
        ({'design_ride': '/none.csv'}, r'parameter design_ride: /none\.csv'),
        ({'track_filter__lag_s': -1.0}, r'parameter track_filter\.lag_s: -1\.0 s is below'),
        ({'mount_rpy_deg': [0.0, 0.0, 360.0]}, r'parameter mount_rpy_deg: 360\.0 deg is above'),
    ],
)
def test_bad_parameters_are_refused_in_one_line(ros, parameters, said):
    with pytest.raises(DataError, match=said) as caught:
        ros.make(CoasterTrackFilterNode, FakeFilter, **parameters)
    assert '\n' not in str(caught.value)


def test_warming_up_leaves_no_trace(ros, real, circle_file, circle):
    warm = ros.make(CoasterTrackFilterNode, LiveTrackFilter, True, design_ride=str(circle_file))
    for i in range(600):
        msg = imu(circle.time_s[i], circle.specific_force[i], circle.angular_rate[i])
        real.on_imu(msg)
        warm.on_imu(msg)
    assert warm.filter.rejected == {}
    assert warm._chainage == real._chainage
    assert warm._odometry == real._odometry


def test_the_real_filter_goes_round_the_circle(ros, real, circle):
    """
    Perfect IMU data over more than one lap: 3 s at rest, 30 s of ride, and one lap told.

    A level circle turns evenly, so gyro scale and place are told apart by little: 0.5 m of 324 m is
    what its 0.4 % prior leaves after fusing. A frame, sign or stamp gone wrong is off by metres.
    """
    listener = ros.node('listener')
    odometries = ros.listen(listener, Odometry, 'odometry')
    lagged = ros.listen(listener, Odometry, 'odometry_lag')
    laps = ros.listen(listener, UInt32, 'lap')
    for publisher in (real._odometry_pub, real._lag_pub, real._lap_pub):
        ros.wait_matched(publisher)
    told = None
    for i in range(len(circle)):
        real.on_imu(imu(circle.time_s[i], circle.specific_force[i], circle.angular_rate[i]))
        if i % 50 == 0:
            ros.spin_for(0.01)
        if told is None and real.filter.laps:
            told = i
    newest_s = circle.time_s[-1]
    assert ros.spin_until(lambda: seconds(odometries[-1].header.stamp) == newest_s and laps)
    stamps = [round(seconds(m.header.stamp) * 100) for m in odometries]
    assert stamps == list(range(stamps[0], len(circle)))
    assert stamps[0] <= 101
    assert [msg.data for msg in laps] == [1]
    assert circle.chainage[told] == pytest.approx(ROUND_M, abs=0.5)
    for m in [*odometries[::50], *lagged[::10]]:
        i = round(seconds(m.header.stamp) * 100)
        p, v, w = m.pose.pose.position, m.twist.twist.linear, m.twist.twist.angular
        assert np.linalg.norm(np.array([p.x, p.y, p.z]) - circle.position[i]) < 0.5
        assert v.x == pytest.approx(np.linalg.norm(circle.velocity[i]), abs=0.1)
        assert (v.y, v.z) == pytest.approx((0.0, 0.0), abs=0.1)
        assert w.z == pytest.approx(circle.angular_rate[i, 2], abs=0.01)

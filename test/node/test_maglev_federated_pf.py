"""The maglev's node: messages in, odometry out; the filter itself is tested elsewhere."""

from __future__ import annotations

import math
import sys
import time
import types

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from helpers.maglev_messages import FakeFilter, balise, loop, radar, start
from nav_msgs.msg import Odometry, Path
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from maglev_localization.nodes.federated_pf import MaglevFederatedPfNode
from track_localization.ros.convert import seconds

ORIGIN, FORWARD = np.array([100.0, 200.0, 5.0]), np.array([0.6, 0.8, 0.0])
YAW, LENGTH_M = math.atan2(0.8, 0.6), 3000.0
"""The straight line of ``maglev_files``."""


@pytest.fixture
def fake(ros, maglev_files):
    def make(**parameters):
        given = {'balises': maglev_files['balises']} | parameters
        return ros.make(MaglevFederatedPfNode, FakeFilter, **given)

    return make


def test_measurements_reach_the_filter_with_their_own_stamps(ros, fake, talk):
    node, publish = fake(), talk
    publish('loop/pose', loop(12.25, 50.25))
    publish('radar/twist', radar(11.5, -3.0))
    publish('balise/pose', balise(12.0, 'x_7'))
    assert ros.spin_until(lambda: len(node.filter.pushed) == 3)
    assert set(node.filter.pushed) == {
        LoopPosition(12.25, 50.25, 0.01),
        RadarSpeed(11.5, -3.0, 0.04),
        BalisePassing(12.0, 'x_7', -0.4, 0.0025),
    }
    assert [s.received for s in (node.loop, node.radar, node.balise)] == [1, 1, 1]


def test_a_backlog_is_handled_in_the_order_of_arrival(ros, fake, rng):
    """The node was busy for a while: its filter must not get 100 readings of one sensor first."""
    node, talker = fake(), ros.node('talker')
    publishers = [
        talker.create_publisher(type(msg), topic, 500)
        for topic, msg in (
            *(('loop/pose', loop(0.0)), ('radar/twist', radar(0.0))),
            *(('balise/pose', balise(0.0, 'a')),),
        )
    ]
    for publisher in publishers:
        ros.wait_matched(publisher)
    ros.spin_for(0.2)
    which = rng.integers(0, 3, 400).tolist()
    for i, k in enumerate(which):
        publishers[k].publish((loop(i), radar(i), balise(i, 'a'))[k])
    time.sleep(0.3)
    assert ros.spin_until(lambda: len(node.filter.pushed) == 400)
    assert [measurement.time_s for measurement in node.filter.pushed] == list(range(400))


def test_an_estimate_is_published_as_odometry_and_chainage(ros, fake):
    """Without a track file x is the chainage."""
    node = fake(frame_map='site', frame_base='train')
    listener = ros.node('listener')
    odometries = ros.listen(listener, Odometry, 'odometry')
    chainages = ros.listen(listener, PoseWithCovarianceStamped, 'track/pose')
    ros.wait_matched(node._odometry_pub)
    ros.wait_matched(node._chainage_pub)
    node.on_radar(radar(12.25, frame='train'))
    assert ros.spin_until(lambda: odometries and chainages)
    msg, along = odometries[0], chainages[0]
    assert (msg.header.frame_id, msg.child_frame_id) == ('site', 'train')
    assert msg.header.stamp == Time(sec=12, nanosec=250_000_000) == along.header.stamp
    p, q = msg.pose.pose.position, msg.pose.pose.orientation
    assert (p.x, p.y, p.z, q.x, q.y, q.z, q.w) == (1234.5, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    assert (msg.twist.twist.linear.x, msg.twist.twist.linear.y) == (20.0, 0.0)
    assert (msg.pose.covariance[0], msg.twist.covariance[0]) == (4.0, 0.25)
    assert along.header.frame_id == 'track'
    assert (along.pose.pose.position.x, along.pose.covariance[0]) == (1234.5, 4.0)


def test_with_a_track_the_train_is_on_it(fake, maglev_files):
    node = fake(track=maglev_files['track'], placing__across_sigma_m=0.3)
    node.on_radar(radar(12.25))
    pose, twist = node._odometry.pose, node._odometry.twist
    p, q = pose.pose.position, pose.pose.orientation
    np.testing.assert_allclose([p.x, p.y, p.z], ORIGIN + 1234.5 * FORWARD, atol=1e-6)
    expected = [0.0, 0.0, math.sin(0.5 * YAW), math.cos(0.5 * YAW)]
    np.testing.assert_allclose([q.x, q.y, q.z, q.w], expected, atol=1e-9)
    axes = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    P = axes @ np.diag([4.0, 0.09, 0.09]) @ axes.T
    np.testing.assert_allclose(pose.covariance.reshape(6, 6)[:3, :3], P, atol=1e-6)
    assert twist.twist.linear.x == pytest.approx(20.0)
    assert node.filter.line_length_m == pytest.approx(LENGTH_M, abs=1e-3)


@pytest.mark.parametrize(
    ('sensor', 'msg', 'reason'),
    [
        ('loop', loop(1.0, math.nan), 'not_finite'),
        ('loop', loop(1.0, 1e300), 'implausible'),
        ('loop', loop(1.0, frame='map'), 'wrong_frame'),
        ('loop', loop(1.0, frame=''), 'empty_frame'),
        ('loop', loop(1.0, variance=-1.0), 'covariance_not_positive'),
        ('loop', loop(1.0, variance=math.inf), 'covariance_not_finite'),
        ('radar', radar(1.0, math.inf), 'not_finite'),
        ('radar', radar(1.0, frame='radar_link'), 'wrong_frame'),
        ('radar', radar(1.0, variance=0.0), 'covariance_not_positive'),
        ('balise', balise(1.0, ''), 'wrong_frame'),
        ('balise', loop(1.0), 'wrong_frame'),
        ('balise', balise(1.0, 'a', math.nan), 'not_finite'),
        ('balise', balise(1.0, 'a', variance=math.nan), 'covariance_not_finite'),
    ],
)
def test_a_bad_message_is_counted_and_goes_no_further(fake, sensor, msg, reason):
    node = fake()
    getattr(node, f'on_{sensor}')(msg)
    assert node.filter.pushed == []
    stream = getattr(node, sensor)
    assert (dict(stream.rejected), stream.received) == ({reason: 1}, 1)


@pytest.mark.parametrize(
    ('with_track', 'msg', 'expected'),
    [
        (False, start(700.0, frame='track'), (700.0, 4.0)),
        (True, start(700.0, frame='track'), (700.0, 4.0)),
        (False, start(700.0, 55.0), (700.0, 4.0)),
        # 3 m to the left of 1000 m; along the line lie 0.36 of x and 0.64 of y.
        (True, start(100.0 + 600.0 - 2.4, 200.0 + 800.0 + 1.8, 5.0), (1000.0, 1.44 + 0.64)),
    ],
)
def test_initialpose_says_where_the_train_is(
    ros, fake, maglev_files, talk, with_track, msg, expected
):
    node = fake(track=maglev_files['track']) if with_track else fake()
    talk('initialpose', msg)
    assert ros.spin_until(lambda: node.filter.starts)
    assert node.filter.starts[0] == pytest.approx(expected, abs=1e-6)


def test_a_bad_initialpose_changes_nothing_and_is_counted(fake, maglev_files):
    node = fake(track=maglev_files['track'])
    bad = [
        start(700.0, variance=(0.0, 0.0, 0.0)),
        start(700.0, frame='odom'),
        start(700.0, frame=''),
        start(700.0, frame='track', variance=(-1.0, 0.0, 0.0)),
        start(math.nan, frame='track'),
        start(700.0, -4000.0),
        start(2e4, frame='track'),
    ]
    for msg in bad:
        node.on_initialpose(msg)
    assert node.filter.starts == []
    assert dict(node.start.rejected) == {
        'covariance_not_positive': 2,
        'wrong_frame': 1,
        'empty_frame': 1,
        'not_finite': 1,
        'off_track': 1,
        'off_the_line': 1,
    }


def test_reset_starts_anew(ros, fake):
    node, caller = fake(), ros.node('talker')
    node.on_radar(radar(10.0))
    client = caller.create_client(Trigger, 'maglev_federated_pf/reset')
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().success
    assert (node.filter.resets, len(node._path)) == (1, 0)


def test_the_path_grows_five_times_a_second(ros, fake):
    node = fake()
    paths = ros.listen(ros.node('listener'), Path, 'path')
    for i in range(200):
        node.on_radar(radar(10.0 + i / 20.0))
    assert ros.spin_until(lambda: paths, 5.0)
    stamps = [seconds(p.header.stamp) for p in paths[-1].poses]
    np.testing.assert_allclose(np.diff(stamps), 0.2, atol=0.051)
    assert len(stamps) == pytest.approx(50, abs=2)


def test_diagnostics_tell_each_sensor_and_the_core(ros, fake):
    node = fake()
    arrays = ros.listen(ros.node('listener'), DiagnosticArray, '/diagnostics')
    for i in range(50):
        node.on_loop(loop(10.0 + i / 50.0, i))
        node.on_radar(radar(10.0 + i / 20.0))
    node.on_balise(balise(10.5, 'a'))
    node.on_balise(balise(10.6, 'b'))
    node.on_loop(loop(11.0, math.nan))
    node.on_radar(radar(12.5, frame=''))
    assert ros.spin_until(lambda: arrays, 5.0)
    status = {s.name.removeprefix('maglev_federated_pf'): s for s in arrays[0].status}
    assert set(status) == {'', ': loop', ': radar', ': balise', ': initialpose'}
    values = {name: {v.key: v.value for v in s.values} for name, s in status.items()}
    told = values[': loop']
    assert (told['received'], told['accepted'], told['rejected']) == ('51', '48', '3')
    assert (told['rejected.not_finite'], told['rejected.backward_time']) == ('1', '2')
    # One refused message counts as well: 2 % of 50.
    assert float(told['rate_hz']) == pytest.approx(50.0, rel=0.03)
    assert float(values[': radar']['rate_hz']) == pytest.approx(20.0, rel=0.03)
    assert (told['health'], values[': radar']['nis']) == ('isolated', '0.9')
    assert values[': balise']['rejected.unknown_id'] == '1'
    assert (values['']['n_eff'], values['']['method']) == ('7.5', 'robust')
    assert status[': loop'].level == status[''].level == DiagnosticStatus.WARN


@pytest.fixture
def stranger():
    """Return a node of another participant: one alone cannot have two types on a topic."""
    context = Context()
    rclpy.init(context=context)
    node = Node('stranger', context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.mark.parametrize('first', [True, False])
def test_another_message_type_on_a_topic_is_told(ros, fake, stranger, first):
    """The middleware joins no such publisher, and says nothing."""
    kind = TwistWithCovarianceStamped
    if first:
        stranger.create_publisher(kind, 'loop/pose', 10)
    node = fake()
    if not first:
        stranger.create_publisher(kind, 'loop/pose', 10)
    arrays = ros.listen(ros.node('listener'), DiagnosticArray, '/diagnostics')

    def told() -> set[tuple[bytes, str]]:
        return {(s.level, s.message) for a in arrays for s in a.status if 'loop' in s.name}

    said = (
        'loop: stranger publishes /loop/pose as geometry_msgs/msg/TwistWithCovarianceStamped, '
        'but geometry_msgs/msg/PoseWithCovarianceStamped is needed'
    )
    assert ros.spin_until(lambda: (DiagnosticStatus.ERROR, said) in told(), 5.0)
    node.on_radar(radar(1.0))
    assert len(node.filter.pushed) == 1


def test_transforms_are_sent_where_tf_is_installed(fake, monkeypatch):
    sent = []
    module = types.ModuleType('tf2_ros')
    module.TransformBroadcaster = lambda node: types.SimpleNamespace(sendTransform=sent.append)
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    fake(publish_tf=True, frame_map='site').on_radar(radar(3.5))
    assert (sent[0].header.frame_id, sent[0].child_frame_id) == ('site', 'base_link')
    assert sent[0].transform.translation.x == 1234.5

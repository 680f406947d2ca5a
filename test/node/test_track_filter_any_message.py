"""
The track filter's node dies of no message: whatever arrives, it is used or counted under a reason.

Messages are drawn by hypothesis: NaN, infinities, huge numbers, zero, negative and lopsided
covariances, wrong and empty frames, time backward, repeated, years ahead, gaps, floods. The suite
turns warnings into errors, so an overflow inside the filter fails these tests too.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from coaster_localization.nodes.track_filter import CoasterTrackFilterNode

NASTY = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, -1e300, 1e-300, 9.81, 5e3)
number = st.one_of(st.sampled_from(NASTY), st.floats(-40.0, 40.0))
frame = st.sampled_from(('imu_link', 'map', 'track', 'track', '', 'odom', '/map', 'ü' * 50))
step = st.one_of(
    st.just(0.01),
    st.floats(0.001, 0.05),
    st.sampled_from((0.0, -0.01, -5.0, -1e6, 0.3, 4.9, 5.1, 60.0, 3.2e8, 2e9)),
)
drawn = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def put_stamp(msg, time_s: float, bad_nanoseconds: bool = False) -> None:
    whole = math.floor(time_s)
    msg.header.stamp.sec = int(np.clip(whole, -(2**31), 2**31 - 1))
    msg.header.stamp.nanosec = 4_000_000_000 if bad_nanoseconds else int((time_s - whole) * 1e9)


@st.composite
def imus(draw) -> tuple[float, Imu]:
    """Draw (time since the message before, Imu); most are good, so that the filter does start."""
    msg = Imu()
    msg.header.frame_id = 'imu_link'
    a, g = msg.linear_acceleration, msg.angular_velocity
    a.z = 9.80665
    kind = draw(st.sampled_from(('good', 'good', 'moving', 'nasty', 'frame', 'gyro', 'stamp')))
    if kind == 'moving':
        a.x, a.y, g.z = draw(st.floats(-30.0, 30.0)), draw(st.floats(-30.0, 30.0)), draw(number)
    if kind == 'nasty':
        a.x, a.y, a.z = draw(number), draw(number), draw(number)
        g.x, g.y, g.z = draw(number), draw(number), draw(number)
    if kind == 'frame':
        msg.header.frame_id = draw(frame)
    if kind == 'gyro':
        msg.angular_velocity_covariance[0] = draw(st.sampled_from((-1.0, math.nan, 0.0)))
        msg.linear_acceleration_covariance[0] = draw(st.sampled_from((-1.0, 0.0, 0.0)))
    put_stamp(msg, 0.0, kind == 'stamp' and draw(st.booleans()))
    return draw(step), msg


@st.composite
def starts(draw) -> tuple[float, PoseWithCovarianceStamped]:
    """Draw (time since the Imu before, initialpose), half of them good ones."""
    msg = PoseWithCovarianceStamped()
    good = draw(st.booleans())
    msg.header.frame_id = draw(st.sampled_from(('map', 'track'))) if good else draw(frame)
    p, q = msg.pose.pose.position, msg.pose.pose.orientation
    if good:
        turn = draw(st.floats(-math.pi, math.pi))
        p.x, p.y = 40.0 * math.cos(turn), 40.0 * math.sin(turn)
        q.z, q.w = math.sin(0.5 * turn), math.cos(0.5 * turn)
        size = draw(st.sampled_from((1e-9, 1e-4, 0.01, 1.0, 100.0, 1e8)))
        msg.pose.covariance = (np.eye(6) * size).ravel()
    else:
        p.x, p.y, p.z = draw(number), draw(number), draw(number)
        q.x, q.y, q.z, q.w = draw(number), draw(number), draw(number), draw(number)
        msg.pose.covariance[:] = [draw(number) for _ in range(36)]
    return draw(st.sampled_from((0.0, -0.5, 10.0, 1e9))), msg


class Stream:
    """Turns drawn steps into stamps, and makes good messages at rest."""

    def __init__(self) -> None:
        self.time_s = 1000.0

    def good(self, count: int):
        for _ in range(count):
            self.time_s += 0.01
            msg = Imu()
            msg.header.frame_id = 'imu_link'
            msg.linear_acceleration.z = 9.80665
            put_stamp(msg, self.time_s)
            yield msg

    def stamped(self, dt: float, msg):
        """Stamp a drawn message; one wild stamp does not carry the stream away with it."""
        if msg.header.stamp.nanosec < 1_000_000_000:
            put_stamp(msg, max(self.time_s + dt, -1e9))
        if isinstance(msg, Imu) and abs(dt) < 100.0:
            self.time_s = max(self.time_s + dt, 0.0)
        return msg


@pytest.fixture(scope='module')
def made(ros_module, circle_file):
    """
    Return the node; all that it publishes as odometry is finite, and is kept.

    Long epochs: a storm leaves hundreds of places in doubt, each compared at every epoch.
    """
    settings = {'design_ride': str(circle_file), 'track_filter__epoch_s': 0.2}
    node = ros_module.make(CoasterTrackFilterNode, **settings)
    node.published = []

    def watch(publisher):
        publish = publisher.publish

        def keep(msg: Odometry) -> None:
            p, q = msg.pose.pose.position, msg.pose.pose.orientation
            v, w = msg.twist.twist.linear, msg.twist.twist.angular
            place = (p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z)
            assert np.isfinite(place).all()
            assert np.isfinite(msg.pose.covariance).all()
            assert np.isfinite(msg.twist.covariance).all()
            assert msg.pose.covariance.reshape(6, 6).diagonal().min() > 0.0
            publish(msg)
            node.published.append(publisher)

        publisher.publish = keep

    watch(node._odometry_pub)
    watch(node._lag_pub)
    return node


def anew(node):
    """Return the node as it was when it was made."""
    node.filter.reset()
    node.filter.set_start_chainage(0.0, 0.09)
    node.published.clear()
    return node


@pytest.fixture
def node(made):
    return anew(made)


def feed(node, stream: Stream, messages) -> None:
    for dt, msg in messages:
        stream.stamped(dt, msg)
        (node.on_imu if isinstance(msg, Imu) else node.on_initialpose)(msg)


@drawn
@given(
    rest=st.sampled_from((0, 120, 200)),
    messages=st.lists(st.one_of(imus(), imus(), imus(), starts()), max_size=50),
)
def test_it_survives_and_counts(made, rest, messages):
    anew(made)
    stream, before = Stream(), (made.imu.received, made.start.received)
    for msg in stream.good(rest):
        made.on_imu(msg)
    feed(made, stream, messages)
    sent = sum(isinstance(msg, Imu) for _, msg in messages)
    assert made.imu.received == before[0] + rest + sent
    assert made.start.received == before[1] + len(messages) - sent
    made.diagnostics.publish()
    made.publish_path()


@settings(parent=drawn, max_examples=3)
@given(messages=st.lists(st.one_of(imus(), imus(), starts()), min_size=20, max_size=40))
def test_it_works_again_after_the_storm(made, messages):
    """Six seconds of good samples later estimates come again, one for each sample."""
    anew(made)
    stream = Stream()
    feed(made, stream, messages)
    for msg in stream.good(600):
        made.on_imu(msg)
    made.published.clear()
    for msg in stream.good(20):
        made.on_imu(msg)
    assert made.published.count(made._odometry_pub) == 20


@pytest.mark.parametrize('wild', [3.2e8, -3.2e8])
def test_one_stamp_years_off_does_not_stop_it(node, wild):
    stream = Stream()
    for msg in stream.good(200):
        node.on_imu(msg)
    msg = next(iter(stream.good(1)))
    put_stamp(msg, max(stream.time_s + wild, 0.0))
    node.on_imu(msg)
    node.published.clear()
    for msg in stream.good(100):
        node.on_imu(msg)
    assert node.published.count(node._odometry_pub) == 100


def test_a_flood_of_one_stamp_is_counted(node):
    stream = Stream()
    for msg in stream.good(200):
        node.on_imu(msg)
    node.published.clear()
    for _ in range(3000):
        node.on_imu(msg)
    assert node.filter.rejected['imu']['repeated_time'] == 3000
    assert node.published == []


def test_a_recording_started_over_goes_on(node):
    """Time jumps back by the length of the recording: counted, and a new start is found."""
    stream = Stream()
    for msg in stream.good(500):
        node.on_imu(msg)
    stream.time_s -= 100.0
    for msg in stream.good(700):
        node.on_imu(msg)
    node.published.clear()
    for msg in stream.good(10):
        node.on_imu(msg)
    assert node.published.count(node._odometry_pub) == 10


@pytest.mark.parametrize('frame_id', ['map', 'track'])
def test_zero_covariances_of_initialpose_are_refused(node, frame_id):
    before = node.start.rejected['covariance_not_positive']
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id, msg.pose.pose.position.x = frame_id, 40.0
    node.on_initialpose(msg)
    assert node.start.rejected['covariance_not_positive'] == before + 1


def test_a_flood_of_starts_is_borne(node):
    stream = Stream()
    for msg in stream.good(200):
        node.on_imu(msg)
    start = PoseWithCovarianceStamped()
    start.header.frame_id, start.pose.pose.position.x = 'track', 40.0
    start.pose.covariance = np.eye(6).ravel()
    for _ in range(500):
        node.on_initialpose(start)
    node.published.clear()
    for msg in stream.good(150):
        node.on_imu(msg)
    assert node.published.count(node._odometry_pub) == 150
    assert node._chainage.pose.pose.position.x == pytest.approx(40.0, abs=0.5)

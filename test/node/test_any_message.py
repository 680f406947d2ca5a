"""
No node dies of any message: whatever arrives, it is used or counted under a reason.

Messages are drawn by hypothesis: NaN, infinities, huge numbers, zero, negative and lopsided
covariances, wrong and empty frames, time backward, repeated, years ahead, gaps, floods. The suite
turns warnings into errors, so an overflow inside a filter fails these tests too.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import Imu

from coaster_localization.nodes.eskf import CoasterEskfNode
from coaster_localization.nodes.srdtw_matcher import SrdtwMatcherNode
from coaster_localization.observation import MatchObservation

NASTY = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, -1e300, 1e-300, 9.81, 5e3)
number = st.one_of(st.sampled_from(NASTY), st.floats(-40.0, 40.0))
frame = st.sampled_from(
    ('imu_link', 'imu_link', 'map', 'map', '', 'track', 'odom', '/map', 'ü' * 50)
)
step = st.one_of(
    st.just(0.01),
    st.floats(0.001, 0.05),
    st.sampled_from((0.0, -0.01, -5.0, -1e6, 0.3, 4.9, 5.1, 60.0, 3.2e8, 2e9)),
)
drawn = settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def put_stamp(msg, time_s: float, bad_nanoseconds: bool = False) -> None:
    whole = math.floor(time_s)
    msg.header.stamp.sec = int(np.clip(whole, -(2**31), 2**31 - 1))
    msg.header.stamp.nanosec = 4_000_000_000 if bad_nanoseconds else int((time_s - whole) * 1e9)


@st.composite
def imus(draw) -> tuple[float, Imu]:
    """Draw (time since the message before, Imu); most are good, so that filters do start."""
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
def poses(draw) -> tuple[float, PoseWithCovarianceStamped]:
    """Draw (time since the Imu before, pose)."""
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = draw(st.one_of(st.just('map'), frame))
    p, q = msg.pose.pose.position, msg.pose.pose.orientation
    good = draw(st.booleans())
    place = st.floats(-60.0, 60.0) if good else number
    p.x, p.y, p.z = draw(place), draw(place), 0.0 if good else draw(number)
    if good:
        turn = draw(st.floats(-math.pi, math.pi))
        q.z, q.w = math.sin(0.5 * turn), math.cos(0.5 * turn)
        size = draw(st.sampled_from((1e-9, 1e-4, 0.01, 1.0, 100.0, 1e8)))
        msg.pose.covariance = (np.eye(6) * size).ravel()
    else:
        q.x, q.y, q.z, q.w = draw(number), draw(number), draw(number), draw(number)
        msg.pose.covariance[:] = [draw(number) for _ in range(36)]
    return draw(st.sampled_from((0.0, -0.5, -3.0, -50.0, 0.05, 10.0, 1e9))), msg


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
def eskf(ros_module, circle_file):
    node = ros_module.make(CoasterEskfNode, design_ride=str(circle_file), eskf__path_rate_hz=50.0)
    node.published = []
    publish = node._publish

    def keep(estimate):
        publish(estimate)
        node.published.append(node._odometry.pose.covariance)
        assert np.isfinite(estimate.position).all()
        assert np.isfinite(node._odometry.pose.covariance).all()
        assert np.isfinite(node._odometry.twist.covariance).all()

    node._publish = keep
    return node


@pytest.fixture(scope='module')
def matcher(ros_module, circle_file):
    return ros_module.make(SrdtwMatcherNode, design_ride=str(circle_file))


@drawn
@given(
    rest=st.sampled_from((0, 120)),
    messages=st.lists(st.one_of(imus(), imus(), poses()), max_size=80),
    starts=st.lists(poses(), max_size=2),
)
def test_the_filter_survives_and_counts(eskf, rest, messages, starts):
    eskf.filter.reset()
    stream = Stream()
    before = (eskf.imu.received, eskf.match.received, eskf.start.received)
    for msg in stream.good(rest):
        eskf.on_imu(msg)
    for dt, msg in messages:
        stream.stamped(dt, msg)
        (eskf.on_imu if isinstance(msg, Imu) else eskf.on_match)(msg)
    for _, msg in starts:
        put_stamp(msg, stream.time_s)
        eskf.on_initialpose(msg)
    sent = sum(isinstance(msg, Imu) for _, msg in messages)
    assert eskf.imu.received == before[0] + rest + sent
    assert eskf.match.received == before[1] + len(messages) - sent
    assert eskf.start.received == before[2] + len(starts)
    eskf.diagnostics.publish()
    eskf.publish_path()


@drawn
@given(
    rest=st.sampled_from((0, 300)),
    messages=st.lists(imus(), max_size=80),
)
def test_the_matcher_survives_and_counts(matcher, rest, messages):
    matcher.matcher.reset()
    stream = Stream()
    before = matcher.imu.received
    for msg in stream.good(rest):
        matcher.on_imu(msg)
    for dt, msg in messages:
        matcher.on_imu(stream.stamped(dt, msg))
    assert matcher.imu.received == before + rest + len(messages)
    matcher.diagnostics.publish()


@settings(parent=drawn, max_examples=10)
@given(messages=st.lists(st.one_of(imus(), poses()), min_size=20, max_size=60))
def test_the_filter_works_again_after_the_storm(eskf, messages):
    """Six seconds of good samples later estimates come again, one for each sample."""
    eskf.filter.reset()
    stream = Stream()
    for dt, msg in messages:
        stream.stamped(dt, msg)
        (eskf.on_imu if isinstance(msg, Imu) else eskf.on_match)(msg)
    for msg in stream.good(600):
        eskf.on_imu(msg)
    eskf.published.clear()
    for msg in stream.good(20):
        eskf.on_imu(msg)
    assert len(eskf.published) == 20


@pytest.mark.parametrize('wild', [3.2e8, -3.2e8])
def test_one_stamp_years_off_does_not_stop_the_filter(eskf, wild):
    eskf.filter.reset()
    stream = Stream()
    for msg in stream.good(400):
        eskf.on_imu(msg)
    msg = next(iter(stream.good(1)))
    put_stamp(msg, max(stream.time_s + wild, 0.0))
    eskf.on_imu(msg)
    eskf.published.clear()
    for msg in stream.good(100):
        eskf.on_imu(msg)
    assert len(eskf.published) == 100


def test_a_flood_of_one_stamp_is_counted(eskf):
    eskf.filter.reset()
    stream = Stream()
    for msg in stream.good(200):
        eskf.on_imu(msg)
    for _ in range(3000):
        eskf.on_imu(msg)
    assert eskf.filter.rejected['imu']['repeated_time'] == 3000


def test_a_flood_of_matches_is_borne(eskf):
    """Five hundred matches of one stamp, each replayed through the history: it keeps up."""
    eskf.filter.reset()
    stream = Stream()
    for msg in stream.good(400):
        eskf.on_imu(msg)
    match = PoseWithCovarianceStamped()
    match.header.frame_id = 'map'
    match.pose.pose.position.x, match.pose.pose.orientation.w = 40.0, 1.0
    match.pose.covariance = np.eye(6).ravel()
    put_stamp(match, stream.time_s - 0.05)
    for _ in range(500):
        eskf.on_match(match)
    eskf.published.clear()
    for msg in stream.good(10):
        eskf.on_imu(msg)
    assert len(eskf.published) == 10


def test_a_match_object_is_what_the_filter_gets(eskf, monkeypatch):
    """The storms above reach the filter: good matches are not all refused on the way."""
    seen = []
    monkeypatch.setattr(eskf.filter, 'push', lambda m: seen.append(m) or [])
    match = PoseWithCovarianceStamped()
    match.header.frame_id = 'map'
    match.pose.pose.orientation.w = 1.0
    match.pose.covariance = np.eye(6).ravel()
    eskf.on_match(match)
    assert isinstance(seen[0], MatchObservation)

"""
The train's node dies of no message: whatever arrives, it is used or counted under a reason.

Messages are drawn by hypothesis: NaN, infinities, huge and tiny numbers, zero and negative
variances, wrong and empty frames, receivers without a fix, texts for numbers, time backward,
repeated, years ahead, gaps, floods. The suite turns warnings into errors, so an overflow inside the
filter fails these tests too.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, NavSatFix

from train_localization.nodes.train_kf import TrainKfNode

SPEED_MPS, GRAVITY = 30.0, 9.806
METRES_PER_DEG = 111132.0 * math.cos(math.radians(45.0)) + 220.0
"""Of longitude at 45 degrees north, to 1 %: the train goes east."""
NASTY = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, -1e300, 1e-300, 0.01, 45.0, 299.0)
number = st.one_of(st.sampled_from(NASTY), st.floats(-400.0, 400.0))
variance = st.one_of(st.sampled_from((1e-300, 1e-12, 1e-4, 1.0, 1e7, 1e13)), number)
frame = st.sampled_from(('imu_link', 'gnss', 'map', 'base_link', 'track', '', '/gnss', 'ü' * 50))
text = st.sampled_from(('', 'nan', 'inf', '-1', '4', '3', '2', '1e400', '1e7', 'many', '0.8', '9'))
NEAR = (0.0, -0.02, -0.9, -5.0, -1e6, 0.3, 1.4, 10.0, 29.0)
near = st.one_of(st.just(0.02), st.floats(0.001, 0.1), st.sampled_from(NEAR))
step = st.one_of(near, st.sampled_from((31.0, 3.2e8, 2e9)))
drawn = settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def put_stamp(msg, time_s: float) -> None:
    whole = math.floor(time_s)
    msg.header.stamp.sec = int(np.clip(whole, -(2**31), 2**31 - 1))
    msg.header.stamp.nanosec = int((time_s - whole) * 1e9)


def imu(force=(0.0, 0.0, GRAVITY), rate=(0.0, 0.0, 0.0), frame_id='imu_link') -> Imu:
    msg = Imu()
    msg.header.frame_id = frame_id
    a, g = msg.linear_acceleration, msg.angular_velocity
    a.x, a.y, a.z = force
    g.x, g.y, g.z = rate
    return msg


def fix(place=(45.0, 9.0, 120.0), spread=(1.0, 1.0, 4.0), frame_id='gnss', status=0, kind=3):
    msg = NavSatFix()
    msg.header.frame_id = frame_id
    msg.latitude, msg.longitude, msg.altitude = place
    msg.status.status, msg.position_covariance_type = status, kind
    msg.position_covariance[::4] = spread
    return msg


def quality(satellites='9', hdop='0.9') -> DiagnosticArray:
    pairs = [KeyValue(key='satellites_used', value=satellites), KeyValue(key='hdop', value=hdop)]
    return DiagnosticArray(status=[DiagnosticStatus(values=pairs)])


def wheel(v=SPEED_MPS, spread=0.04, frame_id='base_link') -> TwistWithCovarianceStamped:
    msg = TwistWithCovarianceStamped()
    msg.header.frame_id = frame_id
    msg.twist.twist.linear.x, msg.twist.covariance[0] = float(v), float(spread)
    return msg


@st.composite
def messages(draw, step=step) -> tuple[float, str, object]:
    """Draw (time since the message before, its callback, message); None: as the train runs."""
    sensor = draw(st.sampled_from(('imu', 'imu', 'fix', 'quality', 'wheel', 'initialpose')))
    good = draw(st.sampled_from((True, True, False)))
    callback = f'on_{sensor}'
    if good and sensor != 'initialpose':
        return draw(step), callback, None
    numbers = st.tuples(number, number, number)
    if sensor == 'imu':
        ours = draw(st.sampled_from(('imu_link', '')))
        return draw(step), callback, imu(draw(numbers), draw(numbers), ours or draw(frame))
    if sensor == 'fix':
        spread = draw(st.tuples(variance, variance, variance))
        ours = draw(st.sampled_from(('gnss', 'gnss', ''))) or draw(frame)
        place = draw(st.one_of(numbers, st.just((45.0, 9.01, 120.0))))
        kind = draw(st.sampled_from((0, 1, 2, 3)))
        msg = fix(place, spread, ours, draw(st.sampled_from((-1, 0, 2))), kind)
        msg.position_covariance[1] = draw(st.one_of(st.just(0.0), number))
        return draw(step), callback, msg
    if sensor == 'quality':
        return draw(step), callback, quality(draw(text), draw(text))
    if sensor == 'wheel':
        return draw(step), callback, wheel(draw(number), draw(variance))
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = 'map' if good else draw(frame)
    msg.pose.pose.position.x = draw(st.floats(-500.0, 5000.0)) if good else draw(number)
    msg.pose.pose.orientation.w = 1.0 if good else draw(number)
    sizes = st.sampled_from((1e-12, 1e-4, 1.0, 1e8))
    msg.pose.covariance[::7] = [draw(sizes if good else variance) for _ in range(6)]
    return draw(step), callback, msg


class Run:
    """A train to the east at a steady speed: stamps messages, and makes good ones."""

    def __init__(self, node) -> None:
        self.node, self.time_s, self.x = node, 1000.0, 0.0

    def good(self, seconds: float) -> None:
        """Push what IMU (50 Hz), odometer (10 Hz) and receiver (1 Hz) tell."""
        for i in range(round(seconds * 50)):
            self.push(0.02, 'on_imu', None)
            if i % 5 == 0:
                self.push(0.0, 'on_wheel', None)
            if i % 50 == 0:
                self.push(0.0, 'on_quality', None)
                self.push(0.0, 'on_fix', None)

    def push(self, dt: float, callback: str, msg) -> None:
        """One wild stamp does not carry the train away with it."""
        stamp_s = self.time_s + dt
        if abs(dt) < 100.0 and msg is None:
            self.x += SPEED_MPS * max(dt, 0.0)
            self.time_s = max(stamp_s, self.time_s)
        if msg is None:
            make = {'on_imu': imu, 'on_wheel': wheel, 'on_quality': quality}.get(callback)
            place = (45.0, 9.0 + self.x / METRES_PER_DEG, 120.0)
            msg = fix(place) if make is None else make()
        put_stamp(msg, max(stamp_s, -1e9))
        getattr(self.node, callback)(msg)


def finite(msg: Odometry) -> None:
    p, q = msg.pose.pose.position, msg.pose.pose.orientation
    v, w = msg.twist.twist.linear, msg.twist.twist.angular
    pose = (p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z)
    assert np.isfinite(pose).all()
    for covariance in (msg.pose.covariance, msg.twist.covariance):
        P = covariance.reshape(6, 6)
        assert np.isfinite(P).all()
        assert P.diagonal().min() > 0.0


@pytest.fixture(scope='module', params=['robust', 'paper', 'ins'])
def made(request, ros_module):
    """Return the node; all that it publishes as odometry is finite, and is counted."""
    node = ros_module.make(TrainKfNode, method=request.param, datum__place=[45.0, 9.0, 120.0])
    node.published = 0
    publish = node._odometry_pub.publish

    def keep(msg: Odometry) -> None:
        finite(msg)
        publish(msg)
        node.published += 1

    node._odometry_pub.publish = keep
    return node


def anew(node) -> Run:
    """Return a run of the node as it was when it was made."""
    node.filter.reset()
    node.published = 0
    return Run(node)


def received(node) -> int:
    streams = (node.imu, node.gnss, node.quality, node.wheel, node.start)
    return sum(stream.received for stream in streams)


@drawn
@given(before_s=st.sampled_from((0.0, 0.5, 6.0)), storm=st.lists(messages(), max_size=60))
def test_it_survives_and_counts(made, before_s, storm):
    run = anew(made)
    run.good(before_s)
    before = received(made)
    for message in storm:
        run.push(*message)
    assert received(made) == before + len(storm)
    made.diagnostics.publish()
    made.publish_path()


@settings(parent=drawn, max_examples=10, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(storm=st.lists(messages(near), min_size=20, max_size=60))
def test_it_works_again_after_the_storm(made, storm):
    """
    When good messages have come for a while, estimates come again, ten a second.

    The paper's fading factor has no bound: its filter may have to begin anew, the others may not.
    """
    run = anew(made)
    run.good(6.0)
    for message in storm:
        run.push(*message)
    run.time_s += 1.0
    run.good(40.0)
    made.published = 0
    run.good(4.0)
    assert made.published == pytest.approx(40, abs=2)
    assert made.config.method == 'paper' or made._diverged == 0


@pytest.mark.parametrize('wild_s', [3.2e8, -999.0])
@pytest.mark.parametrize('callback', ['on_imu', 'on_fix', 'on_quality', 'on_wheel'])
def test_one_stamp_years_off_does_not_stop_it(made, callback, wild_s):
    run = anew(made)
    run.good(8.0)
    msg = {'on_imu': imu, 'on_fix': fix, 'on_quality': quality, 'on_wheel': wheel}[callback]()
    put_stamp(msg, run.time_s + wild_s)
    getattr(made, callback)(msg)
    made.published = 0
    run.good(4.0)
    assert made.published == pytest.approx(40, abs=2)

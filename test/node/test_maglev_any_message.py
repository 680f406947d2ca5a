"""
The maglev's node dies of no message: whatever arrives, it is used or counted under a reason.

Messages are drawn by hypothesis: NaN, infinities, huge and tiny numbers, zero and negative
variances, wrong and empty frames, ids of no balise, time backward, repeated, years ahead, gaps,
floods. The suite turns warnings into errors, so an overflow inside the filter fails these tests
too.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry

from maglev_localization.nodes.federated_pf import MaglevFederatedPfNode

SPEED_MPS, PITCH_M = 20.0, 0.2
NASTY = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, -1e300, 1e-300, 0.01, 9e6, 290.0)
number = st.one_of(st.sampled_from(NASTY), st.floats(-3000.0, 3000.0))
variance = st.one_of(st.just(0.01), st.sampled_from((1e-300, 1e-12, 1e-4, 1.0, 1e7)), number)
frame = st.sampled_from(
    (
        *('track', 'map', 'base_link', 'balise_a', 'balise_b', 'balise_c', 'balise_'),
        *('balise_nobody', '', 'odom', '/track', 'ü' * 50),
    )
)
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


def loop(x, spread=0.01, frame_id='track') -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = frame_id
    msg.pose.pose.position.x, msg.pose.covariance[0] = float(x), float(spread)
    return msg


def radar(v, spread=0.04, frame_id='base_link') -> TwistWithCovarianceStamped:
    msg = TwistWithCovarianceStamped()
    msg.header.frame_id = frame_id
    msg.twist.twist.linear.x, msg.twist.covariance[0] = float(v), float(spread)
    return msg


def start(x, size=1.0, frame_id='track') -> PoseWithCovarianceStamped:
    msg = loop(x, frame_id=frame_id)
    msg.pose.covariance[::7] = float(size)
    return msg


@st.composite
def messages(draw, step=step) -> tuple[float, str, object]:
    """Draw (time since the message before, its callback, message); None: as the train runs."""
    sensor = draw(st.sampled_from(('loop', 'loop', 'radar', 'radar', 'balise', 'start')))
    good = draw(st.sampled_from((True, True, False)))
    frame_id = {'loop': 'track', 'radar': 'base_link', 'balise': 'balise_a', 'start': 'track'}
    name = frame_id[sensor] if good or draw(st.booleans()) else draw(frame)
    spread = 0.01 if good else draw(variance)
    if sensor == 'radar':
        return draw(step), 'on_radar', None if good else radar(draw(number), spread, name)
    if sensor == 'loop':
        return draw(step), 'on_loop', None if good else loop(draw(number), spread, name)
    if sensor == 'balise':
        if good:
            name = draw(st.sampled_from(('balise_a', 'balise_b', 'balise_c', 'balise_nobody')))
        return draw(step), 'on_balise', loop(0.1 if good else draw(number), spread, name)
    if good:
        size = draw(st.sampled_from((1e-9, 1.0, 1e8)))
        return 0.0, 'on_initialpose', start(draw(st.floats(0.0, 3000.0)), size)
    msg = start(draw(number), draw(variance), name)
    msg.pose.pose.position.y, msg.pose.pose.orientation.w = draw(number), draw(number)
    return draw(step), 'on_initialpose', msg


class Run:
    """A train at a steady speed: stamps messages, and makes good ones."""

    def __init__(self, node) -> None:
        self.node, self.time_s, self.s = node, 1000.0, 0.0

    def good(self, seconds: float) -> int:
        """Push what loop (50 Hz) and radar (25 Hz) tell; return how many speeds."""
        count = round(seconds * 50)
        for i in range(count):
            self._push(0.02, 'on_loop', None)
            if i % 2:
                self._push(0.0, 'on_radar', None)
        return count // 2

    def storm(self, drawn_messages) -> None:
        for dt, callback, msg in drawn_messages:
            self._push(dt, callback, msg)

    def _push(self, dt: float, callback: str, msg) -> None:
        """One wild stamp does not carry the train away with it."""
        stamp_s = self.time_s + dt
        if abs(dt) < 100.0 and msg is None:
            self.s += SPEED_MPS * max(dt, 0.0)
            self.time_s = max(stamp_s, self.time_s)
        if msg is None:
            count = math.floor(self.s / PITCH_M) * PITCH_M
            msg = loop(count) if callback == 'on_loop' else radar(SPEED_MPS)
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


@pytest.fixture(scope='module', params=['robust', 'kalman', 'paper'])
def made(request, ros_module, maglev_files):
    """Return the node; all that it publishes as odometry is finite, and is counted."""
    settings = {'method': request.param, 'particles': 200}
    node = ros_module.make(MaglevFederatedPfNode, **maglev_files, **settings)
    node.published = 0
    publish = node._odometry_pub.publish

    def keep(msg: Odometry) -> None:
        finite(msg)
        along = node._chainage.pose
        publish(msg)
        node.published += 1
        assert np.isfinite(along.pose.position.x)

    node._odometry_pub.publish = keep
    return node


def anew(node) -> Run:
    """Return a run of the node as it was when it was made."""
    node.filter.reset()
    node.published = 0
    return Run(node)


def received(node) -> int:
    return sum(s.received for s in (node.loop, node.radar, node.balise, node.start))


@drawn
@given(before_s=st.sampled_from((0.0, 0.5, 3.0)), storm=st.lists(messages(), max_size=60))
def test_it_survives_and_counts(made, before_s, storm):
    run = anew(made)
    run.good(before_s)
    before = received(made)
    run.storm(storm)
    assert received(made) == before + len(storm)
    made.diagnostics.publish()
    made.publish_path()


@settings(parent=drawn, max_examples=10, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(storm=st.lists(messages(near), min_size=20, max_size=60))
def test_it_works_again_after_the_storm(made, storm):
    """
    When good messages have come for a while, estimates come again, one for each speed.

    Stamps years ahead that confirm each other are another matter: then that is the time. The
    paper's filter need not find its way back.
    """
    run = anew(made)
    run.good(2.0)
    run.storm(storm)
    run.time_s += 1.0
    run.good(40.0)
    made.published = 0
    speeds = run.good(2.0)
    assert made.published == pytest.approx(speeds, abs=1)
    if made.config.method != 'paper':
        assert made._odometry.twist.twist.linear.x == pytest.approx(SPEED_MPS, abs=0.5)


@pytest.mark.parametrize('wild_s', [3.2e8, -999.0])
@pytest.mark.parametrize('callback', ['on_loop', 'on_radar', 'on_balise'])
def test_one_stamp_years_off_does_not_stop_it(made, callback, wild_s):
    run = anew(made)
    run.good(3.0)
    msg = radar(SPEED_MPS) if callback == 'on_radar' else loop(run.s)
    msg.header.frame_id = 'balise_a' if callback == 'on_balise' else msg.header.frame_id
    put_stamp(msg, run.time_s + wild_s)
    getattr(made, callback)(msg)
    made.published = 0
    assert run.good(2.0) == pytest.approx(made.published, abs=1)


def test_a_flood_of_one_stamp_is_counted(made):
    run = anew(made)
    run.good(3.0)
    made.published = 0
    for k in range(2000):
        run._push(0.0, ('on_loop', 'on_radar')[k % 2], None)
    rejected = made.filter.rejected
    assert sum(rejected['loop'].values()) >= 999
    assert sum(rejected['radar'].values()) >= 999
    assert made.published <= 2


def test_a_recording_started_over_goes_on(made):
    """Time jumps back by the length of the recording; after a reset estimates come at once."""
    run = anew(made)
    run.good(5.0)
    run.time_s, run.s = 990.0, 0.0
    made.filter.reset()
    made.published = 0
    assert run.good(2.0) == pytest.approx(made.published, abs=2)


def test_a_gap_of_ten_seconds_is_passed(made):
    """The train travelled 200 m meanwhile, the counter counted on."""
    run = anew(made)
    run.good(5.0)
    run.time_s, run.s = run.time_s + 10.0, run.s + 200.0
    made.published = 0
    assert run.good(5.0) == pytest.approx(made.published, abs=1)
    along = made._chainage.pose
    assert along.pose.position.x == pytest.approx(run.s, abs=3.0 * along.covariance[0] ** 0.5 + 0.3)


def test_a_flood_of_starts_is_borne(made):
    run = anew(made)
    run.good(2.0)
    for _ in range(300):
        made.on_initialpose(start(700.0))
    run.s = 700.0
    made.published = 0
    assert run.good(3.0) == pytest.approx(made.published, abs=2)

"""The maglev's node with predict_to_now: odometry carried on to the node's clock."""

from __future__ import annotations

import time

import numpy as np
import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock

from maglev_localization.estimate import Estimate
from maglev_localization.nodes.federated_pf import MaglevFederatedPfNode
from track_localization.ros.convert import seconds, set_stamp


class FakeFilter:
    """Answers every measurement with the same place, speed and acceleration."""

    def __init__(self, config, balises, line_length_m) -> None:
        self.rejected = {}
        self.mean = np.array([1234.5, 20.0, 0.5])
        self.covariance = np.array([[4.0, 0.2, 0.0], [0.2, 0.25, 0.0], [0.0, 0.0, 0.01]])

    def push(self, measurement):
        return [Estimate(measurement.time_s, self.mean, self.covariance)]

    def diagnostics(self):
        return {'status': ''}


def radar(time_s) -> TwistWithCovarianceStamped:
    msg = TwistWithCovarianceStamped()
    msg.header.frame_id = 'base_link'
    set_stamp(msg.header.stamp, time_s)
    msg.twist.twist.linear.x, msg.twist.covariance[0] = 20.0, 0.04
    return msg


@pytest.fixture
def fake(ros, maglev_files):
    def make(**parameters):
        path = maglev_files['balises']
        return ros.make(MaglevFederatedPfNode, FakeFilter, balises=path, **parameters)

    return make


@pytest.fixture
def tell(ros):
    """Return a function that lets /clock tell a time, and waits until a node knows it."""
    teller = ros.node('teller')
    publisher = teller.create_publisher(Clock, '/clock', 10)

    def at(node, time_s: float) -> None:
        ros.wait_matched(publisher)
        clock = Clock()
        set_stamp(clock.clock, time_s)
        publisher.publish(clock)
        assert ros.spin_until(lambda: node._now_s() == pytest.approx(time_s, abs=1e-6))

    return at


def test_odometry_is_carried_on_to_the_clock_of_the_node(ros, fake, tell):
    """0.5 s from 1234.5 m, at 20 m/s and 0.5 m/s^2; odometry itself is as ever."""
    node = fake(predict_to_now=True, use_sim_time=True, motion__jerk_density=0.8)
    ahead = ros.listen(ros.node('listener'), Odometry, 'odometry_now')
    ros.wait_matched(node._now_pub)
    tell(node, 100.5)
    node.on_radar(radar(100.0))
    assert ros.spin_until(lambda: ahead)
    msg = ahead[0]
    assert seconds(msg.header.stamp) == pytest.approx(100.5, abs=1e-6)
    assert (msg.header.frame_id, msg.child_frame_id) == ('map', 'base_link')
    assert msg.pose.pose.position.x == pytest.approx(1234.5 + 10.0 + 0.0625, abs=1e-5)
    assert msg.twist.twist.linear.x == pytest.approx(20.25, abs=1e-5)
    grown = 4.0 + 0.2 + 0.25 * 0.25 + 0.01 * 0.5**4 / 4.0 + 0.8 * 0.5**5 / 20.0
    assert msg.pose.covariance[0] == pytest.approx(grown, rel=1e-5)
    assert seconds(node._odometry.header.stamp) == 100.0
    assert node._odometry.pose.covariance[0] == 4.0
    assert node._figures()['prediction'] == '0.5000 s'


@pytest.mark.parametrize('ahead_s', [0.0, 0.05])
def test_a_clock_a_little_behind_the_data_predicts_nothing_backward(ros, fake, tell, ahead_s):
    node = fake(predict_to_now=True, use_sim_time=True)
    tell(node, 100.0)
    node.on_radar(radar(100.0 + ahead_s))
    assert node._now_odometry == node._odometry


@pytest.mark.parametrize('clock_s', [50.0, 102.1, 4e8])
def test_nothing_is_predicted_where_the_clock_is_not_that_of_the_data(ros, fake, tell, clock_s):
    node = fake(predict_to_now=True, use_sim_time=True)
    tell(node, clock_s)
    node.on_radar(radar(100.0))
    assert seconds(node._now_odometry.header.stamp) == 0.0
    assert seconds(node._odometry.header.stamp) == 100.0
    assert node._figures()['prediction'].startswith('none: the data are ')


def test_a_recording_replayed_by_the_wall_clock_is_not_predicted(fake):
    node = fake(predict_to_now=True)
    node.on_radar(radar(100.0))
    assert seconds(node._now_odometry.header.stamp) == 0.0
    node.on_radar(radar(time.time() - 0.2))
    age_s = seconds(node._now_odometry.header.stamp) - seconds(node._odometry.header.stamp)
    assert 0.2 <= age_s < 2.0


def test_predictions_are_off_by_default(ros, fake):
    node = fake()
    topics = [name for name, _ in node.get_topic_names_and_types()]
    assert '/odometry' in topics
    assert '/odometry_now' not in topics
    assert 'prediction' not in node._figures()

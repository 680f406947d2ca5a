"""The matcher node: samples in, late poses out; the matcher itself is tested elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from coaster_localization.nodes.srdtw_matcher import SrdtwMatcherNode
from coaster_localization.observation import MatchObservation
from track_localization.errors import DataError
from track_localization.ros.convert import seconds, set_stamp


class FakeMatcher:
    """Stands for OnlineMatcher: answers every second sample with a match 1.5 s before."""

    def __init__(self, design, config) -> None:
        self.design, self.config = design, config
        self.pushed, self.resets = [], 0
        self.rejected = {'repeated_time': 3}

    def push(self, sample):
        self.pushed.append(sample)
        if len(self.pushed) % 2:
            return []
        quaternion, covariance = np.array([0.0, 0.0, 0.6, 0.8]), np.diag([9.0, 0.04, 0.01])
        covariance[0, 1] = covariance[1, 0] = 0.2
        position = np.array([1.0, 2.0, 3.0])
        return [MatchObservation(sample.time_s - 1.5, position, quaternion, covariance, 44.0)]

    def reset(self) -> None:
        self.resets += 1

    def diagnostics(self):
        return {'match_sigma_m': 0.25}


def imu(time_s, frame='imu_link', x=0.0) -> Imu:
    msg = Imu()
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    msg.linear_acceleration.x, msg.linear_acceleration.z = x, 9.81
    return msg


@pytest.fixture
def fake(ros, circle_file):
    def make(**parameters):
        return ros.make(SrdtwMatcherNode, FakeMatcher, design_ride=str(circle_file), **parameters)

    return make


def test_a_match_goes_out_with_the_stamp_of_its_sample(ros, fake):
    fake(frame_map='site')
    talker = ros.node('talker')
    poses = ros.listen(talker, PoseWithCovarianceStamped, 'srdtw/pose')
    publisher = talker.create_publisher(Imu, 'imu/data_raw', 10)
    ros.wait_matched(publisher)
    ros.spin_for(0.2)
    publisher.publish(imu(10.0))
    publisher.publish(imu(10.01))
    assert ros.spin_until(lambda: poses)
    msg = poses[0]
    assert msg.header.frame_id == 'site'
    assert seconds(msg.header.stamp) == pytest.approx(8.51, abs=1e-9)
    p, q = msg.pose.pose.position, msg.pose.pose.orientation
    assert (p.x, p.y, p.z, q.z, q.w) == (1.0, 2.0, 3.0, 0.6, 0.8)
    P = msg.pose.covariance.reshape(6, 6)
    np.testing.assert_array_equal(P[:3, :3], [[9.0, 0.2, 0.0], [0.2, 0.04, 0.0], [0.0, 0.0, 0.01]])
    assert not P[3:].any()


def test_the_mount_is_applied_before_the_matcher(fake):
    node = fake(mount_rpy_deg=[180.0, 0.0, 0.0])
    node.on_imu(imu(1.0, x=1.0))
    np.testing.assert_allclose(node.matcher.pushed[0].specific_force, [1.0, 0.0, -9.81], atol=1e-12)


def test_settings_reach_the_matcher(fake):
    node = fake(matcher__channel='z', matcher__observation_rate_hz=2)
    assert node.matcher.config.channel == 'z'
    assert node.matcher.config.observation_rate_hz == 2.0


def test_a_setting_that_the_matcher_refuses_is_told(ros, circle_file):
    with pytest.raises(DataError, match=r'matcher\.channel'):
        ros.make(SrdtwMatcherNode, design_ride=str(circle_file), matcher__channel='yaw')


def test_reset_forgets_the_ride(ros, fake):
    node = fake()
    caller = ros.node('caller')
    client = caller.create_client(Trigger, 'srdtw_matcher/reset')
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().success
    assert node.matcher.resets == 1


def test_diagnostics_tell_lag_and_reasons(ros, fake):
    node = fake()
    arrays = ros.listen(ros.node('listener'), DiagnosticArray, '/diagnostics')
    for i in range(10):
        node.on_imu(imu(10.0 + i / 100.0))
    node.on_imu(imu(10.2, frame='base_link'))
    assert ros.spin_until(lambda: arrays, 5.0)
    status = {s.name: {k.key: k.value for k in s.values} for s in arrays[0].status}
    assert float(status['srdtw_matcher']['match_lag_s']) == pytest.approx(1.5)
    assert status['srdtw_matcher']['matches'] == '5'
    assert status['srdtw_matcher']['match_sigma_m'] == '0.25'
    assert status['srdtw_matcher: imu']['rejected.wrong_frame'] == '1'
    assert status['srdtw_matcher: imu']['rejected.repeated_time'] == '3'


def test_without_a_design_ride_there_is_nothing_to_match(ros):
    with pytest.raises(DataError, match='parameter design_ride: not given'):
        ros.make(SrdtwMatcherNode)

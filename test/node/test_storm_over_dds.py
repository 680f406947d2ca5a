"""A storm of good and bad messages over DDS, both estimators at once: none lost, none deadly."""

from __future__ import annotations

import math

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from coaster_localization.nodes.eskf import CoasterEskfNode
from coaster_localization.nodes.srdtw_matcher import SrdtwMatcherNode
from track_localization.ros.convert import set_stamp

NASTY = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, -1e300, 1e-300, 9.81, 5e3)
REST, COUNT = 350, 600


def imu(i, rng) -> Imu:
    """Return sample ``i``: a rest first, so that the filter runs when the storm comes."""
    msg = Imu()
    msg.header.frame_id = 'imu_link'
    msg.linear_acceleration.z = 9.80665
    set_stamp(msg.header.stamp, 1000.0 + 0.01 * i)
    if i < REST:
        return msg
    if i % 7 == 3:
        msg.linear_acceleration.y = float(rng.choice(NASTY))
    if i % 11 == 5:
        msg.header.frame_id = str(rng.choice(['', 'odom']))
    if i % 13 == 6:
        set_stamp(msg.header.stamp, float(rng.choice([0.0, 2.0e9, 1000.0])))
    return msg


def pose(i, rng) -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = 'map' if i % 3 else ''
    msg.pose.pose.position.x = float(rng.choice(NASTY))
    msg.pose.covariance[:] = rng.choice(NASTY, 36)
    return msg


def test_both_nodes_count_every_message_of_a_storm(ros, circle_file, rng):
    eskf = ros.make(CoasterEskfNode, design_ride=str(circle_file))
    matcher = ros.make(SrdtwMatcherNode, design_ride=str(circle_file))
    talker = ros.node('talker')
    imu_pub = talker.create_publisher(Imu, 'imu/data_raw', 1000)
    pose_pub = talker.create_publisher(PoseWithCovarianceStamped, 'srdtw/pose', 1000)
    odometries = ros.listen(talker, Odometry, 'odometry')
    ros.wait_matched(imu_pub, 2)
    ros.wait_matched(pose_pub, 1)
    ros.spin_for(0.3)
    for i in range(COUNT):
        imu_pub.publish(imu(i, rng))
        pose_pub.publish(pose(i, rng))
    assert ros.spin_until(lambda: eskf.imu.received == COUNT)
    assert ros.spin_until(lambda: matcher.imu.received == COUNT)
    assert ros.spin_until(lambda: eskf.match.received == COUNT + matcher.sent)
    assert ros.spin_until(lambda: len(odometries) > COUNT - REST)
    assert eskf.imu.rejected['wrong_frame'] + eskf.imu.rejected['empty_frame'] >= 20
    assert eskf.match.rejected['empty_frame'] >= COUNT // 3

"""Messages to core types and back; what is refused, and under which name."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from track_localization.ros import convert


def imu(**changes) -> Imu:
    msg = Imu()
    msg.header.frame_id = 'imu_link'
    msg.header.stamp = Time(sec=12, nanosec=345678901)
    msg.linear_acceleration.z = 9.81
    msg.angular_velocity.x = 0.5
    for path, value in changes.items():
        *parents, last = path.split('__')
        target = msg
        for name in parents:
            target = getattr(target, name)
        setattr(target, last, value)
    return msg


def pose(
    covariance=None, quaternion=(0.0, 0.0, 0.0, 1.0), frame='map'
) -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = frame
    msg.header.stamp = Time(sec=12, nanosec=500000000)
    msg.pose.pose.position.x = 3.0
    q = msg.pose.pose.orientation
    q.x, q.y, q.z, q.w = quaternion
    full = np.zeros((6, 6))
    full[:3, :3] = np.eye(3) if covariance is None else covariance
    msg.pose.covariance = full.ravel()
    return msg


@given(st.integers(0, 2**31 - 2), st.integers(0, 10**9 - 1))
def test_a_stamp_survives_the_way_through_float_seconds(sec, nanosec):
    """Float seconds resolve 0.24 us at epoch times; reading them again gives the same float."""
    time_s = convert.seconds(Time(sec=sec, nanosec=nanosec))
    back = Time()
    convert.set_stamp(back, time_s)
    assert convert.seconds(back) == time_s
    error_ns = (back.sec - sec) * 10**9 + back.nanosec - nanosec
    assert abs(error_ns) <= 0.5e9 * math.ulp(float(sec + 1)) + 0.5


def test_an_imu_message_is_read():
    sample = convert.imu_sample(imu(), 'imu_link')
    assert sample.time_s == 12.345678901
    np.testing.assert_array_equal(sample.specific_force, [0.0, 0.0, 9.81])
    np.testing.assert_array_equal(sample.angular_rate, [0.5, 0.0, 0.0])


def test_the_mount_turns_sensor_axes_into_body_axes():
    """A sensor mounted with its x to the vehicle's left (yaw 90 deg) feels a forward push on -y."""
    R_bm = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    msg = imu(linear_acceleration__y=-2.0)
    sample = convert.imu_sample(msg, 'imu_link', R_bm)
    np.testing.assert_allclose(sample.specific_force, [2.0, 0.0, 9.81])
    np.testing.assert_allclose(sample.angular_rate, [0.0, 0.5, 0.0])


def test_a_missing_gyro_is_nan():
    msg = imu()
    msg.angular_velocity_covariance[0] = -1.0
    sample = convert.imu_sample(msg, 'imu_link')
    assert np.isnan(sample.angular_rate).all()
    assert np.isfinite(sample.specific_force).all()


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'header__frame_id': ''}, 'empty_frame'),
        ({'header__frame_id': 'base_link'}, 'wrong_frame'),
        ({'header__stamp__nanosec': 10**9}, 'bad_stamp'),
        ({'header__stamp__sec': -1}, 'bad_stamp'),
        ({'header__stamp__sec': 2**31 - 1}, 'bad_stamp'),
        ({'linear_acceleration__y': math.nan}, 'not_finite'),
        ({'linear_acceleration__x': math.inf}, 'not_finite'),
        ({'linear_acceleration__x': -math.inf}, 'not_finite'),
        ({'angular_velocity__z': math.nan}, 'not_finite'),
        ({'angular_velocity__y': math.inf}, 'not_finite'),
        ({'linear_acceleration__x': 1e300}, 'implausible'),
        ({'angular_velocity__x': -1e300}, 'implausible'),
    ],
)
def test_bad_imu_messages_are_refused_by_name(changes, reason):
    assert convert.imu_sample(imu(**changes), 'imu_link') == reason


def test_no_specific_force_is_refused():
    msg = imu()
    msg.linear_acceleration_covariance[0] = -1.0
    assert convert.imu_sample(msg, 'imu_link') == 'no_specific_force'


def test_any_frame_passes_where_none_is_asked_for():
    assert convert.imu_sample(imu(header__frame_id='phone'), '').time_s == 12.345678901
    assert convert.imu_sample(imu(header__frame_id=''), 'imu_link') == 'empty_frame'


def test_a_pose_is_read_with_its_whole_position_covariance():
    covariance = np.array([[9.0, 1.0, 0.5], [1.0, 4.0, 0.2], [0.5, 0.2, 1.0]])
    time_s, position, quaternion, P = convert.pose(pose(covariance, (0.0, 0.0, 0.6, 0.8)), 'map')
    assert time_s == 12.5
    np.testing.assert_array_equal(position, [3.0, 0.0, 0.0])
    np.testing.assert_allclose(quaternion, [0.0, 0.0, 0.6, 0.8])
    np.testing.assert_array_equal(P, covariance)


@pytest.mark.parametrize(
    ('msg', 'reason'),
    [
        (pose(np.zeros((3, 3))), 'covariance_not_positive'),
        (pose(-np.eye(3)), 'covariance_not_positive'),
        (pose(np.diag([1.0, 1.0, -1e-3])), 'covariance_not_positive'),
        (pose(np.diag([1.0, 1.0, 0.0])), 'covariance_not_positive'),
        (pose(np.diag([1.0, np.nan, 1.0])), 'covariance_not_finite'),
        (pose(np.diag([1.0, np.inf, 1.0])), 'covariance_not_finite'),
        (pose(np.diag([1.0, 1e300, 1.0])), 'implausible'),
        (pose([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), 'covariance_asymmetric'),
        (pose(quaternion=(0.0, 0.0, 0.0, 0.0)), 'bad_quaternion'),
        (pose(quaternion=(0.0, 0.0, 0.0, 1.1)), 'bad_quaternion'),
        (pose(quaternion=(math.nan, 0.0, 0.0, 1.0)), 'not_finite'),
        (pose(quaternion=(1e300, 0.0, 0.0, 1.0)), 'bad_quaternion'),
        (pose(frame=''), 'empty_frame'),
        (pose(frame='odom'), 'wrong_frame'),
    ],
)
def test_bad_poses_are_refused_by_name(msg, reason):
    assert convert.pose(msg, 'map') == reason


@pytest.mark.parametrize(('x', 'reason'), [(math.nan, 'not_finite'), (1e300, 'implausible')])
def test_bad_positions_are_refused_by_name(x, reason):
    msg = pose()
    msg.pose.pose.position.x = x
    assert convert.pose(msg, 'map') == reason
    msg.header.frame_id = 'track'
    assert convert.chainage(msg) == reason


def test_chainage_goes_out_and_comes_back():
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = 'track'
    convert.fill_chainage(msg, 5.25, 123.5, 0.5)
    assert convert.chainage(msg) == (123.5, 0.25)
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (5, 250_000_000)
    msg.pose.covariance[0] = 0.0
    assert convert.chainage(msg) == 'covariance_not_positive'


def along(frame, x=3.0, variance=0.25, sec=12) -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id, msg.header.stamp.sec = frame, sec
    msg.pose.pose.position.x, msg.pose.covariance[0] = x, variance
    return msg


@pytest.mark.parametrize('name', ['7', 'b_7', 'balise_7', ' ', 'ü', '<id>'])
def test_a_balise_tells_its_id_by_its_frame(name):
    assert convert.balise(along(f'balise_{name}', -0.4)) == (name, -0.4, 0.25)


@pytest.mark.parametrize(
    ('msg', 'reason'),
    [
        (along(''), 'empty_frame'),
        (along('balise_'), 'wrong_frame'),
        (along('balise'), 'wrong_frame'),
        (along('track'), 'wrong_frame'),
        (along('/balise_7'), 'wrong_frame'),
        (along('Balise_7'), 'wrong_frame'),
        (along('balise_7', math.nan), 'not_finite'),
        (along('balise_7', -math.inf), 'not_finite'),
        (along('balise_7', 1e300), 'implausible'),
        (along('balise_7', variance=0.0), 'covariance_not_positive'),
        (along('balise_7', variance=-0.25), 'covariance_not_positive'),
        (along('balise_7', variance=math.nan), 'covariance_not_finite'),
        (along('balise_7', variance=math.inf), 'covariance_not_finite'),
        (along('balise_7', variance=1e300), 'implausible'),
        (along('balise_7', sec=-1), 'bad_stamp'),
    ],
)
def test_bad_balises_are_refused_by_name(msg, reason):
    assert convert.balise(msg) == reason


def twist(x=20.0, variance=0.04, frame='base_link', sec=12) -> TwistWithCovarianceStamped:
    msg = TwistWithCovarianceStamped()
    msg.header.frame_id, msg.header.stamp.sec = frame, sec
    msg.twist.twist.linear.x, msg.twist.covariance[0] = x, variance
    msg.twist.twist.linear.y, msg.twist.covariance[7] = 99.0, 88.0
    return msg


@pytest.mark.parametrize('v', [20.0, 0.0, -3.0])
def test_a_speed_is_read(v):
    assert convert.speed(twist(v), 'base_link') == (v, 0.04)


@pytest.mark.parametrize(
    ('msg', 'reason'),
    [
        (twist(frame=''), 'empty_frame'),
        (twist(frame='radar_link'), 'wrong_frame'),
        (twist(math.nan), 'not_finite'),
        (twist(math.inf), 'not_finite'),
        (twist(-1e300), 'implausible'),
        (twist(variance=0.0), 'covariance_not_positive'),
        (twist(variance=-1.0), 'covariance_not_positive'),
        (twist(variance=math.nan), 'covariance_not_finite'),
        (twist(variance=1e300), 'implausible'),
        (twist(sec=-5), 'bad_stamp'),
    ],
)
def test_bad_speeds_are_refused_by_name(msg, reason):
    assert convert.speed(msg, 'base_link') == reason


@dataclasses.dataclass
class Estimate:
    time_s: float
    position: np.ndarray
    quaternion: np.ndarray
    velocity_body: np.ndarray
    angular_rate: np.ndarray
    pose_covariance: np.ndarray
    twist_covariance: np.ndarray


def test_an_estimate_becomes_odometry_field_by_field(rng):
    P, T = rng.normal(size=(6, 6)), rng.normal(size=(6, 6))
    estimate = Estimate(
        7.5,
        np.array([1.0, 2.0, 3.0]),
        np.array([0.1, 0.2, 0.3, 0.9]),
        np.array([4.0, 5.0, 6.0]),
        np.array([7.0, 8.0, 9.0]),
        P,
        T,
    )
    msg = Odometry()
    convert.fill_odometry(msg, estimate)
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (7, 500_000_000)
    p, q = msg.pose.pose.position, msg.pose.pose.orientation
    v, w = msg.twist.twist.linear, msg.twist.twist.angular
    assert (p.x, p.y, p.z, q.x, q.y, q.z, q.w) == (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.9)
    assert (v.x, v.y, v.z, w.x, w.y, w.z) == (4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    np.testing.assert_array_equal(msg.pose.covariance.reshape(6, 6), P)
    np.testing.assert_array_equal(msg.twist.covariance.reshape(6, 6), T)

"""What a train's sensors send, and a filter that keeps what it is given."""

from __future__ import annotations

import math

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from sensor_msgs.msg import Imu, NavSatFix

from track_localization.geodesy import Datum
from track_localization.ros.convert import set_stamp
from train_localization.estimate import Estimate
from train_localization.measurements import WheelSpeed

DATUM = Datum(math.radians(45.0), math.radians(9.0), 120.0)
YAW = math.atan2(0.8, 0.6)
QUATERNION = np.array([0.0, 0.0, math.sin(0.5 * YAW), math.cos(0.5 * YAW)])


def estimate(time_s, chainage=None) -> Estimate:
    """A train at the datum, on the way along (0.6, 0.8, 0) at 50 m/s, turned that way."""
    covariance = np.diag([4.0, 1.0, 9.0, 0.04, 0.09, 0.01, 1e-4, 4e-4, 9e-4])
    return Estimate(
        time_s=time_s,
        geodetic=np.array(DATUM),
        position=np.zeros(3),
        quaternion=QUATERNION,
        velocity=np.array([30.0, 40.0, 0.0]),
        angular_rate=np.array([0.0, 0.0, 0.01]),
        covariance=covariance,
        mode='SINS/DR',
        chainage=chainage,
        sigma_along=None if chainage is None else 1.5,
    )


class FakeFilter:
    """Stands for TrainPipeline: keeps what it was given, answers every speed."""

    def __init__(self, config, line, datum) -> None:
        self.config, self.line, self.datum = config, line, datum or DATUM
        self.pushed, self.starts, self.resets = [], [], 0
        self.rejected = {'gnss': {'gate': 2}, 'map': {'off_the_map': 3}}

    def push(self, measurement):
        self.pushed.append(measurement)
        if not isinstance(measurement, WheelSpeed):
            return []
        return [estimate(measurement.time_s, None if self.line is None else 321.5)]

    def reset(self) -> None:
        self.resets += 1

    def set_start(self, *start) -> str | None:
        if start[1][0] > 1e5:
            return 'no_datum'
        self.starts.append(start)
        return None

    def diagnostics(self):
        return {
            'status': '',
            'method': 'robust',
            'mode': 'SINS/DR',
            'nis.gnss': 0.9,
            'health.imu': 'ok',
            'health.gnss': 'silent',
        }


def stamped(msg, time_s, frame):
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    return msg


def imu(time_s=1.0, force=(0.1, 0.2, 9.8), frame='imu_link') -> Imu:
    msg = stamped(Imu(), time_s, frame)
    a, g = msg.linear_acceleration, msg.angular_velocity
    (a.x, a.y, a.z), (g.x, g.y, g.z) = force, (0.01, 0.02, 0.03)
    return msg


def fix(
    time_s=1.0, latitude=45.0, spread=(1.0, 2.0, 3.0), frame='gnss', status=0, kind=3
) -> NavSatFix:
    msg = stamped(NavSatFix(), time_s, frame)
    msg.latitude, msg.longitude, msg.altitude = latitude, 9.0, 150.0
    msg.status.status, msg.position_covariance_type = status, kind
    for k in range(3):
        msg.position_covariance[4 * k] = spread[k]
    return msg


def quality(time_s=1.0, frame='', **values: str) -> DiagnosticArray:
    msg = stamped(DiagnosticArray(), time_s, frame)
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    msg.status = [DiagnosticStatus(name='gnss', values=pairs)]
    return msg


def wheel(time_s=1.0, v=50.0, frame='base_link', variance=0.04) -> TwistWithCovarianceStamped:
    msg = stamped(TwistWithCovarianceStamped(), time_s, frame)
    msg.twist.twist.linear.x, msg.twist.covariance[0] = float(v), variance
    return msg


def start(x=10.0, frame='map', spread=(4.0, 4.0, 4.0, 0.01, 0.02, 0.03), q=QUATERNION):
    msg = stamped(PoseWithCovarianceStamped(), 7.5, frame)
    msg.pose.pose.position.x = float(x)
    o = msg.pose.pose.orientation
    o.x, o.y, o.z, o.w = map(float, q)
    msg.pose.covariance[::7] = spread
    return msg

"""What a maglev's sensors send, and a filter that keeps what it is given."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped

from maglev_localization.estimate import Estimate
from maglev_localization.measurements import RadarSpeed
from track_localization.ros.convert import set_stamp


class FakeFilter:
    """Stands for MaglevPipeline: keeps what it was given, answers every speed."""

    chainage, speed = 1234.5, 20.0

    def __init__(self, config, balises, line_length_m) -> None:
        self.config, self.balises, self.line_length_m = config, balises, line_length_m
        self.pushed, self.starts, self.resets = [], [], 0
        self.rejected = {'loop': {'backward_time': 2}, 'balise': {'unknown_id': 1}}

    def push(self, measurement):
        self.pushed.append(measurement)
        if not isinstance(measurement, RadarSpeed):
            return []
        covariance = np.array([[4.0, 0.2, 0.0], [0.2, 0.25, 0.0], [0.0, 0.0, 0.01]])
        return [
            Estimate(measurement.time_s, np.array([self.chainage, self.speed, 0.5]), covariance)
        ]

    def reset(self) -> None:
        self.resets += 1

    def set_start(self, chainage, variance) -> str | None:
        if chainage > 1e4:
            return 'off_the_line'
        self.starts.append((chainage, variance))
        return None

    def diagnostics(self):
        return {
            'status': '',
            'method': 'robust',
            'n_eff': 7.5,
            'nis.radar': 0.9,
            'health.loop': 'isolated',
            'health.radar': 'ok',
            'health.balise': 'ok',
        }


def loop(time_s, x=50.0, frame='track', variance=0.01) -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    msg.pose.pose.position.x, msg.pose.covariance[0] = float(x), variance
    return msg


def balise(time_s, name, x=-0.4, variance=0.0025) -> PoseWithCovarianceStamped:
    return loop(time_s, x, f'balise_{name}', variance)


def radar(time_s, v=20.0, frame='base_link', variance=0.04) -> TwistWithCovarianceStamped:
    msg = TwistWithCovarianceStamped()
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    msg.twist.twist.linear.x, msg.twist.covariance[0] = float(v), variance
    return msg


def start(x, y=0.0, z=0.0, frame='map', variance=(4.0, 1.0, 1.0)) -> PoseWithCovarianceStamped:
    msg = loop(1.0, x, frame)
    msg.pose.pose.position.y, msg.pose.pose.position.z = float(y), float(z)
    for k in range(3):
        msg.pose.covariance[7 * k] = variance[k]
    return msg

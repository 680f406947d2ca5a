"""
coaster_eskf: IMU and matches in, odometry along the coaster's track out (paper 1, section 2).

Subscribes to imu/data_raw, srdtw/pose (fused at its own stamp, however late) and initialpose (in
frame_map, or in frame `track` with position.x the distance along it). Publishes odometry and
track/pose at the rate of the IMU, and path. ~/reset starts anew.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from coaster_localization.inputs import (
    line_of,
    mount_matrix,
    quaternion_of,
    rotation,
    start_at_chainage,
    warm_up_samples,
)
from coaster_localization.nodes import inputs
from coaster_localization.observation import MatchObservation
from coaster_localization.pipeline import CoasterEskf, Estimate
from track_localization.ros import convert, tf
from track_localization.ros.diagnostics import Diagnostics, StreamHealth
from track_localization.ros.fast import advertise, subscribe
from track_localization.ros.qos import MEASUREMENT_QOS, OUTPUT_QOS
from track_localization.ros.spin import run_node

PARAMETERS = ('design_ride', 'track', 'frame_', 'publish_tf', 'mount_rpy_deg', 'eskf.')
TRACK_FRAME = 'track'
PATH_LENGTH = 3000
"""Poses kept on the path: ten minutes at 5 Hz."""


class CoasterEskfNode(Node):
    """Fuse IMU and matches; no estimation here, see CoasterEskf."""

    def __init__(
        self,
        make_filter: Callable[..., Any] = CoasterEskf,
        warm_up: bool = False,
        **options: Any,
    ) -> None:
        """
        Make the node; ``make_filter(design, eskf_config, line)`` returns its core.

        ``warm_up`` has everything compiled before the first message can come.
        """
        super().__init__('coaster_eskf', **inputs.NODE_OPTIONS, **options)
        self.config = inputs.declare(self, PARAMETERS)
        self._R_bm = mount_matrix(self.config.mount_rpy_deg)
        design = inputs.design_ride(self.config)
        self._line = line_of(design)
        self.filter = make_filter(design, self.config.eskf, self._line)
        if warm_up:
            self._warm_up()
        self.imu, self.match = StreamHealth(self._now_s), StreamHealth(expected=False)
        self.start = StreamHealth(expected=False)
        self._newest_s = float('nan')
        self._advertise()
        streams = {'imu': self.imu, 'match': self.match, 'initialpose': self.start}
        self.diagnostics = Diagnostics(
            self, streams, lambda: self.filter.rejected, lambda: self.filter.diagnostics()
        )
        self.create_service(Trigger, '~/reset', self._on_reset)
        pose = PoseWithCovarianceStamped
        subscribe(self, pose, 'initialpose', self.on_initialpose, OUTPUT_QOS)
        subscribe(self, pose, 'srdtw/pose', self.on_match, MEASUREMENT_QOS)
        subscribe(self, Imu, 'imu/data_raw', self.on_imu, MEASUREMENT_QOS)

    def _warm_up(self) -> None:
        place, R = self._line.point(0.0), self._line.axes[0]
        for sample in warm_up_samples():
            for estimate in self.filter.push(sample):
                convert.fill_odometry(Odometry(), estimate)
        match = MatchObservation(sample.time_s - 0.1, place, quaternion_of(R), np.eye(3))
        self.filter.push(match)
        self.filter.reset()

    def _now_s(self) -> float:
        return self.get_clock().now().nanoseconds / convert.NANO

    def _advertise(self) -> None:
        frame = self.config.frame_map
        self._odometry, self._chainage = Odometry(), PoseWithCovarianceStamped()
        self._odometry.header.frame_id = frame
        self._odometry.child_frame_id = self.config.frame_base
        self._chainage.header.frame_id = TRACK_FRAME
        self._odometry_pub = advertise(self, Odometry, 'odometry', OUTPUT_QOS)
        self._chainage_pub = advertise(self, PoseWithCovarianceStamped, 'track/pose', OUTPUT_QOS)
        self._path_pub = advertise(self, Path, 'path', OUTPUT_QOS)
        self._path: deque[PoseStamped] = deque(maxlen=PATH_LENGTH)
        self._path_next_s = float('-inf')
        self._path_new = False
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self.publish_path, clock=steady)
        self._send_transform = tf.make_broadcaster(self) if self.config.publish_tf else None

    def on_imu(self, msg: Imu) -> None:
        """Push one sample; publish the estimates that it makes possible."""
        begin = perf_counter()
        sample = convert.imu_sample(msg, self.config.frame_imu, self._R_bm)
        if isinstance(sample, str):
            self.imu.refused(sample)
            return
        self.imu.arrived(sample.time_s)
        for estimate in self.filter.push(sample):
            self._publish(estimate)
        self.imu.busy_s += perf_counter() - begin

    def on_match(self, msg: PoseWithCovarianceStamped) -> None:
        """Push one match; it shows in the estimates from the next sample on."""
        begin = perf_counter()
        read = convert.pose(msg, self.config.frame_map)
        if isinstance(read, str):
            self.match.refused(read)
            return
        time_s, position, quaternion, covariance = read
        self.match.arrived(time_s)
        self.match.latency_s = self._newest_s - time_s
        match = MatchObservation(time_s, position, quaternion, covariance)
        for estimate in self.filter.push(match):
            self._publish(estimate)
        self.match.busy_s += perf_counter() - begin

    def on_initialpose(self, msg: PoseWithCovarianceStamped) -> None:
        """Set where the vehicle is, given in ``frame_map`` or as a distance along the track."""
        if msg.header.frame_id == TRACK_FRAME:
            problem = self._start_at_chainage(convert.chainage(msg, TRACK_FRAME))
        else:
            problem = self._start_at_pose(convert.pose(msg, self.config.frame_map))
        if problem is None:
            self.start.arrived(convert.seconds(msg.header.stamp))
        else:
            self.start.refused(problem)
            self.get_logger().warning(f'initialpose not used: {problem}')

    def _start_at_pose(self, read: tuple[float, Any, Any, Any] | str) -> str | None:
        if isinstance(read, str):
            return read
        _, position, quaternion, covariance = read
        self.filter.set_start(position, covariance, rotation(quaternion))
        return None

    def _start_at_chainage(self, read: tuple[float, float] | str) -> str | None:
        if isinstance(read, str):
            return read
        s, variance = read
        sigma = self.config.eskf.line_sigma_m
        self.filter.set_start(*start_at_chainage(self._line, s, variance, sigma))
        return None

    def _publish(self, estimate: Estimate) -> None:
        self._newest_s = time_s = estimate.time_s
        convert.fill_odometry(self._odometry, estimate)
        self._odometry_pub.publish(self._odometry)
        convert.fill_chainage(self._chainage, time_s, estimate.chainage, estimate.sigma_along)
        self._chainage_pub.publish(self._chainage)
        frame, base = self.config.frame_map, self.config.frame_base
        if self._send_transform is not None:
            self._send_transform(
                tf.transform(time_s, estimate.position, estimate.quaternion, frame, base)
            )
        if not self._path_next_s - 1.0 <= time_s < self._path_next_s:
            self._path_next_s = time_s + 1.0 / self.config.eskf.path_rate_hz
            self._path.append(
                convert.path_pose(time_s, estimate.position, estimate.quaternion, frame)
            )
            self._path_new = True

    def publish_path(self) -> None:
        """Publish the path so far, if it has grown and anybody listens."""
        if self._path_new and self._path_pub.get_subscription_count():
            self._path_new = False
            msg = Path(header=self._path[-1].header, poses=list(self._path))
            self._path_pub.publish(msg)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.filter.reset()
        self._path.clear()
        self._path_next_s, self._newest_s = float('-inf'), float('nan')
        response.success, response.message = True, 'waiting for standstill or a match'
        return response


def main(args: list[str] | None = None) -> int:
    """Run the node; return the exit code."""
    return run_node(
        lambda: CoasterEskfNode(warm_up=True), args, __doc__, inputs.NodeConfig(), PARAMETERS
    )


if __name__ == '__main__':
    sys.exit(main())

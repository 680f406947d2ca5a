"""
srdtw_matcher: IMU in, places on the design line out (paper 1, section 1, online).

Subscribes to imu/data_raw; publishes srdtw/pose, stamped with the measured sample that was
matched, so it arrives late. ~/reset forgets the ride. Segments need a whole ride: live the match
is an open-end alignment (matcher.method dtw_penalised), the paper's SRDTW is for recordings.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import perf_counter
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from coaster_localization.inputs import mount_matrix, warm_up_samples
from coaster_localization.nodes import inputs
from coaster_localization.observation import MatchObservation
from coaster_localization.online import LIVE_MATCHER, ONLY_LIVE, OnlineMatcher
from track_localization.errors import DataError
from track_localization.ros import convert
from track_localization.ros.diagnostics import Diagnostics, StreamHealth
from track_localization.ros.fast import advertise, subscribe
from track_localization.ros.qos import MEASUREMENT_QOS, OUTPUT_QOS
from track_localization.ros.spin import run_node

PARAMETERS = ('design_ride', 'track', 'frame_map', 'frame_imu', 'mount_rpy_deg', 'matcher.')


class SrdtwMatcherNode(Node):
    """Match the ride so far against the design ride; no estimation here, see OnlineMatcher."""

    def __init__(
        self,
        make_matcher: Callable[..., Any] = OnlineMatcher,
        warm_up: bool = False,
        **options: Any,
    ) -> None:
        """
        Make the node; ``make_matcher(design, matcher_config)`` returns its core.

        ``warm_up`` has everything compiled before the first message can come.
        """
        super().__init__('srdtw_matcher', **inputs.NODE_OPTIONS, **options)
        config = inputs.declare(self, PARAMETERS)
        if config.matcher.method != LIVE_MATCHER:
            raise DataError(f'parameter matcher.method: {config.matcher.method}: {ONLY_LIVE}')
        self._R_bm = mount_matrix(config.mount_rpy_deg)
        self._frame_imu = config.frame_imu
        self.matcher = make_matcher(inputs.design_ride(config), config.matcher)
        if warm_up:
            for sample in warm_up_samples():
                self.matcher.push(sample)
            self.matcher.reset()
        self.imu = StreamHealth(lambda: self.get_clock().now().nanoseconds / convert.NANO)
        self.sent = 0
        self._lag_s = float('nan')
        self._msg = PoseWithCovarianceStamped()
        self._msg.header.frame_id = config.frame_map
        self._pose_pub = advertise(self, PoseWithCovarianceStamped, 'srdtw/pose', OUTPUT_QOS)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.diagnostics = Diagnostics(self, {'imu': self.imu}, self._rejected, self._figures)
        subscribe(self, Imu, 'imu/data_raw', self.on_imu, MEASUREMENT_QOS)

    def on_imu(self, msg: Imu) -> None:
        """Push one sample; publish the matches that it makes possible."""
        begin = perf_counter()
        sample = convert.imu_sample(msg, self._frame_imu, self._R_bm)
        if isinstance(sample, str):
            self.imu.refused(sample)
            return
        self.imu.arrived(sample.time_s)
        for match in self.matcher.push(sample):
            self._publish(match)
            self._lag_s = sample.time_s - match.time_s
        self.imu.busy_s += perf_counter() - begin

    def _publish(self, match: MatchObservation) -> None:
        convert.set_stamp(self._msg.header.stamp, match.time_s)
        convert.fill_pose(self._msg.pose.pose, match.position, match.quaternion)
        convert.fill_position_covariance(self._msg, match.covariance)
        self._pose_pub.publish(self._msg)
        self.sent += 1

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.matcher.reset()
        response.success, response.message = True, 'waiting for a new ride'
        return response

    def _rejected(self) -> dict[str, dict[str, int]]:
        return {'imu': self.matcher.rejected}

    def _figures(self) -> dict[str, float | str]:
        return {'matches': self.sent, 'match_lag_s': self._lag_s} | self.matcher.diagnostics()


def main(args: list[str] | None = None) -> int:
    """Run the node; return the exit code."""
    return run_node(
        lambda: SrdtwMatcherNode(warm_up=True), args, __doc__, inputs.NodeConfig(), PARAMETERS
    )


if __name__ == '__main__':
    sys.exit(main())

"""
coaster_eskf: IMU and matches in, odometry along the coaster's track out (paper 1, section 2).

Subscribes to imu/data_raw, srdtw/pose (fused at its own stamp, however late) and initialpose (in
frame_map, or in frame `track` with position.x the distance along it). Publishes odometry and
track/pose at the rate of the IMU, and path. ~/reset starts anew.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from coaster_localization.inputs import (
    line_of,
    quaternion_of,
    rotation,
    start_at_chainage,
    warm_up_samples,
)
from coaster_localization.nodes import inputs
from coaster_localization.nodes.outputs import PATH_LENGTH, EstimatorNode
from coaster_localization.observation import MatchObservation
from coaster_localization.pipeline import CoasterEskf
from track_localization.ros import convert
from track_localization.ros.diagnostics import StreamHealth
from track_localization.ros.fast import subscribe
from track_localization.ros.qos import MEASUREMENT_QOS
from track_localization.ros.spin import run_node

__all__ = ['PATH_LENGTH', 'CoasterEskfNode', 'main']

PARAMETERS = ('design_ride', 'track', 'frame_', 'publish_tf', 'mount_rpy_deg', 'eskf.')


class CoasterEskfNode(EstimatorNode):
    """Fuse IMU and matches; no estimation here, see CoasterEskf."""

    waiting_for = 'waiting for standstill or a match'

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
        super().__init__('coaster_eskf', PARAMETERS, **options)
        self.path_rate_hz = self.config.eskf.path_rate_hz
        design = inputs.design_ride(self.config)
        self._line = line_of(design)
        self.filter = make_filter(design, self.config.eskf, self._line)
        if warm_up:
            self._warm_up()
        self.match = StreamHealth(expected=False)
        self._connect(match=self.match)
        pose = PoseWithCovarianceStamped
        subscribe(self, pose, 'srdtw/pose', self.on_match, MEASUREMENT_QOS)

    def _warm_up(self) -> None:
        place, R = self._line.point(0.0), self._line.axes[0]
        for sample in warm_up_samples():
            for estimate in self.filter.push(sample):
                convert.fill_odometry(Odometry(), estimate)
        match = MatchObservation(sample.time_s - 0.1, place, quaternion_of(R), np.eye(3))
        self.filter.push(match)
        self.filter.reset()

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

    def _start_at_pose(self, position: Any, quaternion: Any, covariance: Any) -> str | None:
        self.filter.set_start(position, covariance, rotation(quaternion))
        return None

    def _start_at_chainage(self, s: float, variance: float) -> str | None:
        sigma = self.config.eskf.line_sigma_m
        self.filter.set_start(*start_at_chainage(self._line, s, variance, sigma))
        return None


def main(args: list[str] | None = None) -> int:
    """Run the node; return the exit code."""
    return run_node(
        lambda: CoasterEskfNode(warm_up=True), args, __doc__, inputs.NodeConfig(), PARAMETERS
    )


if __name__ == '__main__':
    sys.exit(main())

"""
coaster_track_filter: IMU in, odometry along the coaster's track out, by where on it the train is.

Subscribes to imu/data_raw and initialpose (in frame `track` with position.x the distance along it,
or in frame_map: the nearest place of the track). Publishes odometry and track/pose for every
sample, path, odometry_lag (smoothed, track_filter.lag_s late, under its own stamps) and lap (laps
completed since the start, each time one is). ~/reset starts anew.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from typing import Any

from nav_msgs.msg import Odometry
from std_msgs.msg import UInt32

from coaster_localization.inputs import warm_up_samples
from coaster_localization.nodes import inputs
from coaster_localization.nodes.outputs import EstimatorNode
from coaster_localization.track_live import LiveTrackFilter
from track_localization.ros import convert
from track_localization.ros.fast import advertise
from track_localization.ros.qos import OUTPUT_QOS
from track_localization.ros.spin import run_node

PARAMETERS = ('design_ride', 'track', 'frame_', 'publish_tf', 'mount_rpy_deg', 'track_filter.')
DOUBTS = ((0.1, True), (5.0, False))
"""Starts that are practised, sigma [m] and whether the mount is known: one hypothesis, which is
smoothed as well, and several, which are compared."""


class CoasterTrackFilterNode(EstimatorNode):
    """Follow the train on its line; no estimation here, see LiveTrackFilter."""

    waiting_for = 'waiting for a rest, or a ride under way'

    def __init__(
        self,
        make_filter: Callable[..., Any] = LiveTrackFilter,
        warm_up: bool = False,
        **options: Any,
    ) -> None:
        """
        Make the node; ``make_filter(design, track_filter_config)`` returns its core.

        ``warm_up`` has everything compiled before the first message can come.
        """
        super().__init__('coaster_track_filter', PARAMETERS, **options)
        design = inputs.design_ride(self.config)
        self.filter = make_filter(design, self.config.track_filter)
        if warm_up:
            for doubt_m, known in DOUBTS:
                config = dataclasses.replace(self.config.track_filter, mount_known=known)
                self._warm_up(make_filter(design, config), doubt_m)
        self._connect()

    def _warm_up(self, trial: Any, doubt_m: float) -> None:
        """Take a filter of no further use through a rest and a departure."""
        trial.set_start_chainage(0.0, doubt_m**2)
        for sample in warm_up_samples():
            for estimate in trial.push(sample) + trial.smoothed():
                convert.fill_odometry(Odometry(), estimate)

    def _advertise(self) -> None:
        super()._advertise()
        self._lag_odometry, self._lap = self._new_odometry(), UInt32()
        self._lag_pub = advertise(self, Odometry, 'odometry_lag', OUTPUT_QOS)
        self._lap_pub = advertise(self, UInt32, 'lap', OUTPUT_QOS)

    def _publish(self, estimate: Any) -> None:
        super()._publish(estimate)
        if self.filter.lap_completed(estimate):
            self._lap.data = self.filter.laps
            self._lap_pub.publish(self._lap)

    def _after_sample(self) -> None:
        for estimate in self.filter.smoothed():
            convert.fill_odometry(self._lag_odometry, estimate)
            self._lag_pub.publish(self._lag_odometry)

    def _start_at_pose(self, position: Any, quaternion: Any, covariance: Any) -> str | None:
        return self.filter.set_start_position(position, covariance)

    def _start_at_chainage(self, s: float, variance: float) -> str | None:
        return self.filter.set_start_chainage(s, variance)


def main(args: list[str] | None = None) -> int:
    """Run the node; return the exit code."""
    return run_node(
        lambda: CoasterTrackFilterNode(warm_up=True), args, __doc__, inputs.NodeConfig(), PARAMETERS
    )


if __name__ == '__main__':
    sys.exit(main())

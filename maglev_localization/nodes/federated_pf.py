"""
maglev_federated_pf: loop, radar and balises in, odometry along the guideway out (paper 2).

Subscribes to loop/pose (frame `track`), radar/twist (frame_base), balise/pose (frame
`balise_<id>`) and initialpose (frame `track`, or frame_map: the nearest place of the track file;
x is the chainage where there is none). Publishes odometry and track/pose at the rate of the radar,
stamped by the data, and path; with predict_to_now also odometry_now: the same carried on to the
node's clock. ~/reset starts anew as at launch: what initialpose told is forgotten too.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry

from maglev_localization.estimate import Estimate
from maglev_localization.inputs import warm_up_measurements
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from maglev_localization.nodes import inputs
from maglev_localization.pipeline import MaglevPipeline
from maglev_localization.placing import Placing
from maglev_localization.prediction import predicted
from track_localization.ros import convert
from track_localization.ros.diagnostics import StreamHealth
from track_localization.ros.estimator_node import TRACK_FRAME, EstimatorNode
from track_localization.ros.fast import InOrder, advertise
from track_localization.ros.qos import OUTPUT_QOS
from track_localization.ros.spin import run_node

CLOCK_SLACK_S = 1.0
"""
So far the node's clock may be behind the data: clocks differ, and /clock waits its turn when many
messages have come. Nothing is carried backward.
"""


class MaglevFederatedPfNode(EstimatorNode):
    """Fuse loop, radar and balises; no estimation here, see MaglevPipeline."""

    waiting_for = 'waiting for the first measurements'

    def __init__(
        self,
        make_filter: Callable[..., Any] = MaglevPipeline,
        warm_up: bool = False,
        **options: Any,
    ) -> None:
        """
        Make the node; ``make_filter(config, balises, line_length_m)`` returns its core.

        ``warm_up`` has everything compiled before the first message can come.
        """
        super().__init__('maglev_federated_pf', inputs.NodeConfig(), inputs.PARAMETERS, **options)
        self.balises, line = inputs.read_files(self.config)
        self._placing = Placing(line, self.config.placing)
        length = 0.0 if line is None else line.length
        self.filter = make_filter(self.config, self.balises, length)
        self._prediction = 'nothing yet'
        if warm_up:
            for config in inputs.practised(self.config):
                self._warm_up(make_filter(config, self.balises, length))
        self.loop, self.radar = StreamHealth(self._now_s), StreamHealth(self._now_s)
        self.balise = StreamHealth(self._now_s, expected=False, regular=False)
        self._connect({'loop': self.loop, 'radar': self.radar, 'balise': self.balise})
        self._in_order = InOrder()
        pose, twist = PoseWithCovarianceStamped, TwistWithCovarianceStamped
        self._listen(self.loop, pose, 'loop/pose', self.on_loop, self._in_order)
        self._listen(self.radar, twist, 'radar/twist', self.on_radar, self._in_order)
        self._listen(self.balise, pose, 'balise/pose', self.on_balise, self._in_order)

    def _warm_up(self, trial: Any) -> None:
        """Take a filter of no further use through a short run."""
        for measurement in warm_up_measurements(self.balises):
            for estimate in trial.push(measurement):
                ahead = predicted(estimate, estimate.time_s, self.config.motion.jerk_density)
                placed = self._placing.place(ahead)
                convert.fill_odometry(Odometry(), placed)
        self._placing.chainage(placed.position, placed.pose_covariance[:3, :3])

    def _advertise(self) -> None:
        super()._advertise()
        if self.config.predict_to_now:
            self._now_odometry = self._new_odometry()
            self._now_pub = advertise(self, Odometry, 'odometry_now', OUTPUT_QOS)

    def on_loop(self, msg: PoseWithCovarianceStamped) -> None:
        """Push one reading of the loop; publish the estimates that it makes possible."""
        begin = perf_counter()
        read = convert.chainage(msg, TRACK_FRAME)
        if not isinstance(read, str):
            read = LoopPosition(convert.seconds(msg.header.stamp), *read)
        self._push(self.loop, read)
        self.loop.busy_s += perf_counter() - begin

    def on_radar(self, msg: TwistWithCovarianceStamped) -> None:
        """Push one speed of the radar; publish the estimates that it makes possible."""
        begin = perf_counter()
        read = convert.speed(msg, self.config.frame_base)
        if not isinstance(read, str):
            read = RadarSpeed(convert.seconds(msg.header.stamp), *read)
        self._push(self.radar, read)
        self.radar.busy_s += perf_counter() - begin

    def on_balise(self, msg: PoseWithCovarianceStamped) -> None:
        """Push the passing of a balise; publish the estimates that it makes possible."""
        begin = perf_counter()
        read = convert.balise(msg)
        if not isinstance(read, str):
            read = BalisePassing(convert.seconds(msg.header.stamp), *read)
        self._push(self.balise, read)
        self.balise.busy_s += perf_counter() - begin

    def _start_at_pose(self, position: Any, quaternion: Any, covariance: Any) -> str | None:
        found = self._placing.chainage(position, covariance)
        return found if isinstance(found, str) else self.filter.set_start(*found)

    def _start_at_chainage(self, s: float, variance: float) -> str | None:
        return self.filter.set_start(s, variance)

    def _publish(self, estimate: Estimate) -> None:
        super()._publish(self._placing.place(estimate))
        if self.config.predict_to_now:
            self._publish_now(estimate)

    def _publish_now(self, estimate: Estimate) -> None:
        """Publish what the estimate says of now, if the node's clock is that of the data."""
        age_s = self._now_s() - estimate.time_s
        if not -CLOCK_SLACK_S <= age_s <= self.config.predict_at_most_s:
            self._prediction = f'none: the data are {age_s:.3f} s behind the clock of this node'
            self.get_logger().warning(
                f'odometry_now: {self._prediction}; a replay needs publish_clock and use_sim_time',
                once=True,
            )
            return
        self._prediction = f'{max(age_s, 0.0):.4f} s'
        now_s = estimate.time_s + max(age_s, 0.0)
        ahead = predicted(estimate, now_s, self.config.motion.jerk_density)
        convert.fill_odometry(self._now_odometry, self._placing.place(ahead))
        self._now_pub.publish(self._now_odometry)

    def _figures(self) -> Mapping[str, float | str]:
        own = {'prediction': self._prediction} if self.config.predict_to_now else {}
        return {**super()._figures(), **own}


def main(args: list[str] | None = None) -> int:
    """Run the node; return the exit code."""
    return run_node(
        lambda: MaglevFederatedPfNode(warm_up=True),
        args,
        __doc__,
        inputs.NodeConfig(),
        inputs.PARAMETERS,
    )


if __name__ == '__main__':
    sys.exit(main())

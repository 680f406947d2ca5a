"""
train_kf: IMU, satellite fixes and odometer in, odometry of a train out (paper 4).

Subscribes to imu/data_raw (frame_imu), gnss/fix (frame_gnss), gnss/quality (values satellites_used
and hdop), wheel/twist (frame_base) and initialpose (frame_map). Publishes odometry, stamped by the
data; track/pose where a track is given; gnss/filtered, the same place as a fix; and path.
frame_map is east-north-up at the datum, or at the first fix. ~/reset starts anew.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, NavSatFix

from track_localization.ros import convert, convert_gnss
from track_localization.ros.diagnostics import StreamHealth
from track_localization.ros.estimator_node import EstimatorNode
from track_localization.ros.fast import InOrder, advertise
from track_localization.ros.qos import OUTPUT_QOS
from track_localization.ros.spin import run_node
from train_localization.estimate import Estimate
from train_localization.inputs import SOMEWHERE, practice, practised_start
from train_localization.measurements import GnssFix, GnssQuality, WheelSpeed
from train_localization.nodes import inputs
from train_localization.pipeline import TrainPipeline
from train_localization.posing import level_covariance, posed


class TrainKfNode(EstimatorNode):
    """Fuse IMU, fixes and odometer; no estimation here, see TrainPipeline."""

    waiting_for = 'aligning: waits for fixes under way'

    def __init__(
        self,
        make_filter: Callable[..., Any] = TrainPipeline,
        warm_up: bool = False,
        **options: Any,
    ) -> None:
        """
        Make the node; ``make_filter(config, line, datum)`` returns its core.

        ``warm_up`` has everything compiled before the first message can come.
        """
        super().__init__('train_kf', inputs.NodeConfig(), inputs.PARAMETERS, **options)
        self.line, datum = inputs.read_files(self.config)
        self.filter = make_filter(self.config, self.line, datum)
        self._diverged = 0
        if warm_up:
            datum = datum or SOMEWHERE
            self._warm_up(make_filter(self.config, self.line, datum), datum)
        self.imu, self.wheel = StreamHealth(self._now_s), StreamHealth(self._now_s)
        # A tunnel has no satellites, and that is no fault of the receiver's.
        self.gnss = StreamHealth(self._now_s, regular=False)
        self.quality = StreamHealth(self._now_s, expected=False, regular=False)
        self._in_order = InOrder()
        self._connect(
            {'imu': self.imu, 'gnss': self.gnss, 'quality': self.quality, 'wheel': self.wheel},
            self._in_order,
        )
        self._listen(self.imu, Imu, 'imu/data_raw', self.on_imu, self._in_order)
        self._listen(self.gnss, NavSatFix, 'gnss/fix', self.on_fix, self._in_order)
        self._listen(self.quality, DiagnosticArray, 'gnss/quality', self.on_quality, self._in_order)
        self._listen(
            self.wheel, TwistWithCovarianceStamped, 'wheel/twist', self.on_wheel, self._in_order
        )

    def _warm_up(self, trial: Any, datum: Any) -> None:
        """Take a filter of no further use through a run from a given start, and from none."""
        run = list(practice(self.line, datum))
        trial.set_start(*practised_start(self.line))
        estimates = [estimate for measurement in run for estimate in trial.push(measurement)]
        pose = posed(estimates[-1], self.config.turn_sigma_radps)
        convert.fill_odometry(Odometry(), pose)
        covariance = level_covariance(estimates[-1], datum)
        convert_gnss.fill_fix(NavSatFix(), pose.time_s, estimates[-1].geodetic, covariance)
        trial.reset()
        for measurement in run:
            trial.push(measurement)

    def _advertise(self) -> None:
        super()._advertise()
        self._fix = NavSatFix()
        self._fix.header.frame_id = self.config.frame_gnss
        self._fix_pub = advertise(self, NavSatFix, 'gnss/filtered', OUTPUT_QOS)

    def on_imu(self, msg: Imu) -> None:
        """Push one sample; publish the estimates that it makes possible."""
        begin = perf_counter()
        self._push(self.imu, convert.imu_sample(msg, self.config.frame_imu))
        self.imu.busy_s += perf_counter() - begin

    def on_fix(self, msg: NavSatFix) -> None:
        """Push one fix; publish the estimates that it makes possible."""
        begin = perf_counter()
        read = convert_gnss.fix(msg, self.config.frame_gnss)
        if not isinstance(read, str):
            read = GnssFix(convert.seconds(msg.header.stamp), *read)
        self._push(self.gnss, read)
        self.gnss.busy_s += perf_counter() - begin

    def on_quality(self, msg: DiagnosticArray) -> None:
        """Push what is told of a fix; publish the estimates that it makes possible."""
        begin = perf_counter()
        read = convert_gnss.fix_quality(msg)
        if not isinstance(read, str):
            read = GnssQuality(convert.seconds(msg.header.stamp), *read)
        self._push(self.quality, read)
        self.quality.busy_s += perf_counter() - begin

    def on_wheel(self, msg: TwistWithCovarianceStamped) -> None:
        """Push one speed; publish the estimates that it makes possible."""
        begin = perf_counter()
        read = convert.speed(msg, self.config.frame_base, untold=True)
        if not isinstance(read, str):
            read = WheelSpeed(convert.seconds(msg.header.stamp), *read)
        self._push(self.wheel, read)
        self.wheel.busy_s += perf_counter() - begin

    def on_initialpose(self, msg: PoseWithCovarianceStamped) -> None:
        """Set where the train is, in ``frame_map``, and how it is turned."""
        read = convert.full_pose(msg, self.config.frame_map)
        self._started(msg, read if isinstance(read, str) else self.filter.set_start(*read))

    def _push(self, stream: StreamHealth, measurement: Any) -> None:
        try:
            super()._push(stream, measurement)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            self._begin_anew(str(error))

    def _begin_anew(self, why: str) -> None:
        """Let the filter start again: its numbers are none, and no measurement mends them."""
        self._diverged += 1
        self.get_logger().warning(f'the filter begins anew: {why}', throttle_duration_sec=10.0)
        self.filter.reset()

    def _publish(self, estimate: Estimate) -> None:
        pose = posed(estimate, self.config.turn_sigma_radps)
        if not pose.sane:
            self._begin_anew(f'no estimate at {estimate.time_s:.2f} s')
            return
        datum = self.filter.datum
        if datum is None:  # begun anew within this batch
            return
        super()._publish(pose)
        covariance = level_covariance(estimate, datum)
        convert_gnss.fill_fix(self._fix, estimate.time_s, estimate.geodetic, covariance)
        self._fix_pub.publish(self._fix)

    def _figures(self) -> Mapping[str, float | str]:
        """Return the core's figures, its fresh starts, and what spoke against the map."""
        against = self.filter.rejected.get('map', {})
        own = {'diverged': self._diverged, **{f'map.{why}': n for why, n in against.items()}}
        return {**super()._figures(), **own}


def main(args: list[str] | None = None) -> int:
    """Run the node; return the exit code."""
    return run_node(
        lambda: TrainKfNode(warm_up=True),
        args,
        __doc__,
        inputs.NodeConfig(),
        inputs.PARAMETERS,
    )


if __name__ == '__main__':
    sys.exit(main())

"""
imu_publisher: sends a recorded ride again on imu/data_raw.

The recording is a ROS 2 bag (its Imu messages go out byte for byte, unless they are not in SI
units or have no stamps) or a phone's Sensor Logger export, folder or zip. What is wrong with it is
said at the start, with what can be done.

With `rate` 0 it sends as fast as the consumers keep up (see `pace_topic`). With `loop` the ride
starts over with all its stamps moved on, so that time never goes backward. It ends by itself when
all is sent.
"""

from __future__ import annotations

import dataclasses
import sys
from typing import Any

from rclpy.node import Node

from track_localization.ros.params import declare_config, read_file, warn_unknown
from track_localization.ros.recordings import IMU_TYPE, ImuRecording, open_imu_recording
from track_localization.ros.replay import ReplayConfig, Replayer
from track_localization.ros.spin import run_node
from track_localization.settings import setting

TOPIC = 'imu/data_raw'
UNITS = ('auto', 'si', 'g', 'deg', 'g_deg')


@dataclasses.dataclass(frozen=True)
class ImuReplayConfig(ReplayConfig):
    """What is sent, and how."""

    topic: str = setting(TOPIC, '', 'Imu topic of the bag; its only one where this is missing')
    platform: str = setting(
        'auto', '', 'who wrote a phone export', choices=('auto', 'ios', 'android')
    )
    units: str = setting('auto', '', 'units of the recording; deg means deg/s', choices=UNITS)
    frame_imu: str = setting('imu_link', '', 'frame_id of messages made anew')


class ImuPublisherNode(Node):
    """Replay the IMU of a bag or of a phone."""

    def __init__(self, **options: Any) -> None:
        options = {'automatically_declare_parameters_from_overrides': True} | options
        super().__init__('imu_publisher', **options)
        config = declare_config(self, ImuReplayConfig())
        warn_unknown(self, config)

        def read(path: str) -> ImuRecording:
            return open_imu_recording(
                path, TOPIC, config.topic, config.frame_imu, config.platform, config.units
            )

        recording = read_file(config.source, 'source', read, 'a bag or a phone export is needed')
        self.findings = recording.findings
        for finding in self.findings:
            if finding.severity == 'info':
                self.get_logger().info(str(finding))
            else:
                self.get_logger().warning(str(finding))
        self.replayer = Replayer(self, config, recording.items)
        self.replayer.advertise({TOPIC: IMU_TYPE})


def main(args: list[str] | None = None) -> int:
    """Run the node; return the exit code."""
    return run_node(
        ImuPublisherNode,
        args,
        __doc__,
        ImuReplayConfig(),
        work=lambda node, executor: node.replayer.run(executor),
    )


if __name__ == '__main__':
    sys.exit(main())

"""What the coaster's estimator nodes share: they follow the IMU."""

from __future__ import annotations

from time import perf_counter
from typing import Any

from sensor_msgs.msg import Imu

from coaster_localization.inputs import mount_matrix
from coaster_localization.nodes import inputs
from track_localization.ros import convert, estimator_node
from track_localization.ros.diagnostics import StreamHealth

PATH_LENGTH = estimator_node.PATH_LENGTH


class EstimatorNode(estimator_node.EstimatorNode):
    """The shell of an estimator that follows the IMU; see the class that it extends."""

    def __init__(self, name: str, parameters: tuple[str, ...], **options: Any) -> None:
        """Declare the parameters whose names begin so."""
        super().__init__(name, inputs.NodeConfig(), parameters, **options)
        self._R_bm = mount_matrix(self.config.mount_rpy_deg)
        self.imu = StreamHealth(self._now_s)

    def _connect(self, **streams: StreamHealth) -> None:
        """Advertise and subscribe; ``streams`` are those besides the IMU and initialpose."""
        super()._connect({'imu': self.imu, **streams})
        self._listen(self.imu, Imu, 'imu/data_raw', self.on_imu)

    def on_imu(self, msg: Imu) -> None:
        """Push one sample; publish the estimates that it makes possible."""
        begin = perf_counter()
        sample = convert.imu_sample(msg, self.config.frame_imu, self._R_bm)
        self._push(self.imu, sample)
        if not isinstance(sample, str):
            self._after_sample()
        self.imu.busy_s += perf_counter() - begin

    def _after_sample(self) -> None:
        """Do what can wait until the estimates are out."""

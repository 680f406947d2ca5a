"""What the coaster's estimator nodes share: IMU and a start in; pose, chainage, path out."""

from __future__ import annotations

from collections import deque
from time import perf_counter
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from coaster_localization.inputs import mount_matrix
from coaster_localization.nodes import inputs
from track_localization.ros import convert, tf
from track_localization.ros.diagnostics import Diagnostics, StreamHealth
from track_localization.ros.fast import advertise, subscribe
from track_localization.ros.qos import MEASUREMENT_QOS, OUTPUT_QOS

TRACK_FRAME = 'track'
PATH_RATE_HZ, PATH_LENGTH = 5.0, 3000
"""Poses a second on the path, where no setting says otherwise, and how many it keeps: 10 min."""


class EstimatorNode(Node):
    """
    The shell of an estimator that follows the IMU; no estimation here.

    A node sets ``filter`` (``push``, ``reset``, ``rejected``, ``diagnostics``), calls ``_connect``
    when it can take messages, and says what a start is: ``_start_at_pose``, ``_start_at_chainage``.
    """

    path_rate_hz = PATH_RATE_HZ
    waiting_for = 'waiting for a start'
    """What the filter does after a reset."""
    filter: Any

    def __init__(self, name: str, parameters: tuple[str, ...], **options: Any) -> None:
        """Declare the parameters whose names begin so."""
        super().__init__(name, **inputs.NODE_OPTIONS, **options)
        self.config = inputs.declare(self, parameters)
        self._R_bm = mount_matrix(self.config.mount_rpy_deg)
        self.imu, self.start = StreamHealth(self._now_s), StreamHealth(expected=False)
        self._newest_s = float('nan')

    def _now_s(self) -> float:
        return self.get_clock().now().nanoseconds / convert.NANO

    def _connect(self, **streams: StreamHealth) -> None:
        """Advertise and subscribe; ``streams`` are those besides the IMU and initialpose."""
        self._advertise()
        self.diagnostics = Diagnostics(
            self,
            {'imu': self.imu, **streams, 'initialpose': self.start},
            lambda: self.filter.rejected,
            lambda: self.filter.diagnostics(),
        )
        self.create_service(Trigger, '~/reset', self._on_reset)
        pose = PoseWithCovarianceStamped
        subscribe(self, pose, 'initialpose', self.on_initialpose, OUTPUT_QOS)
        subscribe(self, Imu, 'imu/data_raw', self.on_imu, MEASUREMENT_QOS)

    def _advertise(self) -> None:
        self._odometry, self._chainage = self._new_odometry(), PoseWithCovarianceStamped()
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

    def _new_odometry(self) -> Odometry:
        """Return an empty odometry with its frames."""
        msg = Odometry()
        msg.header.frame_id, msg.child_frame_id = self.config.frame_map, self.config.frame_base
        return msg

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
        self._after_sample()
        self.imu.busy_s += perf_counter() - begin

    def _after_sample(self) -> None:
        """Do what can wait until the estimates are out."""

    def on_initialpose(self, msg: PoseWithCovarianceStamped) -> None:
        """Set where the vehicle is, given in ``frame_map`` or as a distance along the track."""
        if msg.header.frame_id == TRACK_FRAME:
            along = convert.chainage(msg, TRACK_FRAME)
            problem = along if isinstance(along, str) else self._start_at_chainage(*along)
        else:
            read = convert.pose(msg, self.config.frame_map)
            problem = read if isinstance(read, str) else self._start_at_pose(*read[1:])
        if problem is None:
            self.start.arrived(convert.seconds(msg.header.stamp))
        else:
            self.start.refused(problem)
            self.get_logger().warning(f'initialpose not used: {problem}')

    def _start_at_pose(self, position: Any, quaternion: Any, covariance: Any) -> str | None:
        """Start at a position (3,) with covariance (3, 3) in ``frame_map``; return why not."""
        raise NotImplementedError

    def _start_at_chainage(self, s: float, variance: float) -> str | None:
        """Start at a distance along the track [m]; return why not."""
        raise NotImplementedError

    def _publish(self, estimate: Any) -> None:
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
            self._path_next_s = time_s + 1.0 / self.path_rate_hz
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
        self._path_next_s, self._newest_s, self._path_new = float('-inf'), float('nan'), False
        response.success, response.message = True, self.waiting_for
        return response

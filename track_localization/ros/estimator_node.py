"""
What every estimator node shares: measurements and a start in; pose, chainage and path out.

Topics out: odometry, track/pose, path, /diagnostics; in: initialpose; service: ~/reset.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from track_localization.ros import convert, tf
from track_localization.ros.diagnostics import Diagnostics, StreamHealth
from track_localization.ros.fast import InOrder, advertise, subscribe
from track_localization.ros.params import declare_config, warn_unknown
from track_localization.ros.qos import MEASUREMENT_QOS, OUTPUT_QOS
from track_localization.ros.topics import wrong_publishers

TRACK_FRAME = 'track'
PATH_RATE_HZ, PATH_LENGTH = 5.0, 3000
"""Poses a second on the path, where no setting says otherwise, and how many it keeps: 10 min."""


class EstimatorNode(Node):
    """
    The shell of an estimator; no estimation here.

    A node sets ``filter`` (``push``, ``reset``, ``rejected``, ``diagnostics``), calls ``_connect``
    when it can take messages, ``_listen`` for each sensor, and says what a start is:
    ``_start_at_pose``, ``_start_at_chainage``.
    """

    path_rate_hz = PATH_RATE_HZ
    waiting_for = 'waiting for a start'
    """What the filter does after a reset."""
    filter: Any

    def __init__(self, name: str, settings: Any, parameters: tuple[str, ...], **options: Any):
        """Declare those of ``settings`` (a FrameConfig, and more) whose names begin so."""
        # Lets ``warn_unknown`` see parameters that were given and that nobody declares.
        options = {'automatically_declare_parameters_from_overrides': True} | options
        super().__init__(name, **options)
        self.config = declare_config(self, settings, parameters)
        warn_unknown(self, settings)
        self.start = StreamHealth(expected=False, regular=False)
        self._newest_s = float('nan')

    def _now_s(self) -> float:
        return self.get_clock().now().nanoseconds / convert.NANO

    def _connect(
        self, streams: Mapping[str, StreamHealth], together: InOrder | None = None
    ) -> None:
        """
        Advertise, and subscribe to initialpose; ``streams`` are the node's sensors by name.

        ``together``: a start is taken in its order among the messages of this group.
        """
        self._advertise()
        self.diagnostics = Diagnostics(
            self,
            {**streams, 'initialpose': self.start},
            lambda: self.filter.rejected,
            self._figures,
        )
        self.create_service(Trigger, '~/reset', self._on_reset)
        join = subscribe if together is None else together.subscribe
        pose = PoseWithCovarianceStamped
        join(self, pose, 'initialpose', self.on_initialpose, OUTPUT_QOS)

    def _listen(
        self,
        stream: StreamHealth,
        kind: Any,
        topic: str,
        callback: Callable[[Any], None],
        together: InOrder | None = None,
    ) -> None:
        """
        Subscribe to a sensor; publishers of another type are told while it is silent.

        ``together``: with those of this group its messages are handled in the order of arrival.
        """
        join = subscribe if together is None else together.subscribe
        subscription = join(self, kind, topic, callback, MEASUREMENT_QOS)
        stream.why_silent = lambda: wrong_publishers(self, subscription)

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

    def _figures(self) -> Mapping[str, float | str]:
        """Return what is told in /diagnostics beside the counts of the sensors."""
        figures: Mapping[str, float | str] = self.filter.diagnostics()
        return figures

    def _push(self, stream: StreamHealth, measurement: Any) -> None:
        """Push a measurement and publish what it makes possible; a ``str`` says why it is none."""
        if isinstance(measurement, str):
            stream.refused(measurement)
            return
        stream.arrived(measurement.time_s)
        for estimate in self.filter.push(measurement):
            self._publish(estimate)

    def on_initialpose(self, msg: PoseWithCovarianceStamped) -> None:
        """Set where the vehicle is, given in ``frame_map`` or as a distance along the track."""
        if msg.header.frame_id == TRACK_FRAME:
            along = convert.chainage(msg, TRACK_FRAME)
            problem = along if isinstance(along, str) else self._start_at_chainage(*along)
        else:
            read = convert.pose(msg, self.config.frame_map)
            problem = read if isinstance(read, str) else self._start_at_pose(*read[1:])
        self._started(msg, problem)

    def _started(self, msg: PoseWithCovarianceStamped, problem: str | None) -> None:
        """Note what became of a start."""
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
        if estimate.chainage is not None:
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

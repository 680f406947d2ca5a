"""
sensor_publisher: sends the sensor messages of a bag again, byte for byte, in the order of logging.

The bag's ground truth is left out unless asked for. With `rate` 0 it sends as fast as the
consumers keep up (see `pace_topic`). With `loop` the recording starts over with all its stamps
moved on, so that time never goes backward. It ends by itself when all is sent.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from track_localization.errors import DataError
from track_localization.ros import cdr
from track_localization.ros.pace import Pace
from track_localization.ros.params import declare_config, read_file, warn_unknown
from track_localization.ros.qos import CLOCK_QOS, SENSOR_QOS
from track_localization.ros.recordings import Item, bag_items, sensor_topics
from track_localization.ros.spin import run_node
from track_localization.settings import setting

CLOCK_STEP_NS = 10_000_000
SETTLE_S = 0.5
"""A best-effort subscriber that the publisher knows may not know the publisher yet: 12 ms seen."""


@dataclasses.dataclass(frozen=True)
class ReplayConfig:
    """How a recording is sent."""

    source: str = setting('', '', 'path of the recording')
    rate: float = setting(1.0, 'x real time', '0 sends as fast as the consumers keep up', 0.0, 1e4)
    loop: bool = setting(False, '', 'start over at the end, stamps moved on')
    start_offset: float = setting(0.0, 's', 'skip so much of the recording', 0.0, 1e6)
    publish_clock: bool = setting(False, '', 'publish /clock from the times of logging')
    subscribers: int = setting(1, '', 'wait for so many subscribers of a topic', 0, 100)
    wait_timeout: float = setting(10.0, 's', 'how long to wait for them', 0.0, 600.0)
    pace_topic: str = setting('odometry', '', 'rate 0: whose stamps tell the progress')
    pace_window: float = setting(0.5, 's', 'rate 0: how far to send ahead of it', 0.001, 60.0)
    pace_timeout: float = setting(5.0, 's', 'rate 0: no progress for so long is a stall', 0.1, 600)


@dataclasses.dataclass(frozen=True)
class SensorReplayConfig(ReplayConfig):
    """What of a bag is sent, and how."""

    topics: str = setting('', '', 'topics to send, comma-separated; empty sends all sensors')
    ground_truth: bool = setting(False, '', 'send ground_truth/... too')


class Replayer:
    """Send the items of a recording from a node; ``recording()`` yields them from the start."""

    def __init__(
        self, node: Node, config: ReplayConfig, recording: Callable[[], Iterable[Item]]
    ) -> None:
        self.node, self.config, self.recording = node, config, recording
        self.sent: Counter[str] = Counter()
        self.recorded_s = 0.0
        self._publishers: dict[str, tuple[Publisher, bool] | None] = {}
        self._clock_pub = (
            node.create_publisher(Clock, '/clock', CLOCK_QOS) if config.publish_clock else None
        )
        self._clock_ns: int | None = None
        self._pace: Pace | None = None
        self._spin: Callable[[float], None] = time.sleep
        self._begin = self._end = self._last_spin = 0.0

    def advertise(self, topics: dict[str, str]) -> None:
        """Create the publishers of {topic: type}; types that are not installed are left out."""
        for topic, msgtype in topics.items():
            kind = cdr.message_class(msgtype)
            if kind is None:
                self._publishers[topic] = None
                self.node.get_logger().warning(f'{topic} left out: unknown type {msgtype}')
                continue
            publisher = self.node.create_publisher(kind, topic.lstrip('/'), SENSOR_QOS)
            self._publishers[topic] = (publisher, cdr.has_header(kind))

    def run(self, executor: SingleThreadedExecutor) -> None:
        """Send everything; return when done. Raise DataError when there is nothing to send."""
        self._spin = lambda seconds: executor.spin_once(timeout_sec=seconds)
        self._wait_for_consumers()
        self._begin = self._end = time.monotonic()
        try:
            shift_ns = self._once(0)
            while self.config.loop:
                shift_ns += self._once(shift_ns)
            self._finish()
        finally:
            print(f'{self.node.get_name()}: {self.report()}', flush=True)

    def report(self) -> str:
        """Return how much was sent and how fast."""
        wall = max(self._end - self._begin, 1e-6)
        total = ', '.join(f'{n} x {topic}' for topic, n in sorted(self.sent.items()))
        return (
            f'sent {total or "nothing"}; {self.recorded_s:.1f} s of recording in {wall:.1f} s '
            f'({self.recorded_s / wall:.2f} x real time)'
        )

    def _wait_for_consumers(self) -> None:
        deadline = time.monotonic() + self.config.wait_timeout
        publishers = [entry[0] for entry in self._publishers.values() if entry]
        if not publishers:
            raise DataError(f'{self.config.source}: no topic in it can be sent')
        wanted = self.config.subscribers
        while max(p.get_subscription_count() for p in publishers) < wanted:
            if time.monotonic() > deadline:
                self.node.get_logger().warning(
                    f'fewer than {wanted} subscribers after {self.config.wait_timeout:g} s'
                )
                break
            self._spin(0.05)
        self._spin_for(SETTLE_S)
        if self.config.rate == 0.0:
            c = self.config
            self._pace = Pace(self.node, c.pace_topic, c.pace_window, c.pace_timeout)
            self._pace.connect(self._spin, max(deadline, time.monotonic() + 1.0))

    def _once(self, shift_ns: int) -> int:
        """Send the recording once, stamps moved by ``shift_ns``; return its length [ns]."""
        first = start = last = None
        count, wall_0, before_s = 0, time.monotonic(), self.recorded_s
        for item in self.recording():
            first = item.log_ns if first is None else first
            if item.log_ns - first < self.config.start_offset * cdr.NANO:
                continue
            if start is None:
                start, wall_0 = item.log_ns, time.monotonic()
            self._wait_for_turn(item, shift_ns, wall_0, start)
            self._send(item, shift_ns)
            last, count = max(item.log_ns, last or item.log_ns), count + 1
            self.recorded_s = before_s + (last - start) / cdr.NANO
            self._end = time.monotonic()
        if start is None or last is None:
            length = 'it is empty' if first is None else 'start_offset lies beyond its end'
            raise DataError(f'{self.config.source}: nothing to send: {length}')
        length_ns = last - start
        return length_ns + (length_ns // (count - 1) if count > 1 else cdr.NANO)

    def _wait_for_turn(self, item: Item, shift_ns: int, wall_0: float, start_ns: int) -> None:
        if self._pace is not None:
            entry = self._publishers[item.topic]
            if entry is not None and entry[1]:
                self._pace.hold(cdr.header_ns(item.cdr) + shift_ns, self._spin)
            self._tick(item.log_ns + shift_ns)
        else:
            due = wall_0 + (item.log_ns - start_ns) / cdr.NANO / self.config.rate
            while (left := due - time.monotonic()) > 2e-4:
                self._tick(item.log_ns + shift_ns - round(left * self.config.rate * cdr.NANO))
                time.sleep(min(left, 0.01))
                self._serve()
            self._tick(item.log_ns + shift_ns)
        self._serve()

    def _serve(self) -> None:
        """Answer parameter services ten times a second: spinning costs more than sending."""
        if time.monotonic() - self._last_spin > 0.1:
            self._last_spin = time.monotonic()
            self._spin(0.0)

    def _tick(self, now_ns: int) -> None:
        """Publish /clock at steps of 10 ms, never backward."""
        if self._clock_pub is None:
            return
        if self._clock_ns is None or now_ns - self._clock_ns >= CLOCK_STEP_NS:
            self._clock_ns = now_ns
            sec, nanosec = divmod(now_ns, cdr.NANO)
            self._clock_pub.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))

    def _send(self, item: Item, shift_ns: int) -> None:
        entry = self._publishers[item.topic]
        if entry is None:
            return
        publisher, stamped = entry
        publisher.publish(cdr.shifted(item.cdr, shift_ns) if shift_ns and stamped else item.cdr)
        self.sent[item.topic] += 1

    def _finish(self) -> None:
        """Let the last messages arrive before the publishers go."""
        if self._pace is not None and not self._pace.drain(self._spin):
            self.node.get_logger().warning('the consumer stopped before the end of the recording')
        for entry in self._publishers.values():
            if entry is not None:
                entry[0].wait_for_all_acked(Duration(seconds=1.0))
        self._spin_for(0.2)

    def _spin_for(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._spin(0.05)


class SensorPublisherNode(Node):
    """Replay every sensor topic of a bag."""

    def __init__(self, **options: Any) -> None:
        options = {'automatically_declare_parameters_from_overrides': True} | options
        super().__init__('sensor_publisher', **options)
        config = declare_config(self, SensorReplayConfig())
        warn_unknown(self, config)
        source = read_file(config.source, 'source', str, 'a bag is needed')
        topics = sensor_topics(source, config.topics, config.ground_truth)
        names = {topic: topic for topic in topics}
        self.replayer = Replayer(self, config, lambda: bag_items(source, names))
        self.replayer.advertise(topics)


def main(args: list[str] | None = None) -> int:
    """Run sensor_publisher; return the exit code."""
    return run_node(
        SensorPublisherNode,
        args,
        __doc__,
        SensorReplayConfig(),
        work=lambda node, executor: node.replayer.run(executor),
    )


if __name__ == '__main__':
    sys.exit(main())

"""
bag_recorder: write topics to an mcap bag, where no ``ros2 bag record`` is installed.

Messages are kept as they came over the wire; topics are joined when they appear.
"""

from __future__ import annotations

import importlib
import sys
import time

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from track_localization.errors import DataError
from track_localization.io.bag_writer import BagWriter
from track_localization.ros.qos import MEASUREMENT_QOS, SENSOR_QOS
from track_localization.ros.spin import run_node

HELP = """bag_recorder: record topics to a bag.

  topics (string array): what to record; empty: every topic that appears
  output (string): folder of the new bag
  reliable (bool, false): ask for reliable delivery; false hears every kind of publisher
"""
HIDDEN = ('/parameter_events', '/rosout')


class BagRecorderNode(Node):
    """Subscribe to what is asked for, as soon as it appears, and write it down."""

    def __init__(self, **node_options: object) -> None:
        super().__init__('bag_recorder', **node_options)

        def text(description: str) -> ParameterDescriptor:
            return ParameterDescriptor(description=description, read_only=True)

        topics = self.declare_parameter('topics', [''], text('topics to record; empty: all'))
        output = self.declare_parameter('output', '', text('folder of the new bag'))
        reliable = self.declare_parameter('reliable', False, text('ask for reliable delivery'))
        if not output.value:
            raise DataError('parameter output is empty: name the folder of the new bag')
        self.output = str(output.value)
        self._qos = SENSOR_QOS if reliable.value else MEASUREMENT_QOS
        self._wanted = {self.resolve_topic_name(t) for t in topics.value if t}
        self._writer: BagWriter | None = None
        self.counts: dict[str, int] = {}
        self._unknown: set[str] = set()

    def record(self, executor: SingleThreadedExecutor) -> None:
        """Record until the context ends; the bag is closed whatever ends it."""
        with BagWriter(self.output) as self._writer:
            self.create_timer(0.2, self._join)
            self._join()
            executor.spin()

    def report(self) -> str:
        """Return how many messages were written, topic by topic."""
        counts = ', '.join(f'{topic} {n}' for topic, n in sorted(self.counts.items()))
        return f'{self.output}: {counts or "nothing was recorded"}'

    def _join(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            known = topic in self.counts or topic in self._unknown or topic in HIDDEN
            if known or (self._wanted and topic not in self._wanted):
                continue
            self._subscribe(topic, types[0])

    def _subscribe(self, topic: str, type_name: str) -> None:
        package, _, name = type_name.split('/')
        try:
            message_type = getattr(importlib.import_module(f'{package}.msg'), name)
        except (ImportError, AttributeError):
            self._unknown.add(topic)
            self.get_logger().warning(f'{topic}: type {type_name} is not installed; not recorded')
            return
        self.counts[topic] = 0

        def write(cdr: bytes) -> None:
            if self._writer is not None:
                self._writer.write_raw(topic, type_name, time.time_ns(), cdr)
                self.counts[topic] += 1

        self.create_subscription(message_type, topic, write, self._qos, raw=True)


def main(args: list[str] | None = None) -> int:
    """Run the recorder until it is told to stop."""
    made: list[BagRecorderNode] = []

    def make() -> BagRecorderNode:
        made.append(BagRecorderNode())
        return made[0]

    code = run_node(make, args, HELP, work=lambda node, executor: node.record(executor))
    if made and code == 0:
        print(made[0].report(), file=sys.stderr)
    return code

"""
Spinning for nodes that live on streams of messages.

rclpy's executor gathers everything that a node could wait for, services, timers and all, twice
for every message: at 100 Hz that costs as much as reading, filtering and publishing. While
messages come in this one waits for them alone, and looks after the rest ten times a second.
"""

from __future__ import annotations

import time

from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription

from track_localization.ros.fast import is_stream

REST_EVERY_S = 0.1
"""How long timers, services and new subscriptions wait at most, while messages come in."""
NANO = 1_000_000_000


class StreamExecutor(SingleThreadedExecutor):
    """
    Waits only for ``fast`` subscriptions as long as their messages come in.

    When they fall silent, or a node has a subscription of another kind (simulated time's /clock),
    it waits for everything, as its base class does.
    """

    def spin(self) -> None:
        """Run callbacks until the executor or its context is shut down."""
        while self.context.ok() and not self._is_shutdown:
            self.spin_once()
            while (streams := self._streams()) and self._handle(streams):
                self.spin_once(timeout_sec=0.0)

    def _streams(self) -> list[Subscription]:
        """Return the subscriptions, or none where one is no stream."""
        found = [s for node in self.get_nodes() for s in node.subscriptions]
        return found if all(is_stream(s) for s in found) else []

    def _handle(self, streams: list[Subscription]) -> int:
        """Handle what comes in until others must be looked after; return how much it was."""
        wait_set = rclpy_implementation.WaitSet(len(streams), 0, 0, 0, 0, 0, self.context.handle)
        handled, end = 0, time.monotonic() + REST_EVERY_S
        while self.context.ok() and (left := end - time.monotonic()) > 0.0:
            wait_set.clear_entities()
            places = [wait_set.add_subscription(stream.handle) for stream in streams]
            wait_set.wait(int(left * NANO))
            for stream, place in zip(streams, places, strict=True):
                if wait_set.is_ready('subscription', place):
                    taken = stream.handle.take_message(stream.msg_type, False)
                    if taken is not None:
                        stream.callback(*taken)
                        handled += 1
        return handled

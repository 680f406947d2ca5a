"""
Publishers and subscriptions for hundreds of messages a second.

What a message costs in rclpy is mostly the executor's preparation for waiting, which grows with
the number of things it waits for. So nothing here waits for middleware events (two for each
publisher and subscription; the other side still warns of incompatible QoS), and where messages have
had to wait one wake-up handles all that have come in: with a backlog a message costs a fraction,
and a node that fell behind catches up instead of losing messages.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from operator import itemgetter
from typing import Any
from weakref import WeakSet

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

BURST = 100
"""Messages handled before other callbacks get their turn."""
BACKLOG = 6000
"""The same where order matters: the whole queues of three sensors."""
ARRIVAL = 'received_timestamp'
WAITED_NS = 1_000_000
"""A message that had to wait longer may have others behind it: looking costs as much as reading."""


_streams: WeakSet[Subscription] = WeakSet()


def is_stream(subscription: Subscription) -> bool:
    """Whether the subscription was made here: its callback takes message and info."""
    return subscription in _streams


def advertise(node: Node, kind: Any, topic: str, qos: QoSProfile) -> Publisher:
    """Return a publisher without event handlers."""
    events = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(kind, topic, qos, event_callbacks=events)


def subscribe(
    node: Node, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile
) -> Subscription:
    """Subscribe so that one wake-up handles all messages that had to wait, at most ``BURST``."""

    def handle(msg: Any, info: dict[str, int]) -> None:
        waited = time.time_ns() - info[ARRIVAL]
        callback(msg)
        if 0 <= waited < WAITED_NS:
            return
        for _ in range(BURST - 1):
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, False)
            if taken is None:
                return
            callback(taken[0])

    events = SubscriptionEventCallbacks(use_default_callbacks=False)
    subscription = node.create_subscription(kind, topic, handle, qos, event_callbacks=events)
    _streams.add(subscription)
    return subscription


class InOrder:
    """
    Several subscriptions whose messages are handled in the order in which they arrived.

    Left to itself a node that fell behind takes what waits topic by topic: half a second of one
    sensor, then half a second of the next, which an estimator must take for late.
    """

    def __init__(self) -> None:
        self._joined: list[tuple[Subscription, Callable[[Any], None]]] = []

    def subscribe(
        self, node: Node, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile
    ) -> Subscription:
        """Subscribe; one wake-up handles all messages that wait, on whichever topic."""

        def handle(msg: Any, info: dict[str, int]) -> None:
            waiting = [(info[ARRIVAL], callback, msg)]
            # Once more after the last one found: one topic may fill while another is emptied.
            while len(waiting) < BACKLOG and (more := self._take()):
                waiting += more
            for _, call, taken in sorted(waiting, key=itemgetter(0)):
                call(taken)

        events = SubscriptionEventCallbacks(use_default_callbacks=False)
        subscription = node.create_subscription(kind, topic, handle, qos, event_callbacks=events)
        self._joined.append((subscription, callback))
        _streams.add(subscription)
        return subscription

    def _take(self) -> list[tuple[int, Callable[[Any], None], Any]]:
        """Take what waits, of each topic."""
        found: list[tuple[int, Callable[[Any], None], Any]] = []
        for subscription, callback in self._joined:
            with subscription.handle:
                while len(found) < BACKLOG and (
                    taken := subscription.handle.take_message(subscription.msg_type, False)
                ):
                    found.append((taken[1][ARRIVAL], callback, taken[0]))
        return found

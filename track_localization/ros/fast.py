"""
Publishers and subscriptions for hundreds of messages a second.

What a message costs in rclpy is mostly the executor's preparation for waiting, which grows with
the number of things it waits for. So nothing here waits for middleware events (two for each
publisher and subscription; the other side still warns of incompatible QoS), and one wake-up
handles every message that has come in: with a backlog a message costs a fraction, and a node that
fell behind catches up instead of losing messages.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

BURST = 100
"""Messages handled before other callbacks get their turn."""


def advertise(node: Node, kind: Any, topic: str, qos: QoSProfile) -> Publisher:
    """Return a publisher without event handlers."""
    events = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(kind, topic, qos, event_callbacks=events)


def subscribe(
    node: Node, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile
) -> Subscription:
    """Subscribe so that one wake-up handles all messages that wait, at most ``BURST``."""

    def handle(msg: Any) -> None:
        callback(msg)
        for _ in range(BURST - 1):
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, False)
            if taken is None:
                return
            callback(taken[0])

    events = SubscriptionEventCallbacks(use_default_callbacks=False)
    subscription = node.create_subscription(kind, topic, handle, qos, event_callbacks=events)
    return subscription

"""Who publishes a topic, and whether a subscription can hear it."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription


def type_name(kind: Any) -> str:
    """Return 'package/msg/Name' of a message class."""
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


def wrong_publishers(node: Node, subscription: Subscription) -> str:
    """
    Return what is wrong with the publishers of a subscription's topic; '' if nothing.

    The middleware does not join a subscription and a publisher of another type, and says nothing.
    """
    wanted = type_name(subscription.msg_type)
    for info in node.get_publishers_info_by_topic(subscription.topic_name):
        if info.topic_type != wanted:
            return (
                f'{info.node_name} publishes {subscription.topic_name} as {info.topic_type}, '
                f'but {wanted} is needed'
            )
    return ''

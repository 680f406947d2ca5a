"""Transforms, where a full ROS installation has tf2_ros; without it one line says so."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node

from track_localization.ros.convert import set_stamp


def transform(
    time_s: float, position: NDArray, quaternion: NDArray, parent: str, child: str
) -> TransformStamped:
    """Return the transform ``parent`` -> ``child`` at ``time_s`` [s]."""
    msg = TransformStamped()
    set_stamp(msg.header.stamp, time_s)
    msg.header.frame_id, msg.child_frame_id = parent, child
    translation, rotation = msg.transform.translation, msg.transform.rotation
    translation.x, translation.y, translation.z = position.tolist()
    rotation.x, rotation.y, rotation.z, rotation.w = quaternion.tolist()
    return msg


def make_broadcaster(node: Node) -> Callable[[TransformStamped], None] | None:
    """Return what sends a transform, or None, logged, where tf2_ros is not installed."""
    try:
        tf2_ros = importlib.import_module('tf2_ros')
    except ImportError:
        node.get_logger().warning('publish_tf is true but tf2_ros is not installed: no transforms')
        return None
    send: Callable[[TransformStamped], None] = tf2_ros.TransformBroadcaster(node).sendTransform
    return send

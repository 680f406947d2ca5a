"""The pose that a bag tells a vehicle to start from."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.io import bags, codec

Array = NDArray[np.float64]


def read_start(path: str | Path, topic: str) -> tuple[float, Array, Array, Array] | None:
    """
    Return stamp [s], position (3,), quaternion (4,) and covariance (6, 6) of a bag's first pose.

    None where the bag has no such topic, or no pose on it. Raise DataError for another message
    type, or a pose whose quaternion or covariance cannot be used.
    """
    topics = bags.list_topics(path)
    name = bags.resolve_topic(path, topics, topic)
    if name is None:
        return None
    if topics[name] != codec.POSE:
        raise DataError(f'{path}: topic {name} holds {topics[name]}, not {codec.POSE}')
    for _, time_ns, message in bags.messages(path, [name], {}):
        pose = message.pose.pose
        p, q = pose.position, pose.orientation
        position, quaternion = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
        covariance = np.array(message.pose.covariance, dtype=np.float64).reshape(6, 6)
        norm = math.hypot(*quaternion)
        if not abs(norm - 1.0) < 0.01:
            raise DataError(f'{path}: the quaternion of {name} has the length {norm:g}, not 1')
        if not (np.isfinite(covariance).all() and (np.diag(covariance) > 0.0).all()):
            raise DataError(f'{path}: {name} has no covariance; tell how sure the pose is')
        stamp = codec.header_ns(message) or time_ns
        return stamp / codec.NANO, position, quaternion / norm, covariance
    return None

"""Quality of service: who may lose what."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(
    depth: int, reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=durability,
    )


MEASUREMENT_QOS = _profile(2000, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
"""Subscribing to sensors: hears every kind of publisher; deep enough for 2 s at 1 kHz."""

SENSOR_QOS = _profile(2000, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""Publishing recorded sensor messages: nothing is lost to a subscriber that asks for that."""

OUTPUT_QOS = _profile(500, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""
Publishing estimates. A node that catches up publishes a hundred in one go: of ten kept for sending
again, a subscriber that was busy just then lost some.
"""

STATIC_QOS = _profile(1, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
"""Publishing what does not change: late subscribers still get it."""

PACE_QOS = _profile(1, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
"""Following the progress of a consumer: only the newest stamp matters."""

CLOCK_QOS = _profile(10, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""Publishing /clock."""

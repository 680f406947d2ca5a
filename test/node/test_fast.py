"""Subscriptions that handle every waiting message in one wake-up."""

from __future__ import annotations

import time

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile

from track_localization.ros.fast import BURST, advertise, subscribe


def test_a_backlog_is_handled_in_order_in_one_wake_up(ros):
    node = ros.node('both')
    received, other = [], []
    qos = QoSProfile(depth=1000)
    publisher = advertise(node, Time, 'ticks', qos)
    subscribe(node, Time, 'ticks', lambda msg: received.append(msg.sec), qos)
    ros.wait_matched(publisher)
    for i in range(BURST + 50):
        publisher.publish(Time(sec=i))
    time.sleep(0.3)  # all of them are in the queue before the first wake-up
    node.create_timer(0.0, lambda: other.append(len(received)))
    assert ros.spin_until(lambda: len(received) == BURST + 50)
    assert received == list(range(BURST + 50))
    assert min(count for count in other if count) == BURST

"""Subscriptions that handle every waiting message in one wake-up."""

from __future__ import annotations

import time

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile

from track_localization.ros.fast import BURST, InOrder, advertise, subscribe


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


def test_messages_of_several_topics_are_handled_in_the_order_of_arrival(ros, rng):
    """A backlog on three topics, sent in a random order: handled in that order, none left."""
    node, received, together = ros.node('both'), [], InOrder()
    qos = QoSProfile(depth=1000)
    publishers = []
    for i in range(3):
        publishers.append(advertise(node, Time, f'ticks_{i}', qos))
        together.subscribe(node, Time, f'ticks_{i}', received.append, qos)
    for publisher in publishers:
        ros.wait_matched(publisher)
    order = rng.integers(0, 3, 5 * BURST).tolist()
    for i, topic in enumerate(order):
        publishers[topic].publish(Time(sec=i, nanosec=topic))
    time.sleep(0.3)  # all of them are in the queues before the first wake-up
    assert ros.spin_until(lambda: received)
    assert [(msg.sec, msg.nanosec) for msg in received] == list(enumerate(order))


def test_messages_that_come_one_by_one_are_handled_at_once(ros):
    node, received, together = ros.node('both'), [], InOrder()
    publishers = [advertise(node, Time, topic, QoSProfile(depth=10)) for topic in ('a', 'b')]
    for publisher in publishers:
        together.subscribe(node, Time, publisher.topic, received.append, QoSProfile(depth=10))
        ros.wait_matched(publisher)
    for i in range(20):
        publishers[i % 2].publish(Time(sec=i))
        assert ros.spin_until(lambda count=i: len(received) == count + 1)
    assert [msg.sec for msg in received] == list(range(20))

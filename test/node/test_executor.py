"""The executor for streams: cheap while messages come in, and nothing else is forgotten."""

from __future__ import annotations

import contextlib
import threading
import time

import pytest
from builtin_interfaces.msg import Time
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from track_localization.ros.executor import REST_EVERY_S, StreamExecutor
from track_localization.ros.fast import advertise, subscribe

QOS = QoSProfile(depth=1000)


class Counting(StreamExecutor):
    """Counts how often it waits for everything."""

    waits = 0

    def spin_once(self, timeout_sec=None):
        self.waits += 1
        super().spin_once(timeout_sec)


@pytest.fixture
def spun(ros):
    """Return a function that spins a node on a ``Counting`` in a thread of its own."""
    running = []

    def spin(node):
        ros.executor.remove_node(node)
        executor = Counting(context=ros.context)
        executor.add_node(node)

        def run():
            with contextlib.suppress(ExternalShutdownException):
                executor.spin()

        thread = threading.Thread(target=run)
        thread.start()
        running.append((executor, thread))
        return executor, thread

    yield spin
    for executor, thread in running:
        executor.shutdown(timeout_sec=0)
        thread.join(10.0)
        assert not thread.is_alive()


def send(ros, publisher, count, pause_s=0.005):
    for i in range(count):
        publisher.publish(Time(sec=i))
        ros.spin_for(pause_s)


def test_messages_are_handled_without_waiting_for_everything(ros, spun):
    node, received = ros.node('node'), []
    subscribe(node, Time, 'ticks', lambda msg: received.append(msg.sec), QOS)
    executor, _ = spun(node)
    publisher = advertise(ros.node('sender'), Time, 'ticks', QOS)
    ros.wait_matched(publisher)
    send(ros, publisher, 300)
    assert ros.spin_until(lambda: len(received) == 300)
    assert received == list(range(300))
    assert executor.waits < 100


def test_timers_and_services_have_their_turn_while_messages_come_in(ros, spun):
    node, ticks = ros.node('node'), []
    node.create_timer(0.2, lambda: ticks.append(time.monotonic()))
    node.create_service(Trigger, 'ask', lambda _, response: response)
    subscribe(node, Time, 'ticks', lambda msg: None, QOS)
    spun(node)
    other = ros.node('sender')
    publisher, client = advertise(other, Time, 'ticks', QOS), other.create_client(Trigger, 'ask')
    ros.wait_matched(publisher)
    assert ros.spin_until(client.service_is_ready)
    asked = client.call_async(Trigger.Request())
    begin = time.monotonic()
    while time.monotonic() < begin + 2.0:
        send(ros, publisher, 1)
    assert asked.done()
    assert 6 <= len([t for t in ticks if t > begin]) <= 11


def test_a_service_is_answered_at_once_where_nothing_comes_in(ros, spun):
    node = ros.node('node')
    node.create_service(Trigger, 'ask', lambda _, response: response)
    subscribe(node, Time, 'ticks', lambda msg: None, QOS)
    spun(node)
    client = ros.node('sender').create_client(Trigger, 'ask')
    assert ros.spin_until(client.service_is_ready)
    took = []
    for _ in range(10):
        begin = time.monotonic()
        asked = client.call_async(Trigger.Request())
        assert ros.spin_until(asked.done)
        took.append(time.monotonic() - begin)
    assert min(took) < 0.5 * REST_EVERY_S


def test_a_node_with_other_subscriptions_hears_them_all(ros, spun):
    """As /clock is: ten of its messages a second would be far too few."""
    node, received, clock = ros.node('node'), [], []
    subscribe(node, Time, 'ticks', received.append, QOS)
    node.create_subscription(Time, 'other', clock.append, QOS)
    spun(node)
    sender = ros.node('sender')
    publishers = [advertise(sender, Time, topic, QOS) for topic in ('ticks', 'other')]
    for publisher in publishers:
        ros.wait_matched(publisher)
    for _ in range(200):
        for publisher in publishers:
            publisher.publish(Time())
        ros.spin_for(0.002)
    assert ros.spin_until(lambda: len(received) == len(clock) == 200, timeout=2.0)


def test_it_ends_while_messages_come_in(ros, spun):
    node, received = ros.node('node'), []
    subscribe(node, Time, 'ticks', received.append, QOS)
    executor, thread = spun(node)
    publisher = advertise(ros.node('sender'), Time, 'ticks', QOS)
    ros.wait_matched(publisher)
    send(ros, publisher, 50)
    assert len(received) > 10
    executor.shutdown(timeout_sec=0)
    send(ros, publisher, 50)
    thread.join(5.0)
    assert not thread.is_alive()

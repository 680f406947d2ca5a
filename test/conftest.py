"""What the tests share: a random generator, and ROS in a domain of this process's own."""

from __future__ import annotations

import contextlib
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from track_localization.track.design_ride import DesignRide, write_design_ride

FIRST_PORT = 21300
_claimed: list[socket.socket] = []


def claim_domain_id() -> int:
    """Return a DDS domain id that no other test process has: the first free TCP port tells."""
    for domain_id in range(1, 101):
        claim = socket.socket()
        try:
            claim.bind(('127.0.0.1', FIRST_PORT + domain_id))
        except OSError:
            claim.close()
            continue
        _claimed.append(claim)
        return domain_id
    raise RuntimeError('no free DDS domain id')


def pytest_configure(config: pytest.Config) -> None:
    """Keep DDS on this machine and to this process and its children; logs out of HOME."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(claim_domain_id())
    os.environ.setdefault('ROS_LOG_DIR', tempfile.gettempdir())


def pytest_unconfigure(config: pytest.Config) -> None:
    while _claimed:
        _claimed.pop().close()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1)


class Ros:
    """A context and an executor of one test, with what tests do to nodes."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self._nodes: list[Any] = []
        self._thread: threading.Thread | None = None

    def make(self, node_class: Callable[..., Any], *args: Any, **parameters: Any) -> Any:
        """Return ``node_class(*args)`` in this context; ``a__b=1`` sets the parameter a.b."""
        node = self.make_apart(node_class, *args, **parameters)
        self.executor.add_node(node)
        return node

    def make_apart(self, node_class: Callable[..., Any], *args: Any, **parameters: Any) -> Any:
        """Return a node as ``make`` does, but not on this bench's executor."""
        from rclpy.parameter import Parameter

        overrides = [Parameter(k.replace('__', '.'), value=v) for k, v in parameters.items()]
        node = node_class(*args, context=self.context, parameter_overrides=overrides)
        self._nodes.append(node)
        return node

    def keep(self, node: Any) -> None:
        """Take over a node made elsewhere in this context, to be destroyed in the end."""
        self._nodes.append(node)
        self.executor.add_node(node)

    def run_replay(self, node: Any) -> None:
        """Run a replaying node on an executor of its own, the bench's nodes in the background."""
        from rclpy.executors import SingleThreadedExecutor

        own = SingleThreadedExecutor(context=self.context)
        own.add_node(node)
        if self._thread is None:
            self._thread = threading.Thread(target=self._spin_quietly)
            self._thread.start()
        try:
            node.replayer.run(own)
        finally:
            own.shutdown(timeout_sec=0)

    def settle(self, condition: Callable[[], bool], timeout: float = 30.0) -> None:
        """Wait, the executor spinning in the background, until a condition holds."""
        deadline = time.monotonic() + timeout
        while not condition() and time.monotonic() < deadline:
            time.sleep(0.02)

    def _spin_quietly(self) -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            self.executor.spin()

    def node(self, name: str, **options: Any) -> Any:
        """Return a bare node."""
        from rclpy.node import Node

        node = Node(name, context=self.context, **options)
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def listen(self, node: Any, kind: Any, topic: str, depth: int = 5000) -> list[Any]:
        """Return a list that fills with the messages of a topic while the executor spins."""
        from rclpy.qos import QoSProfile

        from track_localization.ros.fast import subscribe

        received: list[Any] = []
        subscribe(node, kind, topic, received.append, QoSProfile(depth=depth))
        return received

    def spin_until(self, condition: Callable[[], bool], timeout: float = 10.0) -> bool:
        """Spin until the condition holds; return whether it came to hold in time."""
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.02)
        return True

    def spin_for(self, seconds: float) -> None:
        """Spin for a while, where what is tested is that something does *not* happen."""
        self.spin_until(lambda: False, seconds)

    def wait_matched(self, publisher: Any, subscriptions: int = 1) -> None:
        """Wait until a publisher has subscribers; fail after ten seconds."""
        matched = self.spin_until(lambda: publisher.get_subscription_count() >= subscriptions)
        assert matched, f'{publisher.topic_name}: nobody subscribed'

    def close(self) -> None:
        """End everything, in the order that DDS likes."""
        self.executor.shutdown(timeout_sec=0)
        if self._thread is not None:
            self._thread.join(timeout=10.0)
        for node in self._nodes:
            node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def ros() -> Iterator[Ros]:
    bench = Ros()
    yield bench
    bench.close()


@pytest.fixture(scope='module')
def ros_module() -> Iterator[Ros]:
    """One bench for a whole module: property-based tests make many examples of one test."""
    bench = Ros()
    yield bench
    bench.close()


def circle_ride(rest_s: float = 3.0, ride_s: float = 30.0, rate_hz: float = 100.0) -> DesignRide:
    """
    Return a ride on a level circle of 40 m radius from its closed form: rest, then 2 m/s^2 to 12.

    The body looks along the circle; specific force is acceleration plus gravity in its axes.
    """
    radius, top, pull = 40.0, 12.0, 2.0
    t = np.arange(round((rest_s + ride_s) * rate_hz)) / rate_hz
    moving = np.clip(t - rest_s, 0.0, None)
    speed = np.minimum(pull * moving, top)
    s = np.where(moving < top / pull, 0.5 * pull * moving**2, top * moving - 0.5 * top**2 / pull)
    angle = s / radius
    zero = np.zeros_like(t)
    accelerating = (moving > 0.0) & (moving < top / pull)
    yaw = angle + 0.5 * np.pi
    return DesignRide(
        time_s=t,
        chainage=s,
        position=np.stack([radius * np.cos(angle), radius * np.sin(angle), zero], axis=1),
        quaternion=np.stack([zero, zero, np.sin(0.5 * yaw), np.cos(0.5 * yaw)], axis=1),
        velocity=np.stack([-speed * np.sin(angle), speed * np.cos(angle), zero], axis=1),
        specific_force=np.stack(
            [pull * accelerating, speed**2 / radius, np.full_like(t, 9.80665)], axis=1
        ),
        angular_rate=np.stack([zero, zero, speed / radius], axis=1),
    )


@pytest.fixture(scope='session')
def circle_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``design_ride.csv`` of the circle."""
    path = tmp_path_factory.mktemp('circle') / 'design_ride.csv'
    write_design_ride(path, circle_ride())
    return path


@pytest.fixture(scope='session')
def circle() -> DesignRide:
    """The circle itself."""
    return circle_ride()

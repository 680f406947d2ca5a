"""A recording whose samples carry their number, and a node that answers each."""

from __future__ import annotations

import time

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from track_localization.estimation.imu import ImuSeries
from track_localization.ros.qos import MEASUREMENT_QOS, OUTPUT_QOS

START_S = 1000.0


def series(n: int, rate_hz: float) -> ImuSeries:
    """Return samples that carry their own number on x, so that a loss shows."""
    t = START_S + np.arange(n) / rate_hz
    force = np.stack([np.arange(n) / 1e4, np.zeros(n), np.full(n, 9.81)], axis=1)
    return ImuSeries(t, force, np.full((n, 3), 0.01))


def wait_until(condition, timeout=5.0) -> bool:
    deadline = time.monotonic() + timeout
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(condition())


class Consumer:
    """A node that answers each Imu with an odometry of the same stamp, like a filter."""

    def __init__(self, ros, silent=0, stall_after=10**9, busy_s=0.0, each=1):
        self.node, self.each = ros.node('consumer'), each
        self.received: list[Imu] = []
        self.silent, self.stall_after, self.busy_s = silent, stall_after, busy_s
        self.pub = self.node.create_publisher(Odometry, 'odometry', OUTPUT_QOS)
        self.node.create_subscription(Imu, 'imu/data_raw', self.on_imu, MEASUREMENT_QOS)

    def on_imu(self, msg: Imu) -> None:
        self.received.append(msg)
        time.sleep(self.busy_s)
        due = len(self.received) % self.each == 0
        if due and self.silent < len(self.received) <= self.stall_after:
            self.pub.publish(Odometry(header=msg.header))

    @property
    def numbers(self) -> list[int]:
        return [round(msg.linear_acceleration.x * 1e4) for msg in self.received]

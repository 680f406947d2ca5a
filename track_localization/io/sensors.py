"""
Sensors of a bag that tell one number at a time: induction loop, radar, balise, wheel.

Their messages stand in one table in the order in which they arrived, as a live system would have
got them; the time of measurement is the header stamp. Nothing is judged here but whether a message
can be read: NaN, negative variances and frames are for whoever fuses.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.io import bags, codec

Array = NDArray[np.float64]

Reading = tuple[float, float]
"""A value and its variance."""


class ScalarTopic(NamedTuple):
    """A sensor's name, the topic that it is on, and the message type, a key of ``READERS``."""

    sensor: str
    topic: str
    msgtype: str


@dataclasses.dataclass(frozen=True)
class Readings:
    """
    What several sensors told, in order of arrival; N rows.

    Attributes:
        sensor: (N,) names.
        time_s: (N,) header stamps [s].
        arrival_s: (N,) times at which the recorder got them [s].
        value: (N,) x of a pose [m], or forward speed of a twist [m/s].
        variance: (N,) claimed by the sender [m^2] or [m^2/s^2].
        frame: (N,) ``frame_id`` of the headers.
        topics: name in the bag of each sensor that it has.
        rejected: what could not be read, sensor (or ``bag``) -> reason -> count;
            ``no_header_stamp`` counts rows that got the time of arrival as their stamp.
    """

    sensor: tuple[str, ...]
    time_s: Array
    arrival_s: Array
    value: Array
    variance: Array
    frame: tuple[str, ...]
    topics: dict[str, str]
    rejected: dict[str, dict[str, int]]

    def __len__(self) -> int:
        return len(self.sensor)

    @property
    def duration_s(self) -> float:
        """From the first arrival to the last [s]."""
        return float(np.ptp(self.arrival_s)) if len(self) else 0.0

    def count(self, sensor: str) -> int:
        """Return how many rows a sensor has."""
        return self.sensor.count(sensor)


def read_sensors(path: str | Path, wanted: Sequence[ScalarTopic]) -> Readings:
    """
    Return the readings of the wanted sensors that a bag has.

    Raises:
        DataError: no such bag, none of the topics in it, a topic of another message type, or not
            one message on them that can be read.
    """
    path = Path(path)
    topics = bags.list_topics(path)
    found = {}
    for sensor in wanted:
        name = bags.resolve_topic(path, topics, sensor.topic)
        if name is None:
            continue
        if topics[name] != sensor.msgtype:
            raise DataError(
                f'{path}: topic {name} holds {topics[name]}, not {sensor.msgtype}; name another '
                f'(--remap {sensor.topic}:=TOPIC)'
            )
        found[name] = sensor
    if not found:
        raise DataError(
            f'{path}: none of the topics {", ".join(s.topic for s in wanted)}; it has '
            f'{", ".join(sorted(topics)) or "no topics"}; name yours (--remap '
            f'{wanted[0].topic}:=TOPIC)'
        )
    readings = _read(path, found)
    if not len(readings):
        raise DataError(
            f'{path}: no message on {", ".join(found)} that can be read '
            f'({readings.rejected or "they are empty"})'
        )
    return readings


def pose_reading(message: Any) -> Reading:
    """Return ``position.x`` [m] of a PoseWithCovarianceStamped and its variance [m^2]."""
    return float(message.pose.pose.position.x), float(message.pose.covariance[0])


def twist_reading(message: Any) -> Reading:
    """Return ``linear.x`` [m/s] of a TwistWithCovarianceStamped and its variance [m^2/s^2]."""
    return float(message.twist.twist.linear.x), float(message.twist.covariance[0])


READERS: dict[str, Callable[[Any], Reading]] = {
    codec.POSE: pose_reading,
    codec.TWIST: twist_reading,
}
"""Message types that tell one number, and how it is taken out."""


def _read(path: Path, found: dict[str, ScalarTopic]) -> Readings:
    """Read the topics of ``found``, {name in the bag: sensor}."""
    damage: dict[str, int] = {}
    names, frames, stamps, logged = [], [], [], []
    rows: list[Reading] = []
    for topic, time_ns, message in bags.messages(path, list(found), damage):
        sensor = found[topic]
        names.append(sensor.sensor)
        frames.append(str(message.header.frame_id))
        stamps.append(codec.header_ns(message))
        logged.append(time_ns)
        rows.append(READERS[sensor.msgtype](message))
    rejected = {'bag': damage} if damage else {}
    for sensor in found.values():
        unstamped = _without_stamps(sensor.sensor, names, stamps)
        for i in unstamped:
            stamps[i] = logged[i]
        if unstamped:
            rejected[sensor.sensor] = {'no_header_stamp': len(unstamped)}
    values = np.array(rows, dtype=np.float64).reshape(-1, 2)
    return Readings(
        sensor=tuple(names),
        time_s=_seconds(stamps),
        arrival_s=_seconds(logged),
        value=values[:, 0],
        variance=values[:, 1],
        frame=tuple(frames),
        topics={sensor.sensor: topic for topic, sensor in found.items()},
        rejected=rejected,
    )


def _without_stamps(sensor: str, names: list[str], stamps: list[int]) -> list[int]:
    """Return the rows of a sensor none of whose headers was ever stamped, else nothing."""
    rows = [i for i, name in enumerate(names) if name == sensor]
    return [] if any(stamps[i] for i in rows) else rows


def _seconds(ns: list[int]) -> Array:
    return np.array([t / codec.NANO for t in ns], dtype=np.float64)

"""
What a train's bag tells: IMU samples, satellite fixes with their quality, the odometer's speed.

Every sensor's messages stand in columns, in the order in which they arrived; ``Recorded.arrivals``
brings the sensors together in the order in which a live system would have got them. The time of
measurement is the header stamp. Nothing is judged here but whether a message can be read: NaN and
negative variances are for whoever fuses.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.io import bags, codec

Array = NDArray[np.float64]

IMU, GNSS, QUALITY, WHEEL = 'imu', 'gnss', 'quality', 'wheel'
"""Sensors by name."""

FIX = 'sensor_msgs/msg/NavSatFix'
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
STATUS = 'diagnostic_msgs/msg/DiagnosticStatus'

TOPICS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    IMU: ('imu/data_raw', (codec.IMU,)),
    GNSS: ('gnss/fix', (FIX,)),
    QUALITY: ('gnss/quality', (DIAGNOSTICS, STATUS)),
    WHEEL: ('wheel/twist', (codec.TWIST,)),
}
"""The topic of each sensor, and the message types that it may have."""

SATELLITES_KEY, HDOP_KEY = 'satellites_used', 'hdop'
UNKNOWN_COVARIANCE = 0
TOGETHER_S = 0.5
"""A quality without a stamp belongs to a fix that arrived within this [s]."""


@dataclasses.dataclass(frozen=True)
class Fixes:
    """
    Satellite fixes (K,).

    Attributes:
        time_s: stamps [s].
        latitude, longitude: [rad].
        height: above the ellipsoid [m].
        covariance: (K, 3, 3) east, north, up [m^2]; NaN where the message tells none.
        valid: whether the receiver says that it has a fix.
    """

    time_s: Array
    latitude: Array
    longitude: Array
    height: Array
    covariance: Array
    valid: NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class Qualities:
    """Satellites in use (K,), -1 where not told, and HDOP (K,), NaN where not; stamps [s]."""

    time_s: Array
    satellites: NDArray[np.int64]
    hdop: Array


@dataclasses.dataclass(frozen=True)
class Speeds:
    """Forward speeds (K,) [m/s] with their variances; stamps [s]."""

    time_s: Array
    speed: Array
    variance: Array


@dataclasses.dataclass(frozen=True)
class Recorded:
    """
    What the sensors of a bag told.

    Attributes:
        imu, fixes, qualities, speeds: columns of each sensor, in order of arrival.
        arrival_s: times at which the recorder got each sensor's messages [s].
        sensor: (N,) the sensor of each message, in order of arrival.
        topics: name in the bag of each sensor that it has.
        rejected: what could not be read, sensor (or ``bag``) -> reason -> count;
            ``no_header_stamp`` counts rows that got the time of arrival as their stamp.
    """

    imu: ImuSeries
    fixes: Fixes
    qualities: Qualities
    speeds: Speeds
    arrival_s: dict[str, Array]
    sensor: tuple[str, ...]
    topics: dict[str, str]
    rejected: dict[str, dict[str, int]]

    def __len__(self) -> int:
        return len(self.sensor)

    @property
    def duration_s(self) -> float:
        """From the first arrival to the last [s]."""
        times = np.concatenate(list(self.arrival_s.values()))
        return float(np.ptp(times)) if len(times) else 0.0

    def count(self, sensor: str) -> int:
        """Return how many messages a sensor has."""
        return len(self.arrival_s[sensor])

    def arrivals(self) -> Iterator[tuple[str, int]]:
        """Yield (sensor, row of its columns) in order of arrival."""
        rows = dict.fromkeys(TOPICS, 0)
        for sensor in self.sensor:
            yield sensor, rows[sensor]
            rows[sensor] += 1


def read_recorded(path: str | Path, remap: Mapping[str, str] | None = None) -> Recorded:
    """
    Return what IMU, receiver and odometer of a bag told; ``remap`` gives a sensor's own topic.

    Raises:
        DataError: no such bag, no IMU or no fixes in it, a topic of another message type, or not
            one message of the IMU that can be read.
    """
    path = Path(path)
    found, kinds = _found(path, remap or {})
    damage: dict[str, int] = {}
    sensors: list[str] = []
    rows: dict[str, list[tuple[float, ...]]] = {sensor: [] for sensor in TOPICS}
    stamps: dict[str, list[int]] = {sensor: [] for sensor in TOPICS}
    logged: dict[str, list[int]] = {sensor: [] for sensor in TOPICS}
    for topic, time_ns, message in bags.messages(path, list(found), damage):
        sensor = found[topic]
        sensors.append(sensor)
        rows[sensor].append(READERS[sensor](message))
        stamps[sensor].append(codec.header_ns(message) if hasattr(message, 'header') else 0)
        logged[sensor].append(time_ns)
    if not rows[IMU]:
        raise DataError(
            f'{path}: no IMU sample that can be read ({damage or "the topic is empty"}); '
            'the train needs its IMU'
        )
    arrival_s = {sensor: _seconds(logged[sensor]) for sensor in TOPICS}
    time_s, unstamped = _stamped(stamps, arrival_s, STATUS in kinds)
    values = {s: np.array(rows[s], dtype=np.float64).reshape(-1, WIDTHS[s]) for s in TOPICS}
    topics = {sensor: topic for topic, sensor in found.items()}
    rejected = ({'bag': damage} if damage else {}) | unstamped
    return Recorded(*_columns(time_s, values), arrival_s, tuple(sensors), topics, rejected)


def _stamped(
    stamps: dict[str, list[int]], arrival_s: dict[str, Array], bare_quality: bool
) -> tuple[dict[str, Array], dict[str, dict[str, int]]]:
    """Return the stamps of each sensor [s], and counts of those that are times of arrival."""
    time_s = {sensor: _seconds(ns) for sensor, ns in stamps.items()}
    counts = {}
    for sensor, ns in stamps.items():
        if ns and not any(ns) and not (sensor == QUALITY and bare_quality):
            time_s[sensor] = arrival_s[sensor]
            counts[sensor] = {'no_header_stamp': len(ns)}
    if bare_quality:
        time_s[QUALITY] = _of_fixes(arrival_s[QUALITY], time_s[GNSS], arrival_s[GNSS])
    return time_s, counts


def _columns(
    time_s: dict[str, Array], values: dict[str, Array]
) -> tuple[ImuSeries, Fixes, Qualities, Speeds]:
    """Return the columns of the sensors, of rows as ``READERS`` give them."""
    fix, quality, speed = values[GNSS], values[QUALITY], values[WHEEL]
    return (
        ImuSeries(time_s[IMU], values[IMU][:, :3], values[IMU][:, 3:]),
        Fixes(
            time_s[GNSS], np.radians(fix[:, 0]), np.radians(fix[:, 1]), fix[:, 2],
            fix[:, 3:12].reshape(-1, 3, 3), fix[:, 12] > 0.5,
        ),
        Qualities(time_s[QUALITY], quality[:, 0].astype(np.int64), quality[:, 1]),
        Speeds(time_s[WHEEL], speed[:, 0], speed[:, 1]),
    )  # fmt: skip


def fix_row(message: Any) -> tuple[float, ...]:
    """Return latitude, longitude [deg], height [m], covariance (9) [m^2], 1 where valid."""
    if message.position_covariance_type == UNKNOWN_COVARIANCE:
        covariance = [math.nan] * 9
    else:
        covariance = [float(v) for v in message.position_covariance]
    valid = 1.0 if message.status.status >= 0 else 0.0
    return (message.latitude, message.longitude, message.altitude, *covariance, valid)


def quality_row(message: Any) -> tuple[float, ...]:
    """Return satellites in use (-1 where not told) and HDOP (NaN) of an array or one status."""
    statuses = message.status if hasattr(message, 'status') else [message]
    told = {pair.key: pair.value for status in statuses for pair in status.values}
    satellites = _number(told.get(SATELLITES_KEY, ''))
    whole = math.isfinite(satellites) and 0.0 <= satellites < 1e6
    return (float(int(satellites)) if whole else -1.0, _number(told.get(HDOP_KEY, '')))


def twist_row(message: Any) -> tuple[float, ...]:
    """Return ``linear.x`` [m/s] and its variance [m^2/s^2]."""
    return float(message.twist.twist.linear.x), float(message.twist.covariance[0])


READERS: dict[str, Callable[[Any], tuple[float, ...]]] = {
    IMU: codec.imu_row,
    GNSS: fix_row,
    QUALITY: quality_row,
    WHEEL: twist_row,
}
WIDTHS = {IMU: 6, GNSS: 13, QUALITY: 2, WHEEL: 2}
"""How many numbers each sensor's messages give."""


def _found(path: Path, remap: Mapping[str, str]) -> tuple[dict[str, str], set[str]]:
    """Return {name in the bag: sensor} of the sensors that a bag has, and their types."""
    topics = bags.list_topics(path)
    found = {}
    for sensor, (topic, kinds) in TOPICS.items():
        name = bags.resolve_topic(path, topics, remap.get(sensor, topic))
        if name is None:
            if sensor in (IMU, GNSS) or sensor in remap:
                raise DataError(
                    f'{path}: no topic {remap.get(sensor, topic)}; it has '
                    f'{", ".join(sorted(topics)) or "no topics"}; name yours '
                    f'(--remap {topic}:=TOPIC)'
                )
            continue
        if topics[name] not in kinds:
            raise DataError(
                f'{path}: topic {name} holds {topics[name]}, not {" or ".join(kinds)}; name '
                f'another (--remap {topic}:=TOPIC)'
            )
        found[name] = sensor
    return found, {topics[name] for name in found}


def _of_fixes(logged_s: Array, stamps_s: Array, fixes_logged_s: Array) -> Array:
    """
    Return stamps (K,) for qualities that have none: those of the fixes that they came with.

    That is the fix that arrived nearest in time; one that came alone keeps its time of arrival.
    """
    if not len(fixes_logged_s):
        return logged_s
    after = np.clip(np.searchsorted(fixes_logged_s, logged_s), 1, len(fixes_logged_s) - 1)
    before_is_nearer = logged_s - fixes_logged_s[after - 1] <= fixes_logged_s[after] - logged_s
    nearest = np.clip(np.where(before_is_nearer, after - 1, after), 0, len(fixes_logged_s) - 1)
    together = np.abs(fixes_logged_s[nearest] - logged_s) < TOGETHER_S
    return np.where(together, stamps_s[nearest], logged_s)


def _number(text: str) -> float:
    """Return a number that a key-value pair tells; NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _seconds(ns: list[int]) -> Array:
    return np.array([t / codec.NANO for t in ns], dtype=np.float64)

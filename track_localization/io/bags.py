"""
Reading ROS 2 bags: a folder, an ``.mcap`` or a ``.db3``, whole or damaged.

Messages are decoded with the Jazzy type store, so bags without type definitions, and bags with
other topics of unknown types, can be read. Time is the header stamp.
"""

from __future__ import annotations

import contextlib
import logging
import re
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import Reader

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries, clean
from track_localization.estimation.trajectory import Trajectory
from track_localization.io import codec
from track_localization.io.bag_writer import BagWriter
from track_localization.io.salvage import Salvage, salvage

__all__ = [
    'BagWriter',
    'is_bag',
    'list_topics',
    'messages',
    'raw_messages',
    'read_imu',
    'read_odometry',
    'resolve_topic',
]

STORAGES = ('.mcap', '.db3')
log = logging.getLogger(__name__)


def is_bag(path: str | Path) -> bool:
    """Whether ``path`` looks like a ROS 2 bag: a storage file, or a folder that holds one."""
    path = Path(path)
    if path.is_dir():
        return (path / 'metadata.yaml').exists() or bool(_storage_files(path))
    return path.suffix in STORAGES


def list_topics(path: str | Path) -> dict[str, str]:
    """Return {topic: message type} of a bag; raise DataError if it cannot be opened."""
    with _open(Path(path)) as readers:
        return _topics(readers)


def resolve_topic(path: str | Path, topics: dict[str, str], wanted: str) -> str | None:
    """
    Return the bag's name for ``wanted``, given with or without a leading slash, or None.

    A topic of that name inside a namespace is taken when it is the only one, and a warning is
    logged. Raise DataError when there are several.
    """
    name = '/' + wanted.strip('/')
    if name in topics:
        return name
    inside = [topic for topic in topics if topic.endswith(name)]
    if len(inside) > 1:
        raise DataError(
            f'{path}: {name} is in several namespaces ({", ".join(sorted(inside))}); name one'
        )
    if not inside:
        return None
    log.warning('%s: no topic %s; reading %s', path, name, inside[0])
    return inside[0]


def raw_messages(
    path: str | Path, topics: Sequence[str] = (), rejected: dict[str, int] | None = None
) -> Iterator[tuple[str, str, int, bytes]]:
    """
    Yield (topic, message type, log time [ns], CDR bytes) in the order of log time.

    Args:
        path: a bag.
        topics: those to read, yielded under the names given here; none means all.
        rejected: what a damaged bag has lost is added here as ``unreadable``; without it such a
            loss raises DataError once everything readable has been yielded.

    Raises:
        DataError: a missing, empty or unreadable bag, or a topic that it does not have.
    """
    path = Path(path)
    with _open(path) as readers:
        names = _names(path, _topics(readers), topics)
        read, expected, least, problem = 0, 0, 0, ''
        for reader in readers:
            least += reader.lost if isinstance(reader, Salvage) else 0
            connections = [c for c in reader.connections if c.topic in names]
            expected += sum(c.msgcount for c in connections)
            if not connections:
                continue
            stored = reader.messages(connections)
            while True:
                try:
                    connection, time_ns, cdr = next(stored)
                except StopIteration:
                    break
                except Exception as error:  # whatever the decoder of a damaged file trips over
                    problem = f'{type(error).__name__}: {error}'
                    least += 1
                    break
                read += 1
                yield names[connection.topic], connection.msgtype, time_ns, bytes(cdr)
    lost = max(expected - read, least)
    if lost:
        said = f'{path}: damaged: {lost} of {read + lost} messages cannot be read'
        if rejected is None or not read:
            raise DataError(
                f'{said} ({problem or "the file is incomplete"}); copy it again or repair it'
            )
        rejected['unreadable'] = rejected.get('unreadable', 0) + lost
        log.warning('%s', said)


def messages(
    path: str | Path, topics: Sequence[str] = (), rejected: dict[str, int] | None = None
) -> Iterator[tuple[str, int, Any]]:
    """
    Yield (topic, log time [ns], message) in the order of log time.

    Arguments and errors as ``raw_messages``; a message that cannot be decoded counts as
    ``undecodable``, or raises DataError without ``rejected``. Topics of types that ROS 2 Jazzy's
    common interfaces do not have are left out when no topics are named, and raise DataError when
    they are.
    """
    skipped: set[str] = set()
    for topic, msgtype, time_ns, cdr in raw_messages(path, topics, rejected):
        if msgtype not in codec.TYPESTORE.types:
            if topics:
                raise DataError(f'{path}: topic {topic} has the unknown type {msgtype}')
            if topic not in skipped:
                skipped.add(topic)
                log.warning('%s: topic %s left out: unknown type %s', path, topic, msgtype)
            continue
        try:
            message = codec.TYPESTORE.deserialize_cdr(cdr, msgtype)
        except Exception as error:  # whatever damaged bytes lead to
            if rejected is None:
                raise DataError(
                    f'{path}: topic {topic} has a damaged message ({error}); copy the bag again'
                ) from None
            rejected['undecodable'] = rejected.get('undecodable', 0) + 1
            continue
        yield topic, time_ns, message


def read_imu(path: str | Path, topic: str = 'imu/data_raw') -> tuple[ImuSeries, dict[str, int]]:
    """
    Return a bag's IMU samples, cleaned, and the counts of what was rejected, by reason.

    Rates are NaN where the message says that there is no gyro. If no header is stamped the log
    times are used, counted as ``no_header_stamp``; other reasons are those of ``clean``,
    ``unreadable`` and ``undecodable``.

    Raises:
        DataError: no such bag or topic, another message type, or no usable sample.
    """
    path = Path(path)
    topic = _require(path, topic, codec.IMU)
    rejected: Counter[str] = Counter()
    stamps, logged, rows = [], [], []
    for _, time_ns, message in messages(path, [topic], rejected):
        stamps.append(codec.header_ns(message))
        logged.append(time_ns)
        rows.append(codec.imu_row(message))
    values = np.array(rows, dtype=np.float64).reshape(-1, 6)
    time_s = _seconds(stamps, logged, rejected)
    series, dropped = clean(ImuSeries(time_s, values[:, :3], values[:, 3:]))
    rejected.update(dropped)
    if not len(series):
        raise DataError(
            f'{path}: topic {topic} has no usable sample ({dict(rejected) or "it is empty"})'
        )
    return series, dict(rejected)


def read_odometry(
    path: str | Path,
    topic: str = 'ground_truth/odometry',
    rejected: dict[str, int] | None = None,
) -> Trajectory | None:
    """
    Return a bag's odometry, velocities rotated into its parent frame; None without the topic.

    Counts of rejected messages, by reason, are added to ``rejected``; see ``read_imu`` and
    ``codec.trajectory_from_rows``. A topic without a usable message gives None too.

    Raises:
        DataError: no such bag, or another message type on the topic.
    """
    path = Path(path)
    name = resolve_topic(path, list_topics(path), topic)
    if name is None:
        return None
    topic = _require(path, name, codec.ODOMETRY)
    counts: Counter[str] = Counter()
    stamps, logged, numbers = [], [], array('d')  # a third of what tuples would take
    for _, time_ns, message in messages(path, [topic], counts):
        stamps.append(codec.header_ns(message))
        logged.append(time_ns)
        numbers.extend(codec.odometry_row(message))
    values = np.array(numbers, dtype=np.float64).reshape(-1, 20)
    trajectory, dropped = codec.trajectory_from_rows(_seconds(stamps, logged, counts), values)
    counts.update(dropped)
    if counts:
        log.warning('%s: topic %s: %s', path, topic, dict(counts))
    if rejected is not None:
        for reason, n in counts.items():
            rejected[reason] = rejected.get(reason, 0) + n
    return trajectory if len(trajectory) else None


def _seconds(stamps: list[int], logged: list[int], counts: Counter[str]) -> codec.Array:
    """Return header stamps [s], or log times when no header was ever stamped."""
    if stamps and not any(stamps):
        counts['no_header_stamp'] += len(stamps)
        stamps = logged
    return np.array([ns / codec.NANO for ns in stamps], dtype=np.float64)


def _require(path: Path, topic: str, msgtype: str) -> str:
    """Return the bag's name of a topic; raise DataError unless it has this message type."""
    topics = list_topics(path)
    name = _names(path, topics, [topic], msgtype).popitem()[0]
    if topics[name] != msgtype:
        raise DataError(f'{path}: topic {name} holds {topics[name]}, not {msgtype}; name another')
    return name


def _names(
    path: Path, topics: dict[str, str], wanted: Sequence[str], msgtype: str = ''
) -> dict[str, str]:
    """Return {name in the bag: name asked for}, or raise DataError for one that is absent."""
    if not wanted:
        return {name: name for name in topics}
    names = {}
    for topic in wanted:
        name = resolve_topic(path, topics, topic)
        if name is None:
            alike = [t for t, kind in topics.items() if kind == msgtype]
            having = (
                f'topics of that type: {", ".join(alike)}'
                if alike
                else (f'it has {", ".join(sorted(topics)) or "no topics"}')
            )
            raise DataError(f'{path}: no topic {topic}; {having}; name one of them (--remap)')
        names[name] = topic
    return names


def _topics(readers: Sequence[Reader | Salvage]) -> dict[str, str]:
    return {c.topic: c.msgtype for reader in readers for c in reader.connections}


def _storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a folder, split recordings in the order of their numbers."""

    def order(path: Path) -> list[tuple[int, str]]:
        return [(int(n or 0), text) for text, n in re.findall(r'(\D+)(\d*)', path.name)]

    return sorted((p for p in folder.iterdir() if p.suffix in STORAGES), key=order)


@contextlib.contextmanager
def _open(path: Path) -> Iterator[list[Reader | Salvage]]:
    """
    Open a bag: one reader, or one per storage file where ``metadata.yaml`` cannot be used.

    A storage file that does not open is salvaged. Raise DataError, naming the file and the
    remedy, when there is nothing to read.
    """
    if not path.exists():
        raise DataError(f'{path}: no such file or folder; give a bag folder, an .mcap or a .db3')
    if not is_bag(path):
        what = 'folder holds no' if path.is_dir() else 'file is not an'
        raise DataError(f'{path}: this {what} .mcap or .db3; give a ROS 2 bag')
    with contextlib.ExitStack() as stack:
        if (path / 'metadata.yaml').exists():
            try:
                reader = stack.enter_context(Reader(path))
            except Exception as error:  # whatever a damaged bag makes the reader trip over
                log.info('%s: metadata.yaml cannot be used (%s)', path, error)
            else:
                yield [reader]
                return
        files = _storage_files(path) if path.is_dir() else [path]
        if not files:
            raise DataError(f'{path}: cannot be opened: metadata.yaml names no file that is here')
        yield [_open_file(file, stack) for file in files]


def _open_file(path: Path, stack: contextlib.ExitStack) -> Reader | Salvage:
    try:
        return stack.enter_context(Reader(path))
    except Exception as error:  # whatever a damaged file makes the reader trip over
        problem = f'{type(error).__name__}: {error}'
    try:
        return salvage(path)
    except DataError:
        raise DataError(
            f'{path}: cannot be opened as a bag ({problem}); it is empty or damaged: copy it '
            'again, or repair it with "ros2 bag reindex" or "mcap recover"'
        ) from None

"""Writing ROS 2 bags as mcap."""

from __future__ import annotations

import heapq
import shutil
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    StoragePlugin,
    Writer,
    WriterError,
)

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.io import codec

Array = NDArray[np.float64]


class Message(NamedTuple):
    """A serialised message: its topic and type, and when it was logged [ns]."""

    topic: str
    msgtype: str
    log_time_ns: int
    cdr: bytes


class BagWriter:
    """
    A new bag: a folder with an mcap file and ``metadata.yaml``; use it in a ``with`` statement.

    It is closed, index and all, even when an exception leaves the ``with`` block, so that what was
    written until then can be read. An existing folder is replaced only with ``overwrite``, and
    then only if it is empty or a bag. With ``compress`` its chunks are zstd, as ROS 2 reads them.
    """

    def __init__(self, path: str | Path, overwrite: bool = False, compress: bool = False) -> None:
        self.path = Path(path)
        self._overwrite, self._compress = overwrite, compress
        self._writer: Writer | None = None
        self._connections: dict[tuple[str, str], Connection] = {}

    def __enter__(self) -> BagWriter:
        if self.path.exists():
            self._clear()
        try:
            self._writer = Writer(self.path, version=9, storage_plugin=StoragePlugin.MCAP)
            if self._compress:
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
        except (WriterError, OSError) as error:
            raise DataError(f'{self.path}: cannot write a bag here ({error})') from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()

    def write_raw(self, topic: str, msgtype: str, log_time_ns: int, cdr: bytes) -> None:
        """Write one message that is already serialised as CDR."""
        if self._writer is None:
            raise RuntimeError('BagWriter is used outside its with statement')
        name = topic if topic.startswith('/') else '/' + topic
        if (name, msgtype) not in self._connections:
            if msgtype not in codec.TYPESTORE.types:
                raise DataError(f'topic {name}: unknown message type {msgtype}')
            self._connections[name, msgtype] = self._writer.add_connection(
                name, msgtype, typestore=codec.TYPESTORE
            )
        self._writer.write(self._connections[name, msgtype], log_time_ns, cdr)

    def write(self, topic: str, msgtype: str, log_time_ns: int, message: Any) -> None:
        """Write one message of rosbags' Jazzy type store."""
        cdr = codec.TYPESTORE.serialize_cdr(message, msgtype)
        self.write_raw(topic, msgtype, log_time_ns, bytes(cdr))

    def write_in_order(self, *streams: Iterable[Message]) -> None:
        """
        Write several topics into one another, by log time; of the same, the first stream leads.

        Each stream must be in order of log time itself.
        """
        for message in heapq.merge(*streams, key=_log_time):
            self.write_raw(*message)

    def write_imu(self, topic: str, series: ImuSeries, frame_id: str = 'imu_link') -> None:
        """Write sensor_msgs/Imu, logged at their own stamps; NaN rates become "no gyro"."""
        for ns, cdr in codec.imu_cdrs(series, frame_id):
            self.write_raw(topic, codec.IMU, ns, cdr)

    def write_odometry(
        self, topic: str, trajectory: Trajectory, frame_id: str = 'map', child: str = 'base_link'
    ) -> None:
        """Write nav_msgs/Odometry, logged at their own stamps, the twist in the body's axes."""
        for ns, cdr in codec.odometry_cdrs(trajectory, frame_id, child):
            self.write_raw(topic, codec.ODOMETRY, ns, cdr)

    def write_pose(
        self,
        topic: str,
        time_s: Array,
        position: Array,
        covariance: Array | None = None,
        quaternion: Array | None = None,
        frame_id: str = 'map',
        log_time_s: Array | None = None,
    ) -> None:
        """
        Write geometry_msgs/PoseWithCovarianceStamped.

        ``time_s`` (N,) header stamps [s], ``position`` (N, 3) [m], ``covariance`` (N, 3, 3) of
        the position [m^2], ``quaternion`` (N, 4) xyzw, ``log_time_s`` (N,) times of arrival
        (default: the stamps).
        """
        logged = (time_s if log_time_s is None else log_time_s).tolist()
        cdrs = codec.pose_cdrs(time_s, position, covariance, quaternion, frame_id)
        for time, (_, cdr) in zip(logged, cdrs, strict=True):
            self.write_raw(topic, codec.POSE, codec.stamp_ns(time), cdr)

    def _clear(self) -> None:
        """Remove the bag (or empty folder) in the way, or raise DataError."""
        if not self._overwrite:
            raise DataError(f'{self.path} exists already; remove it or give another output')
        if not self.path.is_dir():
            raise DataError(f'{self.path} is a file; a bag is written as a folder')
        names = {entry.name for entry in self.path.iterdir()}
        strangers = {n for n in names if n != 'metadata.yaml' and not n.endswith(('.mcap', '.db3'))}
        if strangers:
            raise DataError(
                f'{self.path} holds more than a bag ({min(strangers)}); not overwriting it'
            )
        shutil.rmtree(self.path)


def _log_time(message: Message) -> int:
    return message.log_time_ns

"""
Messages of sensors that tell one number, and of the truth, for ``BagWriter.write_in_order``.

The counterpart of ``sensors``: the header stamp is the time of measurement, the log time that of
arrival, and every stream comes in order of arrival.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.io import codec
from track_localization.io.bag_writer import Message

Array = NDArray[np.float64]


def pose_messages(
    topic: str,
    time_s: Array,
    arrival_s: Array,
    x: Array,
    variance: Array,
    frame_id: str | Sequence[str],
) -> Iterator[Message]:
    """
    Yield PoseWithCovarianceStamped: ``position.x`` [m] and its variance [m^2], all (N,).

    ``frame_id`` is one for all, or (N,) of them.
    """
    frames = [frame_id] * len(time_s) if isinstance(frame_id, str) else list(frame_id)
    order = np.argsort(arrival_s, kind='stable').tolist()
    position, covariance = np.zeros((len(x), 3)), np.zeros((len(x), 3, 3))
    position[:, 0], covariance[:, 0, 0] = x, variance
    for rows in _runs_of_one_frame(order, frames):
        cdrs = codec.pose_cdrs(
            time_s[rows], position[rows], covariance[rows], None, frames[rows[0]]
        )
        yield from _logged(topic, codec.POSE, arrival_s[rows], cdrs)


def twist_messages(
    topic: str,
    time_s: Array,
    arrival_s: Array,
    speed: Array,
    variance: Array,
    frame_id: str = 'base_link',
) -> Iterator[Message]:
    """Yield TwistWithCovarianceStamped: ``linear.x`` [m/s] and its variance, all (N,)."""
    order = np.argsort(arrival_s, kind='stable')
    cdrs = codec.twist_cdrs(time_s[order], speed[order], variance[order], frame_id)
    yield from _logged(topic, codec.TWIST, arrival_s[order], cdrs)


def odometry_messages(
    topic: str, trajectory: Trajectory, frame_id: str = 'map', child: str = 'base_link'
) -> Iterator[Message]:
    """Yield Odometry of every epoch, logged at its stamp."""
    for ns, cdr in codec.odometry_cdrs(trajectory, frame_id, child):
        yield Message(topic, codec.ODOMETRY, ns, cdr)


def _logged(
    topic: str, msgtype: str, arrival_s: Array, cdrs: Iterator[tuple[int, bytes]]
) -> Iterator[Message]:
    for arrival, (_, cdr) in zip(arrival_s.tolist(), cdrs, strict=True):
        yield Message(topic, msgtype, codec.stamp_ns(arrival), cdr)


def _runs_of_one_frame(order: list[int], frames: list[str]) -> Iterator[list[int]]:
    """Cut an order of rows where the frame changes."""
    rows: list[int] = []
    for row in order:
        if rows and frames[row] != frames[rows[0]]:
            yield rows
            rows = []
        rows.append(row)
    if rows:
        yield rows

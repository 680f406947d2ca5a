"""
Messages of a satellite receiver for ``BagWriter.write_in_order``: its fixes, and how good they are.

The header stamp is the time of the fix, the log time that of arrival.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from track_localization.io import codec
from track_localization.io.bag_writer import Message
from track_localization.io.gnss import (
    DIAGNOSTICS,
    FIX,
    HDOP_KEY,
    SATELLITES_KEY,
    UNKNOWN_COVARIANCE,
)

Array = NDArray[np.float64]

NO_FIX, A_FIX = -1, 0
BEIDOU = 4
KNOWN_COVARIANCE = 3

OK, WARN, ERROR = 0, 1, 2
ENOUGH = 4
"""Satellites that a fix in three dimensions takes."""


def fix_messages(
    topic: str,
    time_s: Array,
    arrival_s: Array,
    geodetic: Array,
    covariance: Array,
    status: NDArray[np.bool_],
    frame_id: str = 'gnss',
) -> Iterator[Message]:
    """
    Yield NavSatFix.

    Args:
        topic: where they go.
        time_s: (K,) stamps [s].
        arrival_s: (K,) when they arrive [s].
        geodetic: (K, 3) latitude, longitude [rad], height above the ellipsoid [m].
        covariance: (K, 3, 3) east, north, up [m^2]; all zero is told as unknown.
        status: (K,) whether there is a fix.
        frame_id: the antenna's frame.
    """
    for i in np.argsort(arrival_s, kind='stable').tolist():
        block = np.ascontiguousarray(covariance[i], dtype=np.float64).reshape(9)
        message = codec.make(
            FIX,
            header=codec.header(codec.stamp_ns(float(time_s[i])), frame_id),
            status=codec.make(
                'sensor_msgs/msg/NavSatStatus',
                status=A_FIX if status[i] else NO_FIX,
                service=BEIDOU,
            ),
            latitude=float(np.degrees(geodetic[i, 0])),
            longitude=float(np.degrees(geodetic[i, 1])),
            altitude=float(geodetic[i, 2]),
            position_covariance=block,
            position_covariance_type=KNOWN_COVARIANCE if block.any() else UNKNOWN_COVARIANCE,
        )
        yield _logged(topic, FIX, float(arrival_s[i]), message)


def quality_messages(
    topic: str,
    time_s: Array,
    arrival_s: Array,
    satellites: NDArray[np.int64],
    hdop: Array,
    name: str = 'gnss',
) -> Iterator[Message]:
    """
    Yield DiagnosticArray, one status each, stamped as its fix.

    ``satellites`` (K,) is negative, ``hdop`` (K,) NaN where it is not told; where neither is,
    there is no message.
    """
    for i in np.argsort(arrival_s, kind='stable').tolist():
        values = {}
        if satellites[i] >= 0:
            values[SATELLITES_KEY] = str(int(satellites[i]))
        if np.isfinite(hdop[i]):
            values[HDOP_KEY] = f'{hdop[i]:.2f}'
        if not values:
            continue
        message = codec.make(
            DIAGNOSTICS,
            header=codec.header(codec.stamp_ns(float(time_s[i])), name),
            status=[_status(name, int(satellites[i]), values)],
        )
        yield _logged(topic, DIAGNOSTICS, float(arrival_s[i]), message)


def _status(name: str, satellites: int, values: dict[str, str]) -> object:
    level = OK if satellites >= ENOUGH or satellites < 0 else WARN if satellites else ERROR
    return codec.make(
        'diagnostic_msgs/msg/DiagnosticStatus',
        level=level,
        name=name,
        message={OK: '', WARN: 'few satellites', ERROR: 'no satellites'}[level],
        hardware_id='',
        values=[
            codec.make('diagnostic_msgs/msg/KeyValue', key=key, value=value)
            for key, value in values.items()
        ],
    )


def _logged(topic: str, msgtype: str, arrival_s: float, message: object) -> Message:
    cdr = codec.TYPESTORE.serialize_cdr(message, msgtype)
    return Message(topic, msgtype, codec.stamp_ns(arrival_s), bytes(cdr))

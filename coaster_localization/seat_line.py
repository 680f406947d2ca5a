"""The line that a seat draws on a track of which no design ride was exported."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from track_localization.track.centreline import Centreline

Array = NDArray[np.float64]

STEP = 0.25


def seat_line(
    track: Centreline, wheelbase_m: float, seat_m: Array, line_height_m: float = 0.0
) -> Centreline:
    """
    Return the path and attitude of a seat whose car stands on the rails by two bogies.

    Args:
        track: the line of the track file.
        wheelbase_m: between the bogies [m].
        seat_m: (3,) of the seat from the middle between the bogies, in the car's axes [m].
        line_height_m: of ``track`` above the rail centre (heart line), along its up axis [m].

    Chainage is that of the seat's nearest point on ``track``, as in a design ride.
    """
    reach = 0.0 if track.closed else 0.5 * wheelbase_m
    count = int(np.ceil((track.length - 2.0 * reach) / STEP)) + 1
    s = np.linspace(reach, track.length - reach, count)
    if track.closed:
        s = s[:-1]
    bogies, ups = [], []
    for offset in (0.5 * wheelbase_m, -0.5 * wheelbase_m):
        up = track.attitude(s + offset)[:, :, 2]
        bogies.append(track.position(s + offset) - line_height_m * up)
        ups.append(up)
    front, rear = bogies
    forward = _unit(front - rear)
    mean_up = ups[0] + ups[1]
    up = _unit(mean_up - np.sum(mean_up * forward, axis=1, keepdims=True) * forward)
    R = np.stack([forward, np.cross(up, forward), up], axis=-1)
    position = 0.5 * (front + rear) + R @ seat_m
    there = track.nearest(position, near=s, window=4.0)
    if not track.closed:
        return _open(there, position, R)
    order = np.argsort(there)
    there, position, R = there[order], position[order], R[order]
    keep = np.concatenate([[True], np.diff(there) > 0.2 * STEP])
    start = there[0]
    # Centreline counts from its first point: put one at chainage zero.
    line = Centreline(there[keep] - start, position[keep], R[keep], True, track.length)
    even = np.arange(0.0, track.length - 0.5 * STEP, STEP)
    at = even - start
    return Centreline(even, line.position(at), line.attitude(at), True, track.length)


def _open(there: Array, position: Array, R: Array) -> Centreline:
    """Return an open line, carried on straight to chainage zero."""
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(there)) > 0.2 * STEP])
    there, position, R = there[keep], position[keep], R[keep]
    if there[0] > 1e-6:
        lead = position[0] - there[0] * R[0, :, 0]
        there = np.concatenate([[0.0], there])
        position, R = np.concatenate([lead[None], position]), np.concatenate([R[:1], R])
    return Centreline(there, position, R, False, float(there[-1]))


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=1, keepdims=True)

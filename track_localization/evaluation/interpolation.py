"""Trajectories read between their stamps, and what can be derived where a field is missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory

Array = NDArray[np.float64]

MAX_GAP_S = 1.0
"""Two epochs further apart than this have nothing between them that could be read [s]."""


def at_times(trajectory: Trajectory, time_s: Array, max_gap_s: float = MAX_GAP_S) -> Trajectory:
    """
    Return ``trajectory`` at the times (M,), interpolated linearly between neighbouring epochs.

    Rows outside the recorded span, or inside a gap longer than ``max_gap_s``, are NaN. The speed
    is derived where the trajectory has none. Chainage that wraps between two epochs is taken from
    the nearer one. The quaternion is left out.
    """
    time_s = np.asarray(time_s, dtype=np.float64)
    stamps = trajectory.time_s
    if len(stamps) < 2:
        return Trajectory(time_s, np.full((len(time_s), 3), np.nan))
    i = np.clip(np.searchsorted(stamps, time_s, side='right') - 1, 0, len(stamps) - 2)
    span = stamps[i + 1] - stamps[i]
    u = (time_s - stamps[i]) / span
    usable = (u >= 0.0) & (u <= 1.0) & ((span <= max_gap_s) | (u == 0.0) | (u == 1.0))
    u = np.where(usable, u, np.nan)

    def mix(values: Array | None) -> Array | None:
        if values is None:
            return None
        share = u.reshape((-1,) + (1,) * (values.ndim - 1))
        mixed: Array = (1.0 - share) * values[i] + share * values[i + 1]
        return mixed

    position = mix(trajectory.position)
    assert position is not None
    return Trajectory(
        time_s,
        position,
        velocity=mix(trajectory.velocity),
        chainage=_chainage(trajectory, i, u),
        speed=mix(speed_of(trajectory)),
        covariance=mix(trajectory.covariance),
        sigma_along=mix(trajectory.sigma_along),
        sigma_speed=mix(trajectory.sigma_speed),
    )


def speed_of(trajectory: Trajectory) -> Array:
    """Return the speed (N,) [m/s]: its own, else of the velocity, else of the positions."""
    if trajectory.speed is not None:
        return trajectory.speed
    if trajectory.velocity is not None:
        speed: Array = np.linalg.norm(trajectory.velocity, axis=1)
        return speed
    if len(trajectory) < 2:
        return np.full(len(trajectory), np.nan)
    steps = np.linalg.norm(np.diff(trajectory.position, axis=0), axis=1)
    speed = steps / np.diff(trajectory.time_s)
    return np.append(speed, speed[-1])


def tangent_of(trajectory: Trajectory) -> Array:
    """
    Return unit directions of travel (N, 3); NaN where it stands still.

    The direction comes from the velocity, or from central differences of the positions.
    """
    if trajectory.velocity is not None:
        direction = trajectory.velocity
    elif len(trajectory) < 2:
        return np.full((len(trajectory), 3), np.nan)
    else:
        direction = np.gradient(trajectory.position, trajectory.time_s, axis=0)
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    unit: Array = np.divide(
        direction, length, out=np.full_like(direction, np.nan), where=length > 1e-9
    )
    return unit


def _chainage(trajectory: Trajectory, i: NDArray[np.int64], u: Array) -> Array | None:
    """Interpolate the chainage, but not across a wrap from the end to the start of a circuit."""
    if trajectory.chainage is None:
        return None
    before, after = trajectory.chainage[i], trajectory.chainage[i + 1]
    step = np.linalg.norm(trajectory.position[i + 1] - trajectory.position[i], axis=1)
    wraps = np.abs(after - before) > 10.0 * step + 10.0
    nearer = np.where(u < 0.5, before, after)
    chainage: Array = np.where(wraps, nearer, before + u * (after - before))
    return np.where(np.isnan(u), np.nan, chainage)

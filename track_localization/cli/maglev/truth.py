"""Between chainage and ``map``: the truth gets its chainage, estimates their place."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from maglev_localization.placing import LEVEL, PlacingConfig
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.centreline import Centreline

Array = NDArray[np.float64]

OFF_LINE_M = 5.0
"""A truth further from the line than this is told: another track, or another origin [m]."""


def on_x(truth: Trajectory) -> tuple[Trajectory, list[str]]:
    """
    Return a truth whose x is the chainage, and what to say about it.

    Without a track that is all that is known: y and z are set to zero.
    """
    x = truth.position[:, 0]
    away = float(np.abs(truth.position[:, 1:]).max())
    found = Trajectory(
        truth.time_s, _along_x(x), velocity=_along_x(_slope(truth.time_s, x)), chainage=x,
        speed=truth.speed,
    )  # fmt: skip
    if away <= OFF_LINE_M:
        return found, []
    return found, [
        f'The ground truth leaves the x axis by {away:.0f} m and there is no track.csv: its x is '
        'taken for the chainage; name the track with --track.'
    ]


def on_line(truth: Trajectory, line: Centreline) -> tuple[Trajectory, list[str]]:
    """Return the truth with the chainage of its projection on the line, and what to say of it."""
    s = line.nearest(truth.position)
    away = float(np.linalg.norm(line.position(s) - truth.position, axis=1).max())
    if line.closed:
        s = np.unwrap(s, period=line.length)
    velocity = truth.velocity
    if velocity is None:
        velocity = np.stack([_slope(truth.time_s, p) for p in truth.position.T], axis=1)
    found = dataclasses.replace(truth, chainage=s, velocity=velocity)
    if away <= OFF_LINE_M:
        return found, []
    return found, [
        f'The ground truth is up to {away:.0f} m off the track.csv: is it that of another line?'
    ]


def placed(estimate: Trajectory, line: Centreline | None) -> Trajectory:
    """
    Return an estimate by chainage as poses in ``map``, as the node places them.

    Its covariance is long along the line and thin across; without a line x is the chainage.
    """
    s, speed, sigma = estimate.chainage, estimate.speed, estimate.sigma_along
    if s is None or speed is None or sigma is None:
        raise ValueError('an estimate without chainage, speed or sigma cannot be placed')
    if line is None:
        position, tangent = _along_x(s), _along_x(np.ones(len(s)))
        quaternion = np.tile(LEVEL, (len(s), 1))
    else:
        position, tangent = line.position(s), line.tangent(s)
        quaternion = line.quaternion(s if line.closed else np.clip(s, 0.0, line.length))
    way = tangent[:, :, None] * tangent[:, None, :]
    across = PlacingConfig().across_sigma_m ** 2 * (np.eye(3) - way)
    return dataclasses.replace(
        estimate,
        position=position,
        quaternion=quaternion,
        velocity=speed[:, None] * tangent,
        covariance=(sigma**2)[:, None, None] * way + across,
    )


def _along_x(values: Array) -> Array:
    out = np.zeros((len(values), 3))
    out[:, 0] = values
    return out


def _slope(time_s: Array, values: Array) -> Array:
    return np.gradient(values, time_s) if len(values) > 1 else np.zeros_like(values)

"""
From a distance along the line to a pose in ``map``: on the line, with its attitude there.

Where no track file is given the line is taken as straight: ``map`` x is the chainage.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from maglev_localization.estimate import Estimate
from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.settings import setting
from track_localization.track.balise_table import BaliseTable
from track_localization.track.centreline import Centreline
from track_localization.track.track_file import read_track

Array = NDArray[np.float64]

OFF_TRACK_M = 5.0
"""A place further off the line than this and five of its own sigmas is not on this line."""
BEYOND_M, BEYOND_SHARE = 10.0, 0.005
"""How far a balise may lie beyond the ends of its own line, which was measured otherwise."""
STRAIGHT = np.array([1.0, 0.0, 0.0])
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


@dataclasses.dataclass(frozen=True)
class PlacingConfig:
    """How far a train may be from the pose that its line gives, 1 sigma."""

    across_sigma_m: float = setting(0.05, 'm', 'off the line, each way across it', 1e-6, 100.0)
    attitude_sigma_rad: float = setting(0.01, 'rad', 'of its attitude, each axis', 1e-6, 3.0)
    sway_sigma_mps: float = setting(0.05, 'm/s', 'of its speed across the line', 1e-6, 100.0)
    turn_sigma_radps: float = setting(0.02, 'rad/s', 'of its angular rate', 1e-6, 100.0)


@dataclasses.dataclass(frozen=True)
class PlacedEstimate:
    """
    An estimate with its pose in ``map``.

    Attributes:
        time_s: stamp [s].
        chainage: along the line, of one lap where it is a circuit [m].
        sigma_along: its standard deviation [m].
        position: (3,) in ``map`` [m].
        quaternion: (4,) x, y, z, w, body to ``map``.
        velocity_body: (3,) [m/s].
        angular_rate: (3,) in the body [rad/s].
        pose_covariance: (6, 6) of x, y, z [m] and of rotation about the axes of ``map`` [rad].
        twist_covariance: (6, 6) of the body-frame velocity [m/s] and angular rate [rad/s].
    """

    time_s: float
    chainage: float
    sigma_along: float
    position: Array
    quaternion: Array
    velocity_body: Array
    angular_rate: Array
    pose_covariance: Array
    twist_covariance: Array


class Placing:
    """Places estimates on a line, and finds the chainage of a place."""

    def __init__(self, line: Centreline | None, config: PlacingConfig) -> None:
        """Place on ``line``; None: ``map`` x is the chainage."""
        self.line, self._config = line, config

    def place(self, estimate: Estimate) -> PlacedEstimate:
        """Return the pose of an estimate; its doubt is long along the line and thin across."""
        c, s, speed = self._config, estimate.chainage, estimate.speed
        position, quaternion, tangent, turning = self._pose(s)
        R_nb = so3.matrix_from_quat(quaternion)
        forward = R_nb.T @ tangent
        return PlacedEstimate(
            time_s=estimate.time_s,
            chainage=self._of_one_lap(s),
            sigma_along=estimate.sigma_along,
            position=position,
            quaternion=quaternion,
            velocity_body=speed * forward,
            angular_rate=speed * turning,
            pose_covariance=_spread(
                *(float(estimate.covariance[0, 0]), tangent, R_nb @ turning),
                *(c.across_sigma_m, c.attitude_sigma_rad),
            ),
            twist_covariance=_spread(
                *(float(estimate.covariance[1, 1]), forward, turning),
                *(c.sway_sigma_mps, c.turn_sigma_radps),
            ),
        )

    def chainage(self, position: Array, covariance: Array) -> tuple[float, float] | str:
        """
        Return the chainage [m] of a place in ``map``, and its variance [m^2]; or why there is none.

        ``position`` (3,) [m], ``covariance`` (3, 3) [m^2]. The place is the nearest of the line.
        """
        if self.line is None:
            return float(position[0]), float(covariance[0, 0])
        s = float(self.line.nearest(position))
        off = float(np.linalg.norm(self.line.position(s) - position))
        if off > OFF_TRACK_M + 5.0 * math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])):
            return 'off_track'
        tangent = self.line.tangent(s)
        return s, float(tangent @ covariance @ tangent)

    def _of_one_lap(self, s: float) -> float:
        return s % self.line.length if self.line is not None and self.line.closed else s

    def _pose(self, s: float) -> tuple[Array, Array, Array, Array]:
        """
        Return position (3,), quaternion (4,), tangent (3,) in ``map`` and turning (3,) in the body.

        Beyond the ends of an open line the train keeps the attitude of the end.
        """
        if self.line is None:
            return s * STRAIGHT, LEVEL, STRAIGHT, np.zeros(3)
        inside = s if self.line.closed else min(max(s, 0.0), self.line.length)
        turning = self.line.curvature(inside) if inside == s else np.zeros(3)
        quaternion = self.line.quaternion(inside)
        return self.line.position(s), quaternion, self.line.tangent(s), turning


def _spread(along: float, forward: Array, turning: Array, across: float, about: float) -> Array:
    """
    Return a covariance (6, 6) of translation and rotation, of an error along the line and others.

    Args:
        along: variance along the line.
        forward: (3,) unit vector along it.
        turning: (3,) rotation for each unit along it.
        across: standard deviation across the line, of the translation.
        about: of the rotation, each axis.
    """
    way = np.concatenate([forward, turning])
    P: Array = along * np.outer(way, way)
    P[:3, :3] += across**2 * (np.eye(3) - np.outer(forward, forward))
    P[3:, 3:] += about**2 * np.eye(3)
    return P


def read_line(path: str, balises: BaliseTable) -> Centreline:
    """
    Read the line of a track file that has these balises on it.

    Raise DataError when it cannot be read, or a balise lies beyond its ends.
    """
    line = Centreline.from_track(read_track(path))
    slack = BEYOND_M + BEYOND_SHARE * line.length
    beyond = (balises.chainage < -slack) | (balises.chainage > line.length + slack)
    if beyond.any():
        i = int(np.argmax(beyond))
        raise DataError(
            f'{path}: this line is {line.length:.0f} m long, but balise {balises.id[i]} lies at '
            f'{balises.chainage[i]:.0f} m; name the track and the balises of one line'
        )
    return line

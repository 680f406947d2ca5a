"""What the track filter gives out: poses in ``map`` with their uncertainty, one or many."""

from __future__ import annotations

import dataclasses
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import line_rows, line_state, so3
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.line_map import STRETCH, TANGENT, LineMap

Array = NDArray[np.float64]

BENT_M = 1.0
"""Sigma of the chainage above which the line's bends make the position's covariance."""
_MIDDLES = np.array([NormalDist().inv_cdf((k + 0.5) / 6.0) for k in range(6)])
QUANTILES = _MIDDLES / _MIDDLES.std()
"""The middles of equal shares of a normal distribution, of unit variance together."""


@dataclasses.dataclass(frozen=True)
class TrackEstimate:
    """
    Where the vehicle is at ``time_s``; everything else is computed when asked for.

    Attributes:
        time_s: stamp [s].
        x: (30,) nominal state of the line filter.
        P: (18, 18) its error covariance.
        line: the line.
        angular_rate: (3,) in the body [rad/s].
        line_sigma: how far the vehicle may be off the line, each axis [m].
        lost: probability that the vehicle is somewhere else altogether.
    """

    time_s: float
    x: Array
    P: Array
    line: LineMap
    angular_rate: Array
    line_sigma: float
    lost: float = 0.0

    @property
    def chainage(self) -> float:
        """Distance along the line [m], of one lap."""
        s = float(self.x[0])
        return s % self.line.length if self.line.closed else s

    @property
    def lap(self) -> int:
        """Laps completed since chainage zero; 0 on an open line."""
        return max(int(self.x[0] // self.line.length), 0) if self.line.closed else 0

    @property
    def speed(self) -> float:
        """Speed along the path, negative backward [m/s]."""
        return float(self.x[1]) * self._stretch

    @property
    def sigma_along(self) -> float:
        """Standard deviation along the line [m]."""
        return float(np.hypot(np.sqrt(self.P[0, 0]) * self._stretch, self.line_sigma))

    @property
    def position(self) -> Array:
        """Position (3,) in ``map`` [m]."""
        i, share = self._row
        p = self.line.position
        if not (self.line.closed or 0.0 <= self.x[0] <= self.line.length):
            # Beyond an open line's ends it goes on straight.
            return np.asarray(self.line.line.position(float(self.x[0])))
        return np.asarray(p[i] + share * (p[i + 1] - p[i]))

    @property
    def R_nb(self) -> Array:
        """Attitude of the body (3, 3)."""
        R: Array = self.x[2:11].reshape(3, 3) @ self.x[11:20].reshape(3, 3).T
        return R

    @property
    def quaternion(self) -> Array:
        """Attitude (4,), x y z w, body to map."""
        return so3.quat_one(self.R_nb)

    @property
    def velocity_body(self) -> Array:
        """Velocity (3,) in the body [m/s]."""
        return np.asarray(self._tangent * self.speed)

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of x, y, z [m] and of rotation about the axes of ``map`` [rad]."""
        i, _ = self._row
        tangent = self.line.rows[i, 0:9].reshape(3, 3) @ self._tangent
        out = np.zeros((6, 6))
        if self.P[0, 0] > BENT_M**2:
            s, sigma = np.array([self.x[0]]), np.sqrt(self.P[0:1, 0])
            out[0:3, 0:3] = bent_covariance(self.line, s, sigma)[0]
        else:
            out[0:3, 0:3] = self.P[0, 0] * self._stretch**2 * np.outer(tangent, tangent)
        out[0:3, 0:3] += self.line_sigma**2 * np.eye(3)
        tilt = slice(line_state.TILT, line_state.TILT + 3)
        mount = slice(line_state.MOUNT, line_state.MOUNT + 3)
        R = self.R_nb
        cross = self.P[tilt, mount] @ R.T
        out[3:6, 3:6] = self.P[tilt, tilt] + R @ self.P[mount, mount] @ R.T - cross - cross.T
        return out

    @property
    def twist_covariance(self) -> Array:
        """Covariance (6, 6) of the body-frame velocity [m/s] and angular rate [rad/s]."""
        out = np.zeros((6, 6))
        t = self._tangent
        out[0:3, 0:3] = self.P[1, 1] * self._stretch**2 * np.outer(t, t) + 1e-4 * np.eye(3)
        bias = slice(line_state.GYRO_BIAS, line_state.GYRO_BIAS + 3)
        M = self.x[11:20].reshape(3, 3)
        out[3:6, 3:6] = M @ self.P[bias, bias] @ M.T + 1e-4 * np.eye(3)
        return out

    @property
    def _row(self) -> tuple[int, float]:
        return line_rows.row_of(
            self.line.rows, self.line.step_m, self.line.closed, float(self.x[0])
        )

    @property
    def _tangent(self) -> Array:
        return np.asarray(self.line.rows[self._row[0], TANGENT])

    @property
    def _stretch(self) -> float:
        return float(self.line.rows[self._row[0], STRETCH])


def bent_covariance(line: LineMap, s: Array, sigma: Array) -> Array:
    """
    Return the covariance (N, 3, 3) of positions whose chainages (N,) are known to ``sigma`` (N,).

    About the position at ``s`` itself, which is what is given out.
    """
    at = s[:, None] + sigma[:, None] * QUANTILES
    at = at % line.length if line.closed else np.clip(at, 0.0, line.length)
    centre = s % line.length if line.closed else s
    apart = line.line.position(at.ravel()).reshape(*at.shape, 3)
    apart -= line.line.position(centre)[:, None, :]
    out: Array = np.einsum('nki,nkj->nij', apart, apart) / len(QUANTILES)
    return out


def to_trajectory(
    time_s: Array, x: Array, P: Array, line: LineMap, sigma: float | Array
) -> Trajectory:
    """
    Return states (N, 30) of the line filter as a trajectory.

    ``P`` (N, 2, 2) is the covariance of chainage and its rate, ``sigma`` how far the vehicle may
    be off the line, each axis, one for all or (N,) [m].
    """
    s = x[:, 0] % line.length if line.closed else x[:, 0]
    rows = np.clip(np.round(s / line.step_m).astype(int), 0, len(line.rows) - 1)
    stretch = line.rows[rows, STRETCH]
    R_line = line.rows[rows, 0:9].reshape(-1, 3, 3)
    tangent = np.einsum('nij,nj->ni', R_line, line.rows[rows, TANGENT])
    C, M = x[:, 2:11].reshape(-1, 3, 3), x[:, 11:20].reshape(-1, 3, 3)
    along = P[:, 0, 0] * stretch**2
    covariance = along[:, None, None] * np.einsum('ni,nj->nij', tangent, tangent)
    vague = P[:, 0, 0] > BENT_M**2
    covariance[vague] = bent_covariance(line, x[vague, 0], np.sqrt(P[vague, 0, 0]))
    covariance += np.multiply.outer(np.broadcast_to(sigma, len(s)) ** 2, np.eye(3))
    speed = x[:, 1] * stretch
    return Trajectory(
        time_s=time_s,
        position=line.line.position(s),
        quaternion=so3.quat_from_matrix(C @ np.swapaxes(M, 1, 2)),
        velocity=tangent * speed[:, None],
        chainage=s,
        speed=np.abs(speed),
        covariance=covariance,
        sigma_along=np.sqrt(along + sigma**2),
        sigma_speed=np.sqrt(P[:, 1, 1]) * stretch,
    )

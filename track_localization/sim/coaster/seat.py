"""The seat: carried by two bogies on the rails, its pose a smooth function of row 1's chainage."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from track_localization import GRAVITY
from track_localization.estimation import so3
from track_localization.sim.coaster.ride_plan import Train
from track_localization.track.centreline import Centreline, turning
from track_localization.track.uniform_spline import UniformSpline

Array = NDArray[np.float64]

STEP = 0.25


@dataclasses.dataclass(frozen=True)
class Motion:
    """Pose and motion of the seat (N rows): ``map`` position, velocity; body force and rate."""

    position: Array
    quaternion: Array
    velocity: Array
    specific_force: Array
    angular_rate: Array


@dataclasses.dataclass(frozen=True)
class Deviations:
    """
    How the built track differs from the design, by design chainage.

    ``along`` (1 column) [m], ``cross`` (2 columns: left, up) [m] and ``roll`` (1 column) [rad].
    """

    along: UniformSpline
    cross: UniformSpline
    roll: UniformSpline


class SeatPath:
    """
    The path of the row-1 seat over row 1's own chainage on the (built) track.

    Velocity, specific force and angular rate are the exact derivatives of this path.
    """

    def __init__(
        self,
        line: Centreline,
        train: Train,
        line_height: float,
        seat_offset: Array,
        deviations: Deviations | None = None,
    ) -> None:
        """
        Place the seat.

        Args:
            line: the design line.
            train: its wheelbase and seat height are used.
            line_height: of ``line`` above the rail centre [m].
            seat_offset: (3,) of the sensor from the seat's nominal place, in body axes [m].
            deviations: of the built track; None for the design itself.
        """
        self.length, self.closed = line.length, line.closed
        over = 0.0 if line.closed else 40.0
        self._start = -over
        count = int(np.ceil((line.length + 2.0 * over) / STEP)) + 1
        s = np.linspace(-over, line.length + over, count)
        front, up_front = _rail(line, s + 0.5 * train.wheelbase_m, line_height, deviations)
        rear, up_rear = _rail(line, s - 0.5 * train.wheelbase_m, line_height, deviations)
        forward = (front - rear) / np.linalg.norm(front - rear, axis=1, keepdims=True)
        up = up_front + up_rear
        up -= np.sum(up * forward, axis=1, keepdims=True) * forward
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        R = np.stack([forward, np.cross(up, forward), up], axis=-1)
        arm = seat_offset + np.array([0.0, 0.0, train.seat_height_m])
        position = 0.5 * (front + rear) + R @ arm
        quaternion = so3.quat_from_matrix(R)
        flips = np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0.0, -1.0, 1.0)
        quaternion *= np.concatenate([[1.0], np.cumprod(flips)])[:, None]
        self._position = self._table(s, position)
        self._quaternion = self._table(s, quaternion)
        offset = line.nearest(position, near=s, window=4.0) - s
        if line.closed:
            offset -= np.round(offset / line.length) * line.length
        self._offset = self._table(s, offset[:, None])

    def _table(self, s: Array, values: Array) -> UniformSpline:
        span = float(s[-1] - s[0])
        if not self.closed:
            return UniformSpline(values, span)
        turned = values.shape[1] == 4 and float(values[0] @ values[-1]) < 0.0
        sign, before, after = -1.0 if turned else 1.0, slice(-13, -1), slice(1, 13)
        knots = np.concatenate([s[before] - span, s, s[after] + span])
        wrapped = np.concatenate([sign * values[before], values, sign * values[after]])
        slopes = CubicSpline(knots, wrapped)(np.array([s[0], s[-1]]), 1)
        return UniformSpline(values, span, True, slopes)

    def motion(self, s: Array, v: Array, a: Array) -> Motion:
        """Return the seat's motion (N rows) for row 1's chainage, speed and acceleration (N,)."""
        x = s - self._start
        q, dq = self._quaternion(x), self._quaternion(x, 1)
        q_unit = q / np.linalg.norm(q, axis=1, keepdims=True)
        slope, bend = self._position(x, 1), self._position(x, 2)
        acceleration = bend * (v**2)[:, None] + slope * a[:, None]
        acceleration[:, 2] += GRAVITY
        R = so3.matrix_from_quat(q_unit)
        return Motion(
            position=self._position(x),
            quaternion=q_unit,
            velocity=slope * v[:, None],
            specific_force=np.einsum('nji,nj->ni', R, acceleration),
            angular_rate=turning(q, dq) * v[:, None],
        )

    def position(self, s: Array) -> Array:
        """Return seat positions (N, 3) in ``map`` [m]."""
        return self._position(np.asarray(s) - self._start)

    def chainage(self, s: Array) -> Array:
        """Return the seat's chainage (N,), projected on the design line; laps go on counting."""
        return s + self._offset(np.asarray(s) - self._start)[..., 0]


def _rail(
    line: Centreline, s: Array, line_height: float, deviations: Deviations | None
) -> tuple[Array, Array]:
    """Return the rail centre (N, 3) and the up vector (N, 3) of the built track."""
    if deviations is None:
        R = line.attitude(s)
        return line.position(s) - line_height * R[:, :, 2], R[:, :, 2]
    at = s + deviations.along(s)[:, 0]
    R, cross, roll = line.attitude(at), deviations.cross(s), deviations.roll(s)
    left, up = R[:, :, 1], R[:, :, 2]
    built = line.position(at) + cross[:, :1] * left + cross[:, 1:] * up
    tilted = np.cos(roll) * up - np.sin(roll) * left
    return built - line_height * tilted, tilted

"""What the coaster's filter holds inside and what it gives out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import eskf, so3
from track_localization.estimation.imu_monitor import ImuStep
from track_localization.track.line_table import LineTable

Array = NDArray[np.float64]


class FusedState(NamedTuple):
    """
    Filter state with what its updates must remember, so that a replay repeats their decisions.

    Attributes:
        nav: the error-state filter's state.
        chainage: of the estimate, along the line [m].
        last_match_s: stamp of the last fused match [s]; NaN before the first.
        doubted_since_s: since when every match was beyond the gate [s]; NaN after one within it.
        last_zupt_s: when the train last felt at rest, used or not [s].
        rolled_s: how long it felt so while it surely moved [s].
    """

    nav: eskf.State
    chainage: float
    last_match_s: float
    doubted_since_s: float
    last_zupt_s: float
    rolled_s: float = 0.0


class Prediction(NamedTuple):
    """
    One IMU step, made ready for the filter once, however often it is replayed.

    Attributes:
        step: what the IMU showed.
        q: (4,) the step's process noise, see ``eskf.process_noise``.
        quiet: whether the sensor shook no more than at rest.
    """

    step: ImuStep
    q: Array
    quiet: bool


class Estimate(NamedTuple):
    """
    Where the vehicle is after an IMU step; what follows from the state is computed when asked for.

    Attributes:
        step: what the IMU showed.
        nav: the filter's state.
        chainage: along the line [m].
        line: the line.
        gyro_noise: angle random walk [rad/s/sqrt(Hz)].
    """

    step: ImuStep
    nav: eskf.State
    chainage: float
    line: LineTable
    gyro_noise: float

    @property
    def time_s(self) -> float:
        """Stamp of the IMU sample [s]."""
        return self.step.time_s

    @property
    def angular_rate(self) -> Array:
        """Angular rate (3,) in the body [rad/s]."""
        rate: Array = self.step.w - self.nav.gyro_bias
        return rate

    @property
    def sigma_along(self) -> float:
        """Standard deviation of the position along the line [m]."""
        tangent = self.line.axes[self.line.index(self.chainage), :, 0]
        return float(np.sqrt(tangent @ self.nav.P[0:3, 0:3] @ tangent))

    @property
    def position(self) -> Array:
        """Position (3,) in ``map`` [m]."""
        return self.nav.position

    @property
    def velocity(self) -> Array:
        """Velocity (3,) in ``map`` [m/s]."""
        return self.nav.velocity

    @property
    def quaternion(self) -> Array:
        """Attitude (4,), x y z w, body to map."""
        return so3.quat_one(self.nav.R_nb)

    @property
    def velocity_body(self) -> Array:
        """Velocity (3,) in the body [m/s]."""
        v: Array = self.nav.R_nb.T @ self.nav.velocity
        return v

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of x, y, z [m] and of rotation about the axes of ``map`` [rad]."""
        return eskf.pose_covariance(self.nav)

    @property
    def twist_covariance(self) -> Array:
        """Covariance (6, 6) of the body-frame velocity [m/s] and angular rate [rad/s]."""
        rate_sigma = self.gyro_noise / math.sqrt(max(self.step.dt, 1e-4))
        return eskf.twist_covariance(self.nav, rate_sigma)

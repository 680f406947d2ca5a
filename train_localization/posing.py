"""From an estimate to what a pose, a twist and a fix tell of it, each with its own covariance."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import so3
from track_localization.geodesy import Datum
from train_localization.estimate import Estimate
from train_localization.placing import Placing

Array = NDArray[np.float64]

MAX_VARIANCE = 1e14
"""An estimate that unsure is none [m^2], [m^2/s^2], [rad^2]."""


@dataclasses.dataclass(frozen=True)
class PosedEstimate:
    """
    An estimate as a pose in ``map`` and a twist in the body.

    Attributes:
        time_s: stamp [s].
        position: (3,) in ``map`` [m].
        quaternion: (4,) x, y, z, w, body to ``map``.
        velocity_body: (3,) [m/s].
        angular_rate: (3,) in the body [rad/s].
        pose_covariance: (6, 6) of x, y, z [m] and of rotation about the axes of ``map`` [rad].
        twist_covariance: (6, 6) of the body-frame velocity [m/s] and angular rate [rad/s].
        chainage: along the track [m]; None without a map.
        sigma_along: of it [m].
    """

    time_s: float
    position: Array
    quaternion: Array
    velocity_body: Array
    angular_rate: Array
    pose_covariance: Array
    twist_covariance: Array
    chainage: float | None
    sigma_along: float | None

    @property
    def sane(self) -> bool:
        """Whether these are numbers, and the covariances can be some."""
        values = (self.position, self.quaternion, self.velocity_body, self.angular_rate)
        if not all(np.isfinite(x).all() for x in values):
            return False
        spreads = np.concatenate([np.diag(self.pose_covariance), np.diag(self.twist_covariance)])
        return bool(spreads.min() > 0.0 and spreads.max() < MAX_VARIANCE)


def posed(estimate: Estimate, turn_sigma: float) -> PosedEstimate:
    """Return an estimate as pose and twist; ``turn_sigma`` is that of the angular rate [rad/s]."""
    R_nb = so3.matrix_from_quat(estimate.quaternion)
    velocity = R_nb.T @ estimate.velocity
    to_pose, to_velocity = np.zeros((6, 9)), np.zeros((3, 9))
    to_pose[:3, :3], to_pose[3:, 6:] = np.eye(3), R_nb
    # R exp(theta) turns a velocity v of map into v_body - theta x v_body.
    to_velocity[:, 3:6], to_velocity[:, 6:] = R_nb.T, so3.hat(velocity)
    twist = turn_sigma**2 * np.eye(6)
    twist[:3, :3] = to_velocity @ estimate.covariance @ to_velocity.T
    return PosedEstimate(
        time_s=estimate.time_s,
        position=estimate.position,
        quaternion=estimate.quaternion,
        velocity_body=velocity,
        angular_rate=estimate.angular_rate,
        pose_covariance=to_pose @ estimate.covariance @ to_pose.T,
        twist_covariance=twist,
        chainage=estimate.chainage,
        sigma_along=estimate.sigma_along,
    )


def level_covariance(estimate: Estimate, datum: Datum) -> Array:
    """Return the covariance (3, 3) [m^2] of the place along east, north, up of that place."""
    turn = Placing(datum).rotation(estimate.geodetic)
    P: Array = turn.T @ estimate.covariance[:3, :3] @ turn
    return P

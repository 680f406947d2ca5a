"""What every train method gives out."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Estimate:
    """
    Where the train is at ``time_s``.

    Attributes:
        time_s: end of the filter's step [s].
        geodetic: (3,) latitude, longitude [rad], height [m].
        position: (3,) in ``map``: east, north, up of the datum [m].
        quaternion: (4,) body to ``map``.
        velocity: (3,) in ``map`` [m/s].
        angular_rate: (3,) of the body [rad/s].
        covariance: (9, 9) of position, velocity and the attitude error in the body.
        mode: what the position rests on.
        chainage: along the track [m]; None without a map.
        sigma_along: of it [m].
    """

    time_s: float
    geodetic: Array
    position: Array
    quaternion: Array
    velocity: Array
    angular_rate: Array
    covariance: Array
    mode: str
    chainage: float | None = None
    sigma_along: float | None = None

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return float(np.linalg.norm(self.velocity))

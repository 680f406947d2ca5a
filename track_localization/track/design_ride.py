"""The design ride: the simulated motion of the seat along the design track, by time."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class DesignRide:
    """
    Motion of the row-1 seat in the design simulation.

    Attributes:
        time_s: (N,) strictly increasing [s].
        chainage: (N,) along the track [m]; laps go on counting.
        position: (N, 3) in ``map`` [m].
        quaternion: (N, 4) x, y, z, w, body to map.
        velocity: (N, 3) in ``map`` [m/s].
        specific_force: (N, 3) in body axes [m/s^2].
        angular_rate: (N, 3) in body axes [rad/s].
    """

    time_s: Array
    chainage: Array
    position: Array
    quaternion: Array
    velocity: Array
    specific_force: Array
    angular_rate: Array

    def __len__(self) -> int:
        return len(self.time_s)

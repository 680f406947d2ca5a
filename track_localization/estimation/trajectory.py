"""What every estimator gives and every truth is: poses with their uncertainty over time."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """
    A vehicle's motion in ``map``, one row per epoch; a quantity that a system lacks is None.

    Attributes:
        time_s: (N,) stamps in the recording's clock [s], strictly increasing.
        position: (N, 3) [m].
        quaternion: (N, 4) x, y, z, w, body to map.
        velocity: (N, 3) in ``map`` [m/s].
        chainage: (N,) along the track [m].
        speed: (N,) [m/s].
        covariance: (N, 3, 3) of the position, in ``map`` [m^2].
        sigma_along: (N,) standard deviation along the track [m].
        sigma_speed: (N,) [m/s].
    """

    time_s: Array
    position: Array
    quaternion: Array | None = None
    velocity: Array | None = None
    chainage: Array | None = None
    speed: Array | None = None
    covariance: Array | None = None
    sigma_along: Array | None = None
    sigma_speed: Array | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, index: slice | NDArray[np.bool_] | NDArray[np.int64]) -> Trajectory:
        parts = {
            f.name: getattr(self, f.name)[index]
            for f in dataclasses.fields(self)
            if getattr(self, f.name) is not None
        }
        return dataclasses.replace(self, **parts)

    def position_at(self, time_s: Array) -> Array:
        """Return positions (M, 3) interpolated linearly; NaN outside the recorded span."""
        columns = [
            np.interp(time_s, self.time_s, self.position[:, k], left=np.nan, right=np.nan)
            for k in range(3)
        ]
        return np.stack(columns, axis=-1)

"""What every maglev method gives out."""

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
        time_s: stamp of the measurement that made it [s].
        mean: (3,) chainage [m], speed [m/s], acceleration [m/s^2].
        covariance: (3, 3) of the mean; of the whole posterior, all its modes.
    """

    time_s: float
    mean: Array
    covariance: Array

    @property
    def chainage(self) -> float:
        """Distance along the track [m]."""
        return float(self.mean[0])

    @property
    def speed(self) -> float:
        """Speed along the track [m/s]."""
        return float(self.mean[1])

    @property
    def sigma_along(self) -> float:
        """Standard deviation of the chainage [m]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def sigma_speed(self) -> float:
        """Standard deviation of the speed [m/s]."""
        return float(np.sqrt(self.covariance[1, 1]))

"""How much more crooked than expected the built line seems, told by how well its attitude fits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

USUAL_NIS = 0.3
"""
Of an attitude comparison, mean over a ride: less than 1, as the tilt takes up what lasts.

Simulated rides have 0.1 to 0.4, with deviations three times as large 0.5 to 1.5.
"""
LARGEST_NIS = 9.0
"""A single comparison counts no more than this."""
PRIOR_COUNT = 100
"""Comparisons that the usual value counts as: 5 s of a ride at 20 a second."""
LEAST_SPEED_MPS, LARGEST_SIGMA_M = 3.0, 0.4
"""Slower than the first the same place is told again; beyond the second the place is in doubt."""


class Crookedness:
    """
    A running mean of the fit over the ride so far.

    The filter's own weights stay as they are; what it claims is widened by ``factor``.
    """

    def __init__(self) -> None:
        self._sum, self._count = USUAL_NIS * PRIOR_COUNT, PRIOR_COUNT

    def push(self, nis: Array, speed: float, sigma: float) -> None:
        """Take a comparison's NIS (3,), with speed [m/s] and sigma of the place [m] then."""
        if abs(speed) > LEAST_SPEED_MPS and sigma < LARGEST_SIGMA_M:
            self._sum += float(np.minimum(nis, LARGEST_NIS).mean())
            self._count += 1

    @property
    def factor(self) -> float:
        """By how much variances are too small, at least 1."""
        return max(1.0, self._sum / self._count / USUAL_NIS)

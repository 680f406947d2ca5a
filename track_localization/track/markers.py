"""Marked places on the track: when the row-1 seat passed them, and where they are by design."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Markers:
    """
    Points of the track whose passing was timed from the ground.

    Attributes:
        time_s: (K,) time of passing, in the recording's clock unless an offset is unknown [s].
        name: (K,) labels.
        position: (K, 3) design position of the row-1 seat there, in ``map`` [m].
    """

    time_s: Array
    name: tuple[str, ...]
    position: Array

    def __len__(self) -> int:
        return len(self.time_s)

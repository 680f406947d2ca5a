"""Whether a sensor that feels at rest is in the station, or on a chain lift that feels the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from track_localization import GRAVITY
from track_localization.estimation import so3
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

MOVING_MPS = 0.5
QUIET_MPS2, QUIET_RADPS = 0.3, 0.05
"""A ride that differs by no more from 1 g, and turns no faster, feels like standing."""
QUIET_S = 1.0
TILTED = np.deg2rad(15.0)
"""A sensor whose tilt is nearer to the station's than this is in the station [rad]."""


class Station:
    """The tilts that a sensor fixed in the train has in the station, and wherever else is quiet."""

    def __init__(self, design: DesignRide) -> None:
        """Find where on ``design`` the train moves and feels as if it did not."""
        force = np.linalg.norm(design.specific_force, axis=1)
        quiet = (
            (design.speed > MOVING_MPS)
            & (np.abs(force - GRAVITY) < QUIET_MPS2)
            & (np.linalg.norm(design.angular_rate, axis=1) < QUIET_RADPS)
        )
        rows = max(1, round(QUIET_S / float(np.median(np.diff(design.time_s)))))
        lasting = minimum_filter1d(quiet.astype(np.uint8), rows, mode='constant') > 0
        self._elsewhere = design.specific_force[lasting] / force[lasting, None]
        self._here = so3.matrix_from_quat(design.quaternion[0])[2]

    def is_elsewhere(self, force: Array) -> bool:
        """
        Return whether a rest's mean force (3,), in body axes, tells of another place.

        Only of a place where the ride is quiet, and tilted much more as there than as in the
        station: a sensor that lies in the train in a way of its own is taken to be in the station.
        """
        size = float(np.linalg.norm(force))
        if not len(self._elsewhere) or not size > 0.0:
            return False
        up = force / size
        here = np.arccos(np.clip(self._here @ up, -1.0, 1.0))
        there = np.arccos(np.clip((self._elsewhere @ up).max(), -1.0, 1.0))
        return bool(here > TILTED and there < 0.5 * here)

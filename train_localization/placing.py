"""From geodetic places and level axes to ``map``, the Cartesian frame of a datum, and back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from track_localization.geodesy import Datum, enu_from_geodetic, geodetic_from_enu

Array = NDArray[np.float64]


def level_axes(latitude: float, longitude: float) -> Array:
    """Return east, north, up of a place [rad] as rows (3, 3), Earth-centred."""
    sl, cl = math.sin(latitude), math.cos(latitude)
    so, co = math.sin(longitude), math.cos(longitude)
    return np.array([[-so, co, 0.0], [-sl * co, -sl * so, cl], [cl * co, cl * so, sl]])


class Placing:
    """Places and directions in the frame ``map`` of one datum."""

    def __init__(self, datum: Datum) -> None:
        self.datum = datum
        self._axes = level_axes(datum.latitude_rad, datum.longitude_rad)

    def position(self, nav: Array) -> Array:
        """Return the position (3,) of a navigation state [m]."""
        place: Array = enu_from_geodetic(nav[0], nav[1], nav[2], self.datum)[0]
        return place

    def geodetic(self, position: Array) -> Array:
        """Return latitude, longitude [rad], height [m] (3,) of a position (3,) in ``map``."""
        place: Array = geodetic_from_enu(position, self.datum)[0]
        return place

    def rotation(self, nav: Array) -> Array:
        """Return the rotation (3, 3) from the state's own east, north, up to ``map``."""
        out: Array = self._axes @ level_axes(nav[0], nav[1]).T
        return out

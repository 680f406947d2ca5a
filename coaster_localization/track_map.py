"""The coaster's line for the track filter: attitude from the design ride, its speed as a prior."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_config import TrackFilterConfig
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.line_map import LineMap

Array = NDArray[np.float64]

SLOWEST_MPS = 1.0
"""Below this the design ride's speed says nothing: it stops, starts or waits there."""
PLACE_SIGMA_M = 0.7
"""Where brakes and drives take hold differs from the design by this much."""


def line_map(design: DesignRide, config: TrackFilterConfig) -> LineMap:
    """Return the line of the design ride's seat, with its speed where it passes just once."""
    table = LineMap(Centreline.from_design_ride(design), config.attitude_sigma)
    if config.speed_sigma > 0.0:
        table.set_speed(*usual_speed(design, table))
    return table


def usual_speed(design: DesignRide, table: LineMap) -> tuple[Array, Array]:
    """
    Return speed and what its place leaves open (M,) by chainage [m/s]; NaN where not known.

    A track that is run both ways has no usual speed.
    """
    s = table.chainage
    unknown = np.full(len(s), np.nan)
    rate = np.gradient(design.chainage, design.time_s)
    if rate.min() < -0.1:
        return unknown, unknown
    moving = np.flatnonzero(rate > 0.05)
    where = design.chainage[moving]
    if table.closed:
        where = where % table.length
    order = np.argsort(where, kind='stable')
    speed = np.interp(s, where[order], rate[moving][order])
    speed[speed < SLOWEST_MPS] = np.nan
    slope = np.abs(np.gradient(speed, table.step_m))
    return speed, PLACE_SIGMA_M * slope

"""The coaster's line for the track filter: attitude from the design ride, its speed as a prior."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from coaster_localization.seat_line import seat_line
from coaster_localization.track_config import TrackFilterConfig
from track_localization.errors import DataError
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.learned_line import LearnedLine
from track_localization.track.line_map import CLIMB, RENEWAL, SIGMA, SPEED, SPEED_SIGMA, LineMap
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

SLOWEST_MPS = 0.5
"""Below this the design ride's speed says nothing: it stops, starts or waits there."""
PLACE_SIGMA_M = 0.7
"""Where brakes and drives take hold differs from the design by this much."""
DRIVEN_ACCEL, DRIVEN_MPS = 0.03, 8.0
"""A train that keeps its speed within this [m/s^2] below this speed is driven."""
COASTING_ACCEL = 0.25
"""One that keeps it within this, on a level line, coasts at the speed that a brake let it have."""
PASS_M, PASS_MPS = 4.0, 0.3
"""A train met under way is looked for every so many metres, where it moves [m/s]."""
SAME_LENGTH_M = 1.0
"""Two lines whose lengths differ by less than this are of the same track."""
CORNER = 0.15
"""Share of that which holds where the speed has a corner."""
AGREE = 0.05
"""Passes of the design whose speeds differ by less than this share tell one usual speed."""
CHANGE_M, RENEWED = 2.0, 3.0
"""Half the length of a change of drive; what is left of the old deviation is exp(-RENEWED)."""


def line_map(
    design: DesignRide, config: TrackFilterConfig, learned: LearnedLine | None = None
) -> LineMap:
    """
    Return the line of the design ride's seat, with its speed where it passes just once.

    What was learnt from rides takes the design's place. Raise DataError where it was learnt on
    a line of another length.
    """
    table = LineMap(Centreline.from_design_ride(design), config.attitude_sigma)
    if config.speed_sigma > 0.0:
        speed = usual_speed(design, table)
        open_ = place_spread(speed, table.step_m)
        back = usual_speed(design, table, backward=True)
        renewal = regime_changes(speed, table) + regime_changes(-back, table)
        table.set_speed(speed, open_, 1.0 / config.speed_correlation_m + renewal)
        table.set_speed_back(back, place_spread(back, table.step_m))
    table.passes = passes(design)
    if learned is not None:
        correct_line(table, learned, config.speed_sigma > 0.0)
    return table


def track_map(
    track: TrackFile,
    config: TrackFilterConfig,
    wheelbase_m: float,
    seat_m: Array,
    line_height_m: float = 0.0,
) -> LineMap:
    """
    Return the line of a seat on a track that was exported without a ride; no speed is known.

    ``wheelbase_m`` between the bogies, ``seat_m`` (3,) from their middle in the car's axes, and
    ``line_height_m`` of the file's line above the rail centre [m].
    """
    line = seat_line(Centreline.from_track(track), wheelbase_m, seat_m, line_height_m)
    return LineMap(line, config.attitude_sigma)


def correct_line(table: LineMap, learned: LearnedLine, speed: bool = True) -> None:
    """Put what was learnt into a line: attitude, what is left of its sigma and, if so, speed."""
    if abs(float(learned.chainage[-1]) - table.length) > SAME_LENGTH_M:
        raise DataError(
            f'learned line: it ends at {learned.chainage[-1]:.1f} m, the design ride at '
            f'{table.length:.1f} m; use the design ride it was learnt with, or learn it anew'
        )
    s = table.chainage
    turn = [np.interp(s, learned.chainage, column) for column in learned.turn.T]
    table.turn(np.stack(turn, axis=1))
    sigma = np.interp(s, learned.chainage, learned.sigma)
    table.rows[:, SIGMA] = np.where(np.isfinite(sigma), sigma, table.rows[:, SIGMA])
    if not speed:
        return
    usual = np.interp(s, learned.chainage, learned.speed)
    spread = np.interp(s, learned.chainage, learned.speed_sigma)
    known = np.isfinite(usual + spread)
    table.set_speed(
        np.where(known, usual, table.rows[:, SPEED]),
        np.where(known, spread, table.rows[:, SPEED_SIGMA]),
        table.rows[:, RENEWAL],
    )


def passes(design: DesignRide) -> Array:
    """Return chainage [m] and its rate [m/s] (K, 2) along the ride, every few metres."""
    rate = np.gradient(design.chainage, design.time_s)
    travelled = np.cumsum(np.abs(rate) * np.gradient(design.time_s))
    moving = np.abs(rate) > PASS_MPS
    bins = np.where(moving, np.floor(travelled / PASS_M), -1.0)
    rows = np.unique(bins, return_index=True)[1]
    rows = rows[moving[rows]]
    return np.column_stack([design.chainage[rows], rate[rows]])


def usual_speed(design: DesignRide, table: LineMap, backward: bool = False) -> Array:
    """
    Return the design's speed (M,) by chainage [m/s], one way; NaN where it is not known.

    Where the design passes several times (laps, a shuttle) it is known if the passes agree.
    Running ``backward`` it is negative.
    """
    way = -1.0 if backward else 1.0
    rate = np.gradient(design.chainage, design.time_s)
    least, most = np.full(len(table.rows), np.nan), np.full(len(table.rows), np.nan)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], way * rate > 0.05, [0]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        s, v = design.chainage[first:last], way * rate[first:last]
        s, v = (s[::-1], v[::-1]) if backward else (s, v)
        laps = np.arange(s[0] // table.length, s[-1] // table.length + 1) if table.closed else [0]
        for lap in laps:
            here = np.interp(table.chainage + lap * table.length, s, v, np.nan, np.nan)
            least, most = np.fmin(least, here), np.fmax(most, here)
    agree = (most - least <= AGREE * most) & (least >= SLOWEST_MPS)
    return np.where(agree, 0.5 * way * (least + most), np.nan)


def place_spread(speed: Array, step_m: float) -> Array:
    """
    Return how much the speed (M,) differs where brakes and drives take hold elsewhere [m/s].

    By its slope, and to both sides of a corner by a share of what three points differ.
    """
    shift = round(np.sqrt(3.0) * PLACE_SIGMA_M / step_m)
    padded = np.pad(speed, shift, mode='edge')
    ahead, behind = padded[2 * shift :], padded[: len(speed)]
    apart = np.sqrt(((ahead - speed) ** 2 + (behind - speed) ** 2) / 6.0)
    slope = np.abs(np.gradient(speed, step_m))
    return np.asarray(np.maximum(PLACE_SIGMA_M * slope, CORNER * apart))


def regime_changes(speed: Array, table: LineMap) -> Array:
    """
    Return how fast a deviation from the usual speed is renewed (M,) [1/m].

    A lift, a tyre drive or a trim keeps a speed of its own: how far one is off says nothing of
    the next. Their ends are where the speed begins or ceases to be constant. So it is where a
    brake has let go, and the train coasts on the level.
    """
    acceleration = uniform_filter1d(np.nan_to_num(speed * np.gradient(speed, table.step_m)), 11)
    slow, pull = speed < DRIVEN_MPS, np.abs(table.rows[:, CLIMB])
    driven = slow & (np.abs(acceleration) < DRIVEN_ACCEL)
    coasting = slow & (np.maximum(np.abs(acceleration), pull) < COASTING_ACCEL)
    size = round(2.0 * CHANGE_M / table.step_m)
    near = np.zeros(len(speed))
    for held in (driven, coasting):
        held = maximum_filter1d(minimum_filter1d(held, size), size)
        near[np.flatnonzero(np.diff(held.astype(int)))] = 1.0
    return np.asarray(maximum_filter1d(near, size) * (RENEWED / (2.0 * CHANGE_M)))

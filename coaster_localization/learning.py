"""
Learning a ride from several recordings of it: its usual speed, and the track as it was built.

Every recording is smoothed on the design line. Attitude: what is left between the smoothed
attitude and the line's, Log(R(s)' C M'), by chainage. What is left of one ride holds that ride's
mount (constant in body axes) and drift (constant in ``map``), so each ride's own smooth part of
both is taken out first; the mean over rides is what the rides share, the built track. A shift of
the track along itself looks like a shift of the train and cannot be seen this way: it stays in
the sigma. Speed: the logarithm of the speed against the design's, averaged; what is left when
each ride's own pace is taken out is the spread.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter1d

from coaster_localization.ride_passes import SmoothedRide, split_passes
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_map import PLACE_SIGMA_M, usual_speed
from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.track.design_ride import DesignRide
from track_localization.track.learned_line import LearnedLine
from track_localization.track.line_map import ATTITUDE, TURNING, LineMap

Array = NDArray[np.float64]

STEP_M = 0.5
"""Between rows of what is learnt."""
MOVING_MPS = 1.0
OWN_M = 50.0
"""Length over which a ride's own mount and drift are smooth (sigma of a Gaussian)."""
PACE_M = 20.0
"""The same of a ride's pace against the usual speed."""
SCATTER_M = 10.0
"""Length over which the scatter between rides is pooled (sigma of a Gaussian)."""
PRIOR_RIDES = 4.0
"""Rides' worth of belief in the settings' own spread of speeds."""
FADE_M = 6.0
"""A correction fades out over this distance where no ride tells."""
COMMON_SHARE = 0.35
"""Share of the built track's deviation that no number of rides shows: it moves all alike."""


@dataclasses.dataclass(frozen=True)
class Lesson:
    """
    What the rides say.

    Attributes:
        learned: for the next ride.
        deviation: (M, 3) mean of what is left about x, y, z of the body [rad], as measured.
        error: (M, 3) its standard error [rad]; NaN where fewer than two passes tell.
        speeds: (K, M) of each pass [m/s], NaN where it did not go.
        design_speed: (M,) [m/s], NaN where there is none.
    """

    learned: LearnedLine
    deviation: Array
    error: Array
    speeds: Array
    design_speed: Array


@dataclasses.dataclass(frozen=True)
class Difference:
    """A stretch where built track and design differ: chainages [m], axis, largest value [rad]."""

    from_m: float
    to_m: float
    axis: str
    largest: float
    error: float


def learn(rides: Sequence[SmoothedRide], design: DesignRide, config: TrackFilterConfig) -> Lesson:
    """Learn from rides on one design line; raise DataError for fewer than two of them."""
    if len(rides) < 2:
        raise DataError(
            f'{len(rides)} ride: what a ride shares with others shows from two rides on; '
            'name more recordings'
        )
    line = rides[0].line
    grid = np.linspace(0.0, line.length, max(2, round(line.length / STEP_M) + 1))
    left, speeds = [], []
    for ride in rides:
        residual = attitude_residual(ride)
        for part in split_passes(ride.chainage, line):
            speed = part.on(grid, np.abs(ride.speed))
            speeds.append(np.where(speed > MOVING_MPS, speed, np.nan))
            seen = np.where(np.isfinite(speeds[-1])[:, None], part.on(grid, residual), np.nan)
            left.append(_without_own(seen, _attitudes(line, grid)))
    if not left:
        raise DataError('no ride moves by more than a few metres; record the train under way')
    passed = np.array(speeds)
    mean, error, count = _attitude(np.array(left))
    # No ride shows what is smaller than its error: the deviation is shrunk by it.
    told = np.asarray(np.isfinite(mean + error).all(axis=1))
    built = max(float(np.mean(mean[told] ** 2) - np.mean(error[told] ** 2)), 0.0)
    safe = np.where(told[:, None], error, np.inf)
    turn = _carried_on(np.where(told[:, None], mean * built / (built + safe**2 + 1e-12), np.nan))
    speed, spread = _speed(passed, grid, line, design, config)
    sigma = _remaining(error, built, config.attitude_sigma)
    return Lesson(
        LearnedLine(grid, speed, spread, turn, sigma, count),
        deviation=mean,
        error=error,
        speeds=passed,
        design_speed=np.interp(grid, line.chainage, usual_speed(design, line)),
    )


def attitude_residual(ride: SmoothedRide) -> Array:
    """Return rotation vectors (N, 3) from the line's attitude to the body's, body axes [rad]."""
    C, M = ride.x[:, 2:11].reshape(-1, 3, 3), ride.x[:, 11:20].reshape(-1, 3, 3)
    R = _attitudes(ride.line, ride.chainage)
    return so3.log(np.swapaxes(R, 1, 2) @ C @ np.swapaxes(M, 1, 2))


def differences(lesson: Lesson, least_rad: float = 0.003, least_m: float = 3.0) -> list[Difference]:
    """Return where the deviation is beyond its 99.7 % band and ``least_rad``, on ``least_m``."""
    found = []
    s = lesson.learned.chainage
    for k, axis in enumerate(('roll', 'pitch', 'yaw')):
        value, error = lesson.deviation[:, k], lesson.error[:, k]
        with np.errstate(invalid='ignore'):
            clear = (np.abs(value) > 3.0 * error) & (np.abs(value) > least_rad)
        clear &= np.isfinite(value * error)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], clear.astype(int), [0]])))
        for a, b in zip(edges[::2], edges[1::2] - 1, strict=True):
            if s[b] - s[a] >= least_m:
                peak = a + int(np.argmax(np.abs(value[a : b + 1])))
                found.append(
                    Difference(
                        *(float(s[a]), float(s[b]), axis, float(value[peak]), float(error[peak]))
                    )
                )
    return sorted(found, key=lambda d: d.from_m)


def _attitudes(line: LineMap, chainage: Array) -> Array:
    """Return the line's attitudes (N, 3, 3) between its rows, as the filter has them."""
    s = chainage % line.length if line.closed else np.clip(chainage, 0.0, line.length)
    i = np.clip((s / line.step_m).astype(int), 0, len(line.rows) - 2)
    ahead = line.rows[i, TURNING] * (s - i * line.step_m)[:, None]
    return np.asarray(line.rows[i, ATTITUDE].reshape(-1, 3, 3) @ so3.exp(ahead))


def _smooth(values: Array, length_m: float) -> Array:
    """Return the Gaussian mean along axis 0 of values (M, ...), NaN left out of it."""
    there = np.isfinite(values).astype(float)
    sigma = length_m / STEP_M
    total = gaussian_filter1d(np.nan_to_num(values), sigma, axis=0, mode='nearest')
    weight = gaussian_filter1d(there, sigma, axis=0, mode='nearest')
    return np.asarray(np.where(there > 0.0, total / np.maximum(weight, 1e-9), np.nan))


def _without_own(residual: Array, R: Array) -> Array:
    """Take out of a ride's residual (M, 3) what is smooth in body axes, and in ``map``."""
    for _ in range(2):
        residual = residual - _smooth(residual, OWN_M)
        turned = np.einsum('nij,nj->ni', R, residual)
        residual = np.einsum('nji,nj->ni', R, turned - _smooth(turned, OWN_M))
    return residual


def _attitude(left: Array) -> tuple[Array, Array, Array]:
    """Return mean and its standard error (M, 3) over passes (K, M, 3), and their number (M,)."""
    there = np.asarray(np.isfinite(left).all(axis=2))
    count = there.sum(axis=0).astype(float)
    filled = np.where(there[:, :, None], left, 0.0)
    with np.errstate(invalid='ignore', divide='ignore'):
        mean = filled.sum(axis=0) / np.where(count > 0, count, np.nan)[:, None]
        square = np.where(there[:, :, None], (left - mean) ** 2, 0.0).sum(axis=0)
        scatter = square / np.where(count > 1, count - 1.0, np.nan)[:, None]
        error = np.sqrt(_smooth(scatter, SCATTER_M) / count[:, None])
    return mean, error, count


def _carried_on(turn: Array) -> Array:
    """Let a correction (M, 3) fade out where none is known: a step would be a kink of the line."""
    known = np.isfinite(turn).all(axis=1)
    if not known.any():
        return np.zeros_like(turn)
    gap, nearest = distance_transform_edt(~known, return_indices=True)
    return np.asarray(turn[nearest[0]] * np.exp(-((gap * STEP_M / FADE_M) ** 2))[:, None])


def _remaining(error: Array, built: float, prior: float) -> Array:
    """Return the attitude's sigma (M,) that is left; NaN where no ride told."""
    square = np.mean(error**2, axis=1)
    unknown = square / (built + square + 1e-12)
    return np.asarray(prior * np.sqrt(np.maximum(unknown, COMMON_SHARE**2)))


def _speed(
    speeds: Array, grid: Array, line: LineMap, design: DesignRide, config: TrackFilterConfig
) -> tuple[Array, Array]:
    """
    Return usual speed and its spread (M,) [m/s] from the passes' speeds (K, M).

    The design is believed as far as the rides do not differ from it by more than chance.
    """
    usual = np.interp(grid, line.chainage, usual_speed(design, line))
    with np.errstate(invalid='ignore'):
        ratio = np.log(speeds / usual)
    count = np.sum(np.isfinite(ratio), axis=0)
    known = np.asarray(count > 1)
    if not np.any(known):
        return np.full(len(grid), np.nan), np.full(len(grid), np.nan)
    mean = np.where(known, np.nansum(ratio, axis=0) / np.maximum(count, 1), np.nan)
    own = ratio - mean
    freedom = np.where(known, count - 1.0, np.nan)
    believed = PRIOR_RIDES * config.speed_sigma**2
    between = (np.nansum(own**2, axis=0) + believed) / (freedom + PRIOR_RIDES)
    chance = between / count.clip(1)
    typical = max(float(np.nanmean(mean**2) - np.nanmean(chance)), 0.0)
    learnt = usual * np.exp(mean * typical / (typical + chance))
    pace = _smooth(own.T, PACE_M).T
    place = PLACE_SIGMA_M * np.abs(np.gradient(usual, grid))
    left = np.nansum((own - pace) ** 2 - config.speed_noise**2, axis=0) * usual**2
    square = np.maximum(left + PRIOR_RIDES * place**2, 0.0) / (freedom + PRIOR_RIDES)
    spread = np.sqrt(square)
    return np.where(known, learnt, usual), np.where(known, np.maximum(spread, 1e-3), np.nan)

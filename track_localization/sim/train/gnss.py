"""The receiver: fixes with slow and white errors, reflections, held heights and lost skies."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.train import noise
from track_localization.sim.train.config import GnssErrors
from track_localization.sim.train.route import Pose, radii
from track_localization.sim.train.terrain import NO_HDOP, Sky

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEEPEST_REFLECTION = np.radians(45.0)
"""An error by reflection points no further up or down than this [rad]."""


@dataclasses.dataclass(frozen=True)
class GnssStream:
    """
    Fixes in the order of their stamps.

    Attributes:
        time_s, arrival_s: (K,) stamps and arrivals [s].
        latitude, longitude, height: (K,) [rad, rad, m]; NaN without a fix.
        covariance: (K, 3, 3) claimed, east, north, up [m^2]; zero where none is told.
        status: (K,) whether there is a fix.
        satellites: (K,) in use; -1 where it is not told.
        hdop: (K,) NaN where it is not told.
    """

    time_s: Array
    arrival_s: Array
    latitude: Array
    longitude: Array
    height: Array
    covariance: Array
    status: Mask
    satellites: NDArray[np.int64]
    hdop: Array

    def __len__(self) -> int:
        return len(self.time_s)


def read_gnss(
    rng: Generator, config: GnssErrors, time_s: Array, antenna: Pose, sky: Sky
) -> tuple[GnssStream, dict[str, Any]]:
    """Return the fixes at times (K,) of the run, and which of them are reflections."""
    status, searched = _having_fix(rng, config, time_s, sky)
    hdop = np.where(searched, NO_HDOP, sky.hdop)
    satellites = np.where(searched, 0, sky.satellites)
    error, drift_s = _errors(rng, config, time_s)
    error *= np.where(status, hdop, 1.0)[:, None]
    reflected, by = _reflections(rng, config, sky.covered)
    reflected &= status
    error += by * reflected[:, None]
    meridian, across = radii(antenna.latitude)
    latitude = antenna.latitude + error[:, 1] / (meridian + antenna.height)
    east = (across + antenna.height) * np.cos(antenna.latitude)
    longitude = antenna.longitude + error[:, 0] / east
    flat = status & (satellites == 3)
    height = _held(antenna.height + error[:, 2], status & ~flat, flat)
    level = np.hypot(config.drift_m, config.noise_m) * hdop
    up = np.where(flat, config.held_up_m, np.hypot(config.drift_up_m, config.noise_up_m) * hdop)
    variance = np.stack([level, level, up], axis=1) ** 2
    covariance = np.where(status, variance.T, 0.0).T[:, :, None] * np.eye(3)
    latitude, longitude, height = np.where(status, (latitude, longitude, height), np.nan)
    stream = GnssStream(
        time_s=time_s,
        arrival_s=time_s + rng.uniform(*config.latency_s, len(time_s)),
        latitude=latitude,
        longitude=longitude,
        height=height,
        covariance=covariance,
        status=status,
        satellites=satellites,
        hdop=hdop,
    )
    info = {'drift_s': drift_s, 'reflected_s': time_s[reflected].tolist()}
    return stream, info


def _having_fix(rng: Generator, config: GnssErrors, time_s: Array, sky: Sky) -> tuple[Mask, Mask]:
    """Return which rows have a fix, and which still search although the sky is back."""
    dark = sky.satellites == 0
    searching = np.zeros(len(time_s), dtype=bool)
    for row in np.flatnonzero(dark[:-1] & ~dark[1:]) + 1:
        until = time_s[row - 1] + rng.uniform(*config.search_s)
        searching |= (time_s >= time_s[row]) & (time_s < until) & ~dark
    begin, end = config.outage_s
    lost = searching | ((time_s >= begin) & (time_s < end))
    return ~dark & ~lost, lost


def _errors(rng: Generator, config: GnssErrors, time_s: Array) -> tuple[Array, float]:
    """Return errors (K, 3) at HDOP 1, east, north, up, and their correlation time."""
    n, drift_s = len(time_s), float(rng.uniform(*config.drift_s))
    drift = noise.correlated(rng, n, drift_s * config.rate_hz, 3)
    slow = np.array([config.drift_m, config.drift_m, config.drift_up_m])
    quick = np.array([config.noise_m, config.noise_m, config.noise_up_m])
    return slow * drift + quick * rng.standard_normal((n, 3)), drift_s


def _reflections(rng: Generator, config: GnssErrors, covered: Mask) -> tuple[Mask, Array]:
    """Return which rows reflections spoil, and the errors (K, 3) that they would make."""
    n = len(covered)
    chance = np.where(covered, config.outliers_covered, config.outliers)
    spoilt = rng.random(n) < chance
    least, most = config.outlier_m
    length = least * (most / least) ** rng.random(n)
    course = rng.uniform(-np.pi, np.pi, n)
    steep = rng.uniform(-STEEPEST_REFLECTION, STEEPEST_REFLECTION, n)
    level = np.cos(steep)
    way = np.stack([level * np.cos(course), level * np.sin(course), np.sin(steep)], axis=1)
    return spoilt, length[:, None] * way


def _held(height: Array, good: Mask, flat: Mask) -> Array:
    """Return heights (K,) where a flat fix repeats the last good one before it, if any."""
    last = np.maximum.accumulate(np.where(good, np.arange(len(height)), -1))
    return np.where(flat & (last >= 0), height[np.maximum(last, 0)], height)

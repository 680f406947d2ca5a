"""Bad data: what goes wrong with messages apart from the errors of sensors."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.estimation.imu import ImuSeries
from track_localization.sim.train.config import Faults
from track_localization.sim.train.gnss import GnssStream

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OUTLIERS = 3
"""Fixes in a row that are far off."""


def spoil_stamps(
    rng: Generator, config: Faults, time_s: Array, spell: int
) -> tuple[Array, list[float]]:
    """Return stamps (N,) with spells of so many that are off, and when the spells begin."""
    out, begins = time_s.copy(), []
    for _ in range(config.time_jumps if len(time_s) > 2 * spell else 0):
        first = int(rng.integers(spell, len(time_s) - spell))
        out[first : first + spell] = time_s[first : first + spell]
        out[first : first + spell] += config.time_jump_s * rng.choice([-1.0, 1.0])
        begins.append(float(time_s[first]))
    return out, begins


def spoil_imu(
    rng: Generator, config: Faults, imu: ImuSeries
) -> tuple[ImuSeries, Mask, dict[str, Any]]:
    """Return the samples, which of them (N,) are recorded, and when there is a gap."""
    n = len(imu)
    nan = rng.random(n) < config.nan
    force, rate = imu.specific_force.copy(), imu.angular_rate.copy()
    of_force = rng.random(n) < 0.5
    force[nan & of_force], rate[nan & ~of_force] = np.nan, np.nan
    begin = _begin(rng, imu.time_s, config.imu_gap_s)
    keep = ~((imu.time_s >= begin) & (imu.time_s < begin + config.imu_gap_s))
    stamps, jumps = spoil_stamps(rng, config, imu.time_s, 30)
    gap = [begin, begin + config.imu_gap_s] if config.imu_gap_s > 0.0 else []
    info = {'gap_s': gap, 'nan': int(nan.sum()), 'time_jumps_s': jumps}
    return ImuSeries(stamps, force, rate), keep, info


def spoil_wheel(
    rng: Generator, config: Faults, time_s: Array, speed: Array
) -> tuple[Array, Array, dict[str, Any]]:
    """Return stamps and speeds (N,), and when the odometer is stuck."""
    nan = rng.random(len(speed)) < config.nan
    begin = _begin(rng, time_s, config.stuck_s, speed > 0.5 * speed.max(initial=0.0))
    stuck = (time_s >= begin) & (time_s < begin + config.stuck_s)
    out = np.where(stuck, speed[max(int(np.argmax(stuck)) - 1, 0)], speed) if len(speed) else speed
    span = [begin, begin + config.stuck_s] if stuck.any() else []
    told = np.where(nan, np.nan, out)
    stamps, jumps = spoil_stamps(rng, config, time_s, 4)
    return stamps, told, {'stuck_s': span, 'nan': int(nan.sum()), 'time_jumps_s': jumps}


def spoil_gnss(
    rng: Generator, config: Faults, gnss: GnssStream
) -> tuple[GnssStream, dict[str, Any]]:
    """Return the fixes, and what was done to them."""
    n = len(gnss)
    nan = (rng.random(n) < config.nan) & gnss.status
    latitude, longitude, height = gnss.latitude.copy(), gnss.longitude.copy(), gnss.height.copy()
    far = _far(rng, config, gnss)
    latitude[far] += config.gnss_outlier_m / 6.37e6
    for x in (latitude, longitude, height):
        x[nan] = np.nan
        if config.stale_no_fix:
            x[:] = _stale(x, gnss.status & ~nan)
    stamps, jumps = spoil_stamps(rng, config, gnss.time_s, 2)
    spoilt = dataclasses.replace(
        gnss,
        time_s=stamps,
        latitude=latitude,
        longitude=longitude,
        height=height,
        covariance=np.zeros_like(gnss.covariance) if config.no_covariance else gnss.covariance,
        satellites=np.full(n, -1) if config.no_quality else gnss.satellites,
        hdop=np.full(n, np.nan) if config.no_hdop or config.no_quality else gnss.hdop,
    )
    info = {'far_s': gnss.time_s[far].tolist(), 'nan': int(nan.sum()), 'time_jumps_s': jumps}
    return spoilt, info


def _far(rng: Generator, config: Faults, gnss: GnssStream) -> NDArray[np.int64]:
    """Return rows of fixes in a row, all of them fixes, for an outlier."""
    good = gnss.status.astype(np.int64)
    runs = np.flatnonzero(np.convolve(good, np.ones(OUTLIERS, dtype=np.int64), 'valid') == OUTLIERS)
    runs = runs[runs > len(gnss) // 4]
    place = rng.uniform()
    if config.gnss_outlier_m == 0.0 or not len(runs):
        return np.zeros(0, dtype=np.int64)
    return np.arange(OUTLIERS) + runs[int(place * len(runs))]


def _stale(x: Array, good: Mask) -> Array:
    """Return values (K,) of which the bad ones repeat the last good one, if any."""
    last = np.maximum.accumulate(np.where(good, np.arange(len(x)), -1))
    return np.where(last >= 0, x[np.maximum(last, 0)], x)


def _begin(rng: Generator, time_s: Array, length: float, where: Mask | None = None) -> float:
    """Return when something of this length begins, so that it ends before the run does."""
    place = float(rng.uniform())
    possible = time_s < time_s[-1] - length
    if where is not None:
        possible &= where
    rows = np.flatnonzero(possible)
    return float(time_s[rows[int(place * len(rows))]]) if len(rows) else float(time_s[0])

"""The Doppler radar: scale, drift, slips, outliers, and its weakness at a crawl."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

from track_localization.sim.maglev.config import RadarErrors

Array = NDArray[np.float64]

LEAST_SIGMA_MPS = 0.001
"""The least a sender claims [m/s]: a variance must be positive."""


def read_radar(
    rng: Generator, config: RadarErrors, time_s: Array, v: Array
) -> tuple[Array, Array, dict[str, Any]]:
    """Return speeds (N,) [m/s] told for true ones, their claimed variances, and what went wrong."""
    n = len(v)
    scale = config.scale * rng.standard_normal()
    drift = config.drift * _correlated(rng, n, config.rate_hz * config.drift_time_s)
    slip, slips = _slips(rng, config, time_s, v)
    sigma = config.noise_mps + config.noise_share * np.abs(v)
    told = (1.0 + scale + drift + slip) * v + sigma * rng.standard_normal(n)
    outlier = rng.random(n) < config.outliers
    told = told + config.outlier_mps * outlier * rng.choice([-1.0, 1.0], n)
    crawl = np.where(
        rng.random(n) < config.least_zero, 0.0, config.least_noise_mps * rng.standard_normal(n)
    )
    told = np.where((np.abs(v) < config.least_mps) & ~outlier, crawl, told)
    claimed = np.maximum(config.noise_mps + config.noise_share * np.abs(told), LEAST_SIGMA_MPS) ** 2
    info = {'scale': float(scale), 'slips': slips, 'outliers': int(outlier.sum())}
    return told, claimed, info


def _correlated(rng: Generator, n: int, steps: float) -> Array:
    """Return a Gauss-Markov process (N,) of unit variance, correlated over so many steps."""
    keep = np.exp(-1.0 / steps)
    drive = np.sqrt(1.0 - keep**2) * rng.standard_normal(n)
    drive[0] = rng.standard_normal()
    out: Array = lfilter([1.0], [1.0, -keep], drive)
    return out


def _slips(
    rng: Generator, config: RadarErrors, time_s: Array, v: Array
) -> tuple[Array, list[list[float]]]:
    """Return the scale error of slips (N,), and [begin s, length s, error] of each."""
    error, slips = np.zeros(len(v)), []
    moving = np.flatnonzero(v > max(config.least_mps, 0.1 * float(v.max())))
    for _ in range(config.slips if len(moving) else 0):
        begin = float(time_s[rng.choice(moving)])
        length = float(rng.uniform(*config.slip_s))
        share = config.slip_share * float(rng.choice([-1.0, 1.0]))
        error[(time_s >= begin) & (time_s < begin + length)] += share
        slips.append([begin, length, share])
    return error, slips

"""What covers the sky along the line, and what a receiver has of it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.train import noise
from track_localization.sim.train.config import Terrain

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_COVERED = 0.6
"""More than this share of the way is not covered: what does not fit is left out."""

NO_HDOP = 99.99
"""What receivers tell for HDOP where they have no fix (NMEA 0183)."""


@dataclasses.dataclass(frozen=True)
class Cover:
    """
    Tunnels and cuttings by chainage.

    Attributes:
        tunnel: (K, 2) from, to [m].
        cutting: (M, 2) from, to [m].
        hdop: (M,) mean HDOP of the cuttings.
    """

    tunnel: Array
    cutting: Array
    hdop: Array


@dataclasses.dataclass(frozen=True)
class Sky:
    """Satellites in use and HDOP (K,) at each fix; ``covered``: reflections are likely."""

    satellites: NDArray[np.int64]
    hdop: Array
    covered: Mask


def lay_cover(rng: Generator, config: Terrain, begin: float, end: float) -> Cover:
    """Return what covers the sky between two chainages, nothing over anything else."""
    tunnels = int(rng.integers(*config.tunnels, endpoint=True))
    cuttings = int(rng.integers(*config.cuttings, endpoint=True))
    lengths = np.concatenate(
        [rng.uniform(*config.tunnel_m, tunnels), rng.uniform(*config.cutting_m, cuttings)]
    )
    kind = np.repeat([0, 1], [tunnels, cuttings])
    order = rng.permutation(len(lengths))
    order = order[np.cumsum(lengths[order]) <= MOST_COVERED * (end - begin)]
    gaps = rng.exponential(size=len(order) + 1)
    gaps *= (end - begin - lengths[order].sum()) / gaps.sum()
    first = begin + np.cumsum(gaps[:-1]) + np.cumsum(lengths[order]) - lengths[order]
    spans = np.stack([first, first + lengths[order]], axis=1)
    cutting = spans[kind[order] == 1]
    hdop = rng.uniform(*config.cutting_hdop, len(cutting))
    return Cover(spans[kind[order] == 0], cutting, hdop)


def see(rng: Generator, config: Terrain, cover: Cover, time_s: Array, chainage: Array) -> Sky:
    """Return what a receiver has of the sky at times and chainages (K,)."""
    n = len(time_s)
    steps = config.wander_s / np.median(np.diff(time_s)) if n > 1 else 1.0
    low, high = config.open_hdop
    wander = np.tanh(noise.correlated(rng, n, float(steps)))
    hdop = 0.5 * (high + low) + 0.5 * (high - low) * wander
    few, many = config.open_satellites
    count = np.rint(0.5 * (many + few) - 0.5 * (many - few) * wander).astype(np.int64)
    mouth = _within(cover.tunnel + config.mouth_m * np.array([-1.0, 1.0]), chainage)
    count[mouth] = rng.integers(4, 6, int(mouth.sum()), endpoint=True)
    unsteady = 1.0 + 0.15 * rng.uniform(-1.0, 1.0, n)
    hdop[mouth] = (config.mouth_hdop * unsteady)[mouth]
    for (begin, end), mean in zip(cover.cutting, cover.hdop, strict=True):
        inside = (chainage >= begin) & (chainage < end)
        hdop[inside], count[inside] = (mean * unsteady)[inside], 3
        mouth |= inside
    dark = _within(cover.tunnel, chainage)
    hdop[dark], count[dark] = NO_HDOP, 0
    return Sky(count, hdop, mouth & ~dark)


def _within(spans: Array, chainage: Array) -> Mask:
    """Return which chainages (K,) lie in one of the spans (M, 2)."""
    inside = (chainage[:, None] >= spans[:, 0]) & (chainage[:, None] < spans[:, 1])
    return np.asarray(inside.any(axis=1))

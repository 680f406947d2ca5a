"""The way of messages: latency, messages held back, lost, or lost in a row."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.maglev.config import Delivery

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Way:
    """When messages arrive (N,) [s], which of them do so at all, and what went wrong."""

    arrival_s: Array
    kept: NDArray[np.bool_]
    info: dict[str, Any]


def deliver(rng: Generator, config: Delivery, time_s: Array, duration_s: float) -> Way:
    """Send messages stamped at these times (N,) of a run of this duration."""
    n = len(time_s)
    base = float(rng.uniform(*config.latency_s))
    arrival = time_s + base + config.latency_tail_s * rng.standard_exponential(n)
    late = rng.random(n) < config.late
    arrival += late * rng.uniform(*config.late_s, n)
    lost = rng.random(n) < config.dropped
    info: dict[str, Any] = {
        'latency_s': base,
        'late': int(late.sum()),
        'dropped': int(lost.sum()),
        'gaps': [],
    }
    for _ in range(rng.poisson(config.gaps)):
        begin = float(rng.uniform(0.0, duration_s))
        length = float(rng.uniform(*config.gap_s))
        lost |= (time_s >= begin) & (time_s < begin + length)
        info['gaps'].append([begin, length])
    return Way(arrival, ~lost, info)

"""The crossed induction loop: a counter of crossings, and what it misses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.maglev.config import LoopErrors
from track_localization.sim.maglev.motion import Motion

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

CLAIMED_SIGMA_M = 0.02
"""What a sender claims beside quantisation [m]."""

LEAST_SIGMA_M = 0.001
"""The least a sender claims [m]: a variance must be positive."""

JUMP_WINDOW_S = 0.05


def read_loop(
    rng: Generator, config: LoopErrors, motion: Motion, time_s: Array, balises_s: Array
) -> tuple[Array, Array, dict[str, Any]]:
    """
    Return readings (N,) [m] at times of the run, their claimed variances, and what went wrong.

    ``balises_s`` are the times at which balises are crossed [s].
    """
    s = motion.at(time_s)[0]
    if config.absolute:
        reading = s + config.noise_m * rng.standard_normal(len(s))
        return reading, np.full(len(s), max(config.noise_m, LEAST_SIGMA_M) ** 2), {}
    index = np.floor(s / config.pitch_m + 1e-9).astype(np.int64)
    steps, info = _seen(rng, config, index)
    counts = np.cumsum(steps)[index - index[0]]
    counts += _jumps(rng, config, motion, time_s, balises_s, info)
    if config.dead_for_s > 0.0 and not config.dead_counts:
        counts = _blind(config, time_s, counts)
    start = s[0] if config.starts_at_chainage else config.start_reading_m
    reading = config.pitch_m * (counts + np.floor(start / config.pitch_m + 1e-9))
    noise = config.noise_m * rng.standard_normal(len(s))
    variance = config.pitch_m**2 / 12.0 + CLAIMED_SIGMA_M**2 + config.noise_m**2
    return reading + noise, np.full(len(s), variance), info


def _seen(rng: Generator, config: LoopErrors, index: Counts) -> tuple[Counts, dict[str, Any]]:
    """Return how often each crossing is counted (0, 1, 2), the first one of the run 0 times."""
    steps = np.ones(int(index[-1] - index[0]) + 1, dtype=np.int64)
    missed = rng.random(len(steps)) < config.missed
    extra = rng.random(len(steps)) < config.extra
    steps += extra.astype(np.int64) - missed
    km = len(steps) * config.pitch_m / 1000.0
    info: dict[str, Any] = {
        'missed': int(missed[1:].sum()),
        'extra': int(extra[1:].sum()),
        'bursts': [],
        'dead_zones': [],
    }
    for _ in range(rng.poisson(config.bursts_per_km * km)):
        begin = int(rng.integers(len(steps)))
        count = int(rng.integers(config.burst[0], config.burst[1], endpoint=True))
        steps[begin : begin + count] = 0
        info['bursts'].append([float(index[0] + begin) * config.pitch_m, count])
    for _ in range(rng.poisson(config.dead_zones_per_km * km)):
        begin = int(rng.integers(len(steps)))
        length = float(rng.uniform(*config.dead_zone_m))
        steps[begin : begin + round(length / config.pitch_m)] = 0
        info['dead_zones'].append([float(index[0] + begin) * config.pitch_m, length])
    steps[0] = 0
    return steps, info


def _jumps(
    rng: Generator,
    config: LoopErrors,
    motion: Motion,
    time_s: Array,
    balises_s: Array,
    info: dict[str, Any],
) -> Counts:
    """Return what lasting jumps have added to the count by each time (N,)."""
    when = rng.uniform(0.0, motion.duration_s, config.glitches)
    struck = rng.random(len(balises_s)) < config.jump_at_balise
    beside = balises_s + rng.uniform(-JUMP_WINDOW_S, JUMP_WINDOW_S, len(balises_s))
    when = np.concatenate([when, beside[struck]])
    size = rng.integers(1, config.glitch_most, len(when), endpoint=True)
    size *= rng.choice([-1, 1], len(when))
    info['jumps'] = [[t, n] for t, n in zip(when.tolist(), size.tolist(), strict=True)]
    order = np.argsort(when)
    total = np.concatenate([[0], np.cumsum(size[order])])
    return np.asarray(total[np.searchsorted(when[order], time_s, 'right')], dtype=np.int64)


def _blind(config: LoopErrors, time_s: Array, counts: Counts) -> Counts:
    """Return the counts less what came while the loop failed."""
    begin = max(int(np.searchsorted(time_s, config.dead_from_s, 'left')) - 1, 0)
    end = int(np.searchsorted(time_s, config.dead_from_s + config.dead_for_s, 'left'))
    out = counts.copy()
    out[begin:end] = counts[begin]
    if end < len(counts):
        out[end:] -= counts[end] - counts[begin]
    return out

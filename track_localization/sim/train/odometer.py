"""The odometer: pulses of a wheel that slips, slides and is not quite of its nominal size."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.train.config import OdometerErrors
from track_localization.sim.train.motion import Motion

Array = NDArray[np.float64]
Spans = list[tuple[float, float]]

SUBSTEPS = 10
FULL_NOISE_M = 0.05
"""A reading that covers less is less noisy, and one at a standstill is not at all [m]."""

LEAST_MPS, UNEVEN_MPS2 = 2.0, 0.1
LIKELIER = 4.0
"""Slips are so much likelier in starting and braking than at an even speed."""

TRIES = 200


class Slip(NamedTuple):
    """Begin [s], length [s] and error over the speed, positive for a wheel that spins."""

    begin: float
    length: float
    share: float


def read_odometer(
    rng: Generator, config: OdometerErrors, motion: Motion, time_s: Array, slips: list[Slip]
) -> tuple[Array, Array, dict[str, Any]]:
    """Return the speeds (N,) told at these times, the claimed variances, and the errors."""
    interval = 1.0 / config.rate_hz
    edges = np.concatenate([time_s[:1] - interval, time_s])
    way = np.diff(motion.at(edges)[0])
    fine = edges[:-1, None] + interval * (np.arange(SUBSTEPS) + 0.5) / SUBSTEPS
    speed = motion.at(fine.ravel())[1]
    extra = speed * error_of(slips, config.slip_rise_s, fine.ravel())
    slipped = extra.reshape(fine.shape).sum(axis=1) * interval / SUBSTEPS
    scale = config.scale * float(rng.choice([-1.0, 1.0]))
    share = float(rng.uniform())
    if config.scale_law == 'uniform':
        scale *= share
    noisy = config.noise_m * np.minimum(way / FULL_NOISE_M, 1.0) * rng.standard_normal(len(way))
    turned = np.cumsum((1.0 + scale) * (way + slipped) + noisy) + config.pulse_m * rng.uniform()
    pulses = np.diff(np.floor(turned / config.pulse_m), prepend=0.0)
    told = pulses * config.pulse_m * config.rate_hz
    variance = (config.noise_m**2 + config.pulse_m**2 / 6.0) * config.rate_hz**2
    info = {'scale': scale, 'slips': [list(slip) for slip in slips]}
    return told, np.full(len(told), max(variance, 1e-8)), info


def error_of(slips: list[Slip], rise: float, time_s: Array) -> Array:
    """Return the error over the speed (N,): each slip rises, stays and falls."""
    error = np.zeros_like(time_s)
    for slip in slips:
        ramp = max(min(rise, 0.5 * slip.length), 1e-6)
        inside = np.minimum(time_s - slip.begin, slip.begin + slip.length - time_s)
        error += slip.share * np.clip(inside / ramp, 0.0, 1.0)
    return error


def draw_slips(
    rng: Generator, config: OdometerErrors, motion: Motion, outages: Spans
) -> list[Slip]:
    """Return the slips of a run in order, no two at once."""
    time = np.arange(0.0, motion.duration_s, 0.1)
    _, speed, acceleration = motion.at(time)
    weight = np.where(np.abs(acceleration) > UNEVEN_MPS2, LIKELIER, 1.0) * (speed > LEAST_MPS)
    outside = weight.copy()
    for begin, end in outages:
        outside[(time > begin - config.slip_s[1]) & (time < end)] = 0.0
    slips: list[Slip] = []
    _add(rng, config, motion, slips, time, outside, int(rng.poisson(config.slips)), np.inf)
    for begin, end in outages:
        inside = weight * ((time >= begin) & (time < end))
        count = int(rng.integers(*config.slips_in_outage, endpoint=True))
        _add(rng, config, motion, slips, time, inside, count, end)
    return sorted(slips)


def _add(
    rng: Generator,
    config: OdometerErrors,
    motion: Motion,
    slips: list[Slip],
    time_s: Array,
    weight: Array,
    count: int,
    latest: float,
) -> None:
    """Add ``count`` slips that begin where ``weight`` says and end by ``latest``, if they fit."""
    if weight.sum() == 0.0:
        return
    wanted = len(slips) + count
    for _ in range(TRIES * count):
        if len(slips) == wanted:
            return
        begin = float(rng.choice(time_s, p=weight / weight.sum()))
        length = float(rng.uniform(*config.slip_s))
        share, side = float(rng.uniform(*config.slip_share)), float(rng.choice([-1.0, 1.0]))
        acceleration = float(motion.at(np.array([begin]))[2][0])
        side = float(np.sign(acceleration)) if abs(acceleration) > UNEVEN_MPS2 else side
        apart = all(begin > s.begin + s.length or begin + length < s.begin for s in slips)
        if apart and begin + length <= latest:
            slips.append(Slip(begin, length, side * share))

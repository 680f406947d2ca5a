"""The track as built: smooth deviations from the design, a Gaussian process along the line."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.sim.coaster.seat import Deviations
from track_localization.track.uniform_spline import UniformSpline

Array = NDArray[np.float64]

STEP = 0.5
CLOSING_SHARE = 0.15


def smooth_process(
    rng: Generator, length: float, correlation: float, closed: bool, columns: int
) -> UniformSpline:
    """
    Draw a Gaussian process of unit variance with covariance exp(-d^2 / (2 correlation^2)).

    On a closed line it comes round smoothly; on an open one its ends are unrelated.
    """
    margin = 0.0 if closed else 6.0 * correlation
    count = max(int(np.ceil(length / STEP)), 16)
    step = length / count
    extra = int(np.ceil(margin / step))
    total = count + extra
    k = 2.0 * np.pi * np.fft.rfftfreq(total, step)
    spectrum = np.exp(-0.5 * (k * correlation) ** 2)
    white = np.fft.rfft(rng.standard_normal((total, columns)), axis=0)
    gain = np.sqrt(spectrum / _mean_power(spectrum, total))
    values = np.fft.irfft(white * gain[:, None], total, axis=0)
    if not closed:
        return UniformSpline(values[: count + 1], length)
    slopes = (np.roll(values, -1, axis=0)[0] - np.roll(values, 1, axis=0)[0]) / (2.0 * step)
    return UniformSpline(np.vstack([values, values[:1]]), length, True, np.stack([slopes, slopes]))


def _mean_power(spectrum: Array, total: int) -> float:
    """Return the mean of a one-sided spectrum over all ``total`` frequencies."""
    twice = np.full(len(spectrum), 2.0)
    twice[0] = 1.0
    if total % 2 == 0:
        twice[-1] = 1.0
    return float(np.sum(twice * spectrum) / total)


def build(
    rng: Generator,
    length: float,
    closed: bool,
    cross_m: float,
    cross_correlation_m: float,
    along_m: float,
    along_correlation_m: float,
    stretch: float,
    roll_rad: float,
) -> Deviations:
    """
    Draw how one built track deviates.

    ``stretch`` grows the along-track deviation in proportion to the chainage, to the sign drawn;
    a circuit takes it back over its last stretch (the station's straight), so that it closes.
    """
    cross = smooth_process(rng, length, cross_correlation_m, closed, 2)
    along = smooth_process(rng, length, along_correlation_m, closed, 1)
    roll = smooth_process(rng, length, cross_correlation_m, closed, 1)
    sign = 1.0 if rng.random() < 0.5 else -1.0
    grid = along.grid
    grown = sign * stretch * (np.hypot(grid, 10.0) - 10.0)
    if closed:
        u = np.clip((grid - length * (1.0 - CLOSING_SHARE)) / (length * CLOSING_SHARE), 0.0, 1.0)
        grown = grown * (1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
    total = along_m * along(grid)[:, 0] + grown
    if closed:
        total[-1] = total[0]
    slope = along_m * along(grid, 1)[:, 0]
    ends = np.array([[slope[0]], [slope[-1] + (0.0 if closed else sign * stretch)]])
    return Deviations(
        along=UniformSpline(total[:, None], length, closed, ends),
        cross=_scaled(cross, cross_m),
        roll=_scaled(roll, roll_rad),
    )


def _scaled(process: UniformSpline, factor: float) -> UniformSpline:
    grid = process.grid
    values = factor * process(np.minimum(grid, process.length * (1.0 - 1e-12)))
    slopes = factor * process(np.array([0.0, process.length * (1.0 - 1e-12)]), 1)
    return UniformSpline(values, process.length, process.closed, slopes)

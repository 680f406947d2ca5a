"""
The offset between the clock on the ground and that of the recording.

An offset is added to a time of the ground's clock to get the recording's. It is found from markers
(timed places), or from one event: the train passed a known chainage at a known time.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import at_times, speed_of

Array = NDArray[np.float64]

TWO_SIDED_95 = 1.96
BIWEIGHT = 4.685
"""Residuals beyond this many scales weigh nothing (Tukey's biweight, 95 % efficient)."""
MAD_TO_SIGMA = 1.4826
SMALLEST_SCALE_M = 1e-6
STANDING_MPS = 0.5
"""Below this speed the passing of a place has no definite time [m/s]."""
STANDING_REACH_M = 0.25
"""A train that rests this close to a place, or within two sigma of it, stands there [m]."""
ONE_PASS_S = 1.0
"""Crossings closer together than this are one passing, seen by a jittering estimate [s]."""


@dataclasses.dataclass(frozen=True)
class ClockOffset:
    """
    What to add to times of the ground's clock to get the recording's.

    Attributes:
        offset_s: the offset [s]; NaN where none can be told.
        sigma_s: its standard deviation [s]; NaN where unknown.
        distance: (K,) what remains between estimate and markers with it [m]; empty for an event.
    """

    offset_s: float
    sigma_s: float
    distance: Array

    def text(self) -> str:
        """Return ``x ms +- y ms (95 %)``; offsets of ten seconds and more are in seconds."""
        wide = abs(self.offset_s) >= 10.0
        value = f'{self.offset_s:.3f} s' if wide else f'{1e3 * self.offset_s:.0f} ms'
        if not np.isfinite(self.sigma_s):
            return f'{value} (its accuracy is not known)'
        return f'{value} +- {1e3 * TWO_SIDED_95 * self.sigma_s:.0f} ms (95 %)'


def fit_clock_offset(
    estimate: Trajectory, time_s: Array, design: Array, reach_s: float = 3.0
) -> ClockOffset:
    """
    Find the offset that brings the estimate closest to markers at ``time_s`` (K,), (K, 3).

    The mean distance, which a few wrong markers do not move, is searched on grids within
    ``reach_s``; from its least value Gauss-Newton steps with Tukey's weights go on, on what is
    left along the direction of travel. Sigma is that of the last step's normal equations with
    the residuals' own scatter, and what the estimate claims to be off along the track: its errors
    go on from marker to marker, and one that all share cannot be told from an offset.

    NaN where the estimate covers fewer than three markers, or where the reach ends first.
    """
    nothing = ClockOffset(float('nan'), float('nan'), np.full(len(time_s), np.nan))
    offset = 0.0
    for step, half_width in ((0.1, reach_s), (0.01, 0.1)):
        count = round(half_width / step)
        offsets: Array = offset + step * np.arange(-count, count + 1, dtype=np.float64)
        losses = _losses(estimate, time_s, design, offsets)
        if not np.isfinite(losses).any():
            return nothing
        offset = float(offsets[int(np.nanargmin(losses))])
    if abs(offset) > reach_s - 0.05:
        return nothing
    offset, sigma = _refined(estimate, time_s, design, offset)
    left = np.linalg.norm(at_times(estimate, time_s + offset).position - design, axis=1)
    return ClockOffset(offset, sigma, left)


def offset_from_event(estimate: Trajectory, time_s: float, chainage_m: float) -> ClockOffset:
    """
    Return the offset from one event: the train passed ``chainage_m`` at the ground's ``time_s``.

    Its sigma is that of the estimate along the track over the speed there. Raise DataError where
    the train never passes that chainage, does so several times, or stands or turns there.
    """
    if estimate.chainage is None:
        raise DataError('clock event: this method gives no chainage; take another one')
    place = f'clock event: chainage {chainage_m:g} m'
    _check_moving(estimate, chainage_m, place)
    found, turns = _passings(estimate, chainage_m)
    if not found and turns:
        raise DataError(f'{place}: the train turns back there, at {turns[0]:.2f} s')
    if not found:
        low, high = np.nanmin(estimate.chainage), np.nanmax(estimate.chainage)
        raise DataError(f'{place} is never passed; the ride goes from {low:.1f} to {high:.1f} m')
    if len(found) > 1:
        times = ', '.join(f'{t:.2f}' for t in found)
        raise DataError(
            f"{place} is passed {len(found)} times, at {times} s of the recording's clock; "
            'name a place that is passed once'
        )
    there = at_times(estimate, np.array([found[0]]))
    if not np.isfinite(there.position).all():
        raise DataError(f'{place} is passed in a gap of the recording, at {found[0]:.2f} s')
    sigma = float('nan')
    if there.sigma_along is not None and there.speed is not None:
        sigma = float(there.sigma_along[0] / there.speed[0])
    return ClockOffset(found[0] - time_s, sigma, np.empty(0))


def _losses(estimate: Trajectory, time_s: Array, design: Array, offsets: Array) -> Array:
    """Return the mean distance (M,) for each offset; NaN where too few markers are covered."""
    there = at_times(estimate, np.add.outer(offsets, time_s).reshape(-1)).position
    distance = np.linalg.norm(there.reshape(len(offsets), len(time_s), 3) - design, axis=2)
    known = np.isfinite(distance)
    count = known.sum(axis=1)
    enough = count >= max(3, len(time_s) // 2)
    total = np.where(known, distance, 0.0).sum(axis=1)
    return np.where(enough, total / np.maximum(count, 1), np.nan)


def _refined(
    estimate: Trajectory, time_s: Array, design: Array, offset: float
) -> tuple[float, float]:
    """Return the M-estimate of the offset near ``offset`` and its sigma (Huber 1981, ch. 7)."""
    sigma = float('nan')
    for _ in range(10):
        there = at_times(estimate, time_s + offset)
        velocity = _velocity(estimate, time_s + offset)
        speed = np.linalg.norm(velocity, axis=1)
        with np.errstate(invalid='ignore', divide='ignore'):
            along = np.einsum('ij,ij->i', design - there.position, velocity) / speed
        unit = np.ones(len(time_s)) if there.sigma_along is None else there.sigma_along
        used = np.isfinite(along) & np.isfinite(unit) & (unit > 0.0)
        if used.sum() < 3:
            return offset, float('nan')
        step, sigma = _robust_step(
            along[used] / unit[used], speed[used] / unit[used], there.sigma_along is not None
        )
        if not np.isfinite(step):
            return offset, float('nan')
        offset += step
        if abs(step) < 1e-6:
            break
    return offset, sigma


def _robust_step(y: Array, x: Array, claimed: bool) -> tuple[float, float]:
    """
    Solve y = x b with the biweight from b = 0; return b and its sigma.

    ``y`` and ``x`` (K,) are in units of the claimed sigma when there is one: what an error of one
    claimed sigma at all markers would do to b is then part of the result's sigma.
    """
    n = len(y)
    # Few residuals about their own fit are smaller than the errors (Croux and Rousseeuw 1992).
    few = n / (n - 0.8) * np.sqrt(n / (n - 1.0))
    scale = max(MAD_TO_SIGMA * few * float(np.median(np.abs(y))), SMALLEST_SCALE_M)
    step = 0.0
    for _ in range(20):
        u = np.clip((y - step * x) / (BIWEIGHT * scale), -1.0, 1.0)
        weight = (1.0 - u**2) ** 2
        information = float((weight * x**2).sum())
        if information <= 0.0:
            return float('nan'), float('nan')
        step = float((weight * x * y).sum()) / information
    psi = weight * (y - step * x)
    slope = (1.0 - u**2) * (1.0 - 5.0 * u**2)
    mean = float(slope.mean())
    if mean <= 0.0:
        return step, float('nan')
    correction = 1.0 + float(slope.var()) / (n * mean**2)
    scatter = correction * np.sqrt(float((psi**2).sum()) / (n - 1.0)) / mean
    sigma = scatter / np.sqrt(float((x**2).sum()))
    shared = float((weight * x).sum()) / information if claimed else 0.0
    return step, float(np.hypot(sigma, shared))


def _velocity(estimate: Trajectory, time_s: Array, half_s: float = 0.05) -> Array:
    """Return velocities (K, 3) [m/s] as the positions show them over a tenth of a second."""
    later = at_times(estimate, time_s + half_s).position
    earlier = at_times(estimate, time_s - half_s).position
    velocity: Array = (later - earlier) / (2.0 * half_s)
    return velocity


def _check_moving(estimate: Trajectory, chainage_m: float, place: str) -> None:
    """Raise DataError where the train rests at the place."""
    assert estimate.chainage is not None
    reach = np.full(len(estimate), STANDING_REACH_M)
    if estimate.sigma_along is not None:
        reach = np.maximum(reach, 2.0 * estimate.sigma_along)
    near = np.abs(estimate.chainage - chainage_m) <= reach
    rests = estimate.time_s[near & (speed_of(estimate) < STANDING_MPS)]
    if len(rests):
        raise DataError(
            f'{place}: the train stands there, between {rests[0]:.2f} and {rests[-1]:.2f} s of the '
            "recording's clock; name a place that it passes at speed"
        )


def _passings(estimate: Trajectory, chainage_m: float) -> tuple[list[float], list[float]]:
    """Return when the chainage is passed, and when the train turns back within a second there."""
    assert estimate.chainage is not None
    s, t = estimate.chainage, estimate.time_s
    step = np.diff(s)
    travelled = np.linalg.norm(np.diff(estimate.position, axis=0), axis=1)
    wraps = np.abs(step) > 10.0 * travelled + 10.0
    # Past the end of a circuit the chainage starts again: it goes on by what was travelled.
    ahead = np.where(wraps, -np.sign(step) * travelled, step)
    before, after = s[:-1] - chainage_m, s[:-1] + ahead - chainage_m
    crossed = (before < 0.0) != (after < 0.0)
    again = s[1:] - ahead - chainage_m, s[1:] - chainage_m
    crossed_again = wraps & ((again[0] < 0.0) != (again[1] < 0.0))
    at: list[tuple[float, int]] = []
    for mask, (a, b) in ((crossed, (before, after)), (crossed_again, again)):
        for i in np.flatnonzero(mask):
            share = a[i] / (a[i] - b[i])
            at.append((float(t[i] + share * (t[i + 1] - t[i])), 1 if b[i] > a[i] else -1))
    groups: list[list[tuple[float, int]]] = []
    for crossing in sorted(at):
        if groups and crossing[0] - groups[-1][-1][0] < ONE_PASS_S:
            groups[-1].append(crossing)
        else:
            groups.append([crossing])
    passed: list[float] = []
    turned: list[float] = []
    for group in groups:
        through = sum(sign for _, sign in group) != 0
        (passed if through else turned).append(float(np.mean([time for time, _ in group])))
    return passed, turned

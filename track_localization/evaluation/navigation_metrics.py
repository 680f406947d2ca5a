"""
Figures of a vehicle that navigates by satellites, and of its passage through their outages.

Errors are taken at the estimate's own epochs, against the truth between its stamps, in ``map``.
Along and across are level: along the true course and to its left.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.consistency import position_nees
from track_localization.evaluation.interpolation import MAX_GAP_S, at_times, speed_of, tangent_of
from track_localization.evaluation.metrics import MOVING_MPS, moving, present, summary

Array = NDArray[np.float64]
Spans = Sequence[tuple[float, float]]
"""From and to [s]."""

ENTRY_S = 1.5
"""The error at an outage's entry is that of the latest epoch before it, no older than this [s]."""


@dataclasses.dataclass(frozen=True)
class NavigationErrors:
    """
    Errors over the moving part of a run, one row per epoch of the estimate.

    Attributes:
        time_s: (M,) stamps [s].
        position: (M, 3) estimate minus truth [m].
        velocity: (M, 3) [m/s].
        along, cross: (M,) level parts of the position's error, ahead and to the left [m].
        speed: (M,) estimated minus true speed [m/s].
        P: (M, 3, 3) claimed for the position [m^2]; NaN where none is.
        V: (M, 3, 3) claimed for the velocity [m^2/s^2].
        covered: share of the moving truth that the estimate is near to, 0..1.
    """

    time_s: Array
    position: Array
    velocity: Array
    along: Array
    cross: Array
    speed: Array
    P: Array
    V: Array
    covered: float

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def horizontal(self) -> Array:
        """Lengths of the level errors, (M,) [m]."""
        length: Array = np.hypot(self.position[:, 0], self.position[:, 1])
        return length

    def where(self, mask: NDArray[np.bool_]) -> NavigationErrors:
        """Return the rows of a mask (M,)."""
        parts = {
            f.name: getattr(self, f.name)[mask]
            for f in dataclasses.fields(self)
            if f.name != 'covered'
        }
        return dataclasses.replace(self, **parts)

    def within(self, spans: Spans) -> NDArray[np.bool_]:
        """Return a mask (M,) of the epochs inside some of the spans."""
        inside = np.zeros(len(self), dtype=bool)
        for begin, end in spans:
            inside |= (self.time_s >= begin) & (self.time_s < end)
        return inside


def navigation_errors(
    estimate: Trajectory, velocity_covariance: Array | None, truth: Trajectory
) -> NavigationErrors:
    """Compare an estimate, with (N, 3, 3) claimed for its velocity, with the truth."""
    there = at_times(truth, estimate.time_s)
    tangent = tangent_of(truth if truth.velocity is None else there)
    if truth.velocity is None:
        tangent = _at(truth.time_s, tangent, estimate.time_s)
    level = tangent[:, :2] / np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)[:, None]
    position = estimate.position - there.position
    nothing = np.full((len(estimate), 3, 3), np.nan)
    velocity = np.full((len(estimate), 3), np.nan)
    if estimate.velocity is not None and there.velocity is not None:
        velocity = estimate.velocity - there.velocity
    with np.errstate(invalid='ignore'):
        moves = speed_of(there) > MOVING_MPS
    errors = NavigationErrors(
        time_s=estimate.time_s,
        position=position,
        velocity=velocity,
        along=np.einsum('ni,ni->n', position[:, :2], level),
        cross=position[:, 1] * level[:, 0] - position[:, 0] * level[:, 1],
        speed=speed_of(estimate) - speed_of(there),
        P=nothing if estimate.covariance is None else estimate.covariance,
        V=nothing if velocity_covariance is None else velocity_covariance,
        covered=_covered(estimate, truth),
    )
    return errors.where(moves & np.isfinite(position[:, 0]))


def navigation_figures(errors: NavigationErrors, outages: Spans) -> dict[str, Any]:
    """
    Return the figures of metrics.json: over the run, outside and inside of the outages.

    ``outages`` holds one entry for each passage that the estimate covers, with the level error at
    its entry, its greatest and its last.
    """
    inside = errors.within(outages)
    passages = [passage(errors, span) for span in outages]
    return present(
        {
            'position_m': summary(np.linalg.norm(errors.position, axis=1)),
            'horizontal_m': summary(errors.horizontal),
            'up_m': summary(errors.position[:, 2]),
            'along_m': summary(errors.along),
            'cross_m': summary(errors.cross),
            'speed_mps': summary(errors.speed),
            **honesty(errors),
            'covered': errors.covered,
            'open_sky': {
                'horizontal_m': summary(errors.horizontal[~inside]),
                **honesty(errors.where(~inside)),
            },
            'outage': {
                'horizontal_m': summary(errors.horizontal[inside]),
                'max_m': _of_passages(passages, 'max_m'),
                'end_m': _of_passages(passages, 'end_m'),
                **honesty(errors.where(inside)),
            },
        }
    ) | {'outages': [p for p in passages if p]}


def honesty(errors: NavigationErrors) -> dict[str, float]:
    """
    Return NEES over its dimension, 1 when honest, and the share of components inside 2 sigma.

    ``nees_mean`` is not divided: 3 when honest.
    """
    position, velocity = (
        position_nees(errors.position, errors.P),
        position_nees(errors.velocity, errors.V),
    )
    return {
        'nees_mean': _mean(position),
        'nees_position_over_3': _mean(position) / 3.0,
        'nees_velocity_over_3': _mean(velocity) / 3.0,
        'inside_2_sigma': _inside(errors.position, errors.P),
        'velocity_inside_2_sigma': _inside(errors.velocity, errors.V),
    }


def passage(errors: NavigationErrors, span: tuple[float, float]) -> dict[str, float]:
    """
    Return how an estimate passes an outage; empty where it has no epoch inside.

    ``most_sigmas`` is the greatest level error over the greater level sigma at its time.
    """
    inside = errors.within([span])
    if not inside.any():
        return {}
    part = errors.where(inside)
    before = np.flatnonzero((errors.time_s <= span[0]) & (errors.time_s > span[0] - ENTRY_S))
    with np.errstate(invalid='ignore', divide='ignore'):
        sigma = np.sqrt(np.linalg.eigvalsh(_symmetric(part.P[:, :2, :2]))[:, 1])
        off = float(np.max(part.horizontal / sigma))
    found = {
        'from_s': span[0],
        'to_s': span[1],
        'max_m': float(part.horizontal.max()),
        'end_m': float(part.horizontal[-1]),
        'along_end_m': float(part.along[-1]),
        'cross_end_m': float(part.cross[-1]),
        'along_max_m': float(np.abs(part.along).max()),
        'cross_max_m': float(np.abs(part.cross).max()),
        'sigma_end_m': float(sigma[-1]),
        'most_sigmas': off,
    }
    if len(before):
        found['entry_m'] = float(errors.horizontal[before[-1]])
    return present(found)


def error_of_latest(
    time_s: Array, position: Array, truth: Trajectory, when_s: float
) -> float | None:
    """
    Return the level error of the latest of positions (K, 3) until a time [m].

    None where there is none in the ``ENTRY_S`` before, or no truth.
    """
    before = np.flatnonzero((time_s <= when_s) & (time_s > when_s - ENTRY_S))
    if not len(before):
        return None
    k = before[-1:]
    off = (position[k] - at_times(truth, time_s[k]).position)[0, :2]
    return float(np.hypot(*off)) if np.isfinite(off).all() else None


def _of_passages(passages: Sequence[Mapping[str, float]], name: str) -> dict[str, float]:
    return summary(np.array([p[name] for p in passages if p], dtype=np.float64))


def _inside(error: Array, covariance: Array) -> float:
    """Return the share of components (N, 3) within twice their sigma; NaN without any."""
    with np.errstate(invalid='ignore'):
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    known = np.isfinite(error) & np.isfinite(sigma)
    return float(np.mean(np.abs(error[known]) <= 2.0 * sigma[known])) if known.any() else np.nan


def _mean(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else np.nan


def _symmetric(blocks: Array) -> Array:
    """Return blocks (N, 2, 2) made symmetric; nought where not finite."""
    out = 0.5 * (blocks + np.swapaxes(blocks, 1, 2))
    bad = ~np.isfinite(out).all(axis=(1, 2))
    out[bad] = np.zeros((2, 2))
    return out


def _at(stamps: Array, values: Array, time_s: Array) -> Array:
    columns = [np.interp(time_s, stamps, values[:, k]) for k in range(values.shape[1])]
    return np.stack(columns, axis=1)


def _covered(estimate: Trajectory, truth: Trajectory) -> float:
    """Return the share of the moving truth epochs that the estimate is near to."""
    part = truth[moving(truth)]
    if not len(part):
        return float('nan')
    if len(estimate) < 2:
        return 0.0
    usual = float(np.median(np.diff(estimate.time_s)))
    there = at_times(estimate, part.time_s, max(MAX_GAP_S, 3.0 * usual))
    return float(np.isfinite(there.position[:, 0]).mean())

"""
Errors of an estimated trajectory against the truth and at markers, in the words of metrics.json.

Estimates are read at the truth's stamps by interpolation between two epochs that are at most
``MAX_GAP_S`` apart; nothing is extrapolated. A figure that cannot be computed is NaN inside this
module and absent from the dictionaries that it returns.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.consistency import inside_sigma, position_nees
from track_localization.evaluation.interpolation import at_times, speed_of, tangent_of

Array = NDArray[np.float64]

MOVING_MPS = 0.5
"""Truth slower than this is standstill, which no figure counts [m/s]."""

GROSS_M = 10.0
"""An error beyond this is a gross mismatch: a wrong part of the track [m]."""


@dataclasses.dataclass(frozen=True)
class RideErrors:
    """
    Errors over the moving part of a ride, one row per truth epoch that the estimate covers.

    Attributes:
        time_s: (M,) stamps [s].
        chainage: (M,) distance along the track, from the truth [m].
        vector: (M, 3) estimate minus truth, in ``map`` [m].
        along: (M,) its part along the truth's tangent, positive ahead [m].
        cross: (M,) length of the rest [m].
        speed: (M,) estimated minus true speed [m/s].
        covariance: (M, 3, 3) claimed for the position [m^2]; NaN where none is.
        sigma_along: (M,) claimed along the track [m]; NaN where none is.
        covered: share of the moving truth epochs that have an estimate, 0..1.
    """

    time_s: Array
    chainage: Array
    vector: Array
    along: Array
    cross: Array
    speed: Array
    covariance: Array
    sigma_along: Array
    covered: float

    @property
    def distance(self) -> Array:
        """Lengths of the error vectors, (M,) [m]."""
        length: Array = np.linalg.norm(self.vector, axis=1)
        return length


@dataclasses.dataclass(frozen=True)
class MarkerErrors:
    """
    Distances at the markers that the estimate covers (K,) [m]; NaN where it does not.

    Attributes:
        design: estimate to the marker's design position.
        truth: estimate to the true position at the marker's time.
    """

    design: Array
    truth: Array


def moving(truth: Trajectory) -> NDArray[np.bool_]:
    """Return a mask (N,) of the epochs at which the truth is faster than ``MOVING_MPS``."""
    mask: NDArray[np.bool_] = speed_of(truth) > MOVING_MPS
    return mask


def ride_errors(estimate: Trajectory, truth: Trajectory) -> RideErrors:
    """Compare ``estimate`` with ``truth`` over the moving part of the ride."""
    mask = moving(truth)
    tangent = tangent_of(truth)[mask]
    chainage = travelled(truth)[mask]
    speed = speed_of(truth)[mask]
    part = truth[mask]
    there = at_times(estimate, part.time_s)
    vector = there.position - part.position
    along = np.einsum('ij,ij->i', vector, tangent)
    cross = np.linalg.norm(vector - along[:, None] * tangent, axis=1)
    nothing = np.full(len(part), np.nan)
    covariance = (
        there.covariance if there.covariance is not None else np.full((len(part), 3, 3), np.nan)
    )
    if there.sigma_along is not None:
        sigma = there.sigma_along
    else:
        variance = np.einsum('ij,ijk,ik->i', tangent, covariance, tangent)
        sigma = np.sqrt(np.where(variance >= 0.0, variance, np.nan))
    has = np.isfinite(vector[:, 0])
    return RideErrors(
        time_s=part.time_s[has],
        chainage=chainage[has],
        vector=vector[has],
        along=along[has],
        cross=cross[has],
        speed=((there.speed if there.speed is not None else nothing) - speed)[has],
        covariance=covariance[has],
        sigma_along=sigma[has],
        covered=float(has.mean()) if len(has) else float('nan'),
    )


def marker_errors(
    estimate: Trajectory, time_s: Array, design: Array, truth: Trajectory | None = None
) -> MarkerErrors:
    """
    Return the errors at markers passed at ``time_s`` (K,) and designed to stand at (K, 3).

    Without ``truth`` the errors against it are NaN.
    """
    there = at_times(estimate, time_s).position
    true = at_times(truth, time_s).position if truth is not None else np.full_like(design, np.nan)
    return MarkerErrors(
        design=np.linalg.norm(there - design, axis=1), truth=np.linalg.norm(there - true, axis=1)
    )


def travelled(truth: Trajectory) -> Array:
    """Return the truth's chainage (N,) [m], or the distance it travelled where it has none."""
    if truth.chainage is not None:
        return truth.chainage
    steps = np.linalg.norm(np.diff(truth.position, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def summary(values: Array) -> dict[str, float]:
    """Return mean, median, p95 and max of the finite magnitudes; empty when there is none."""
    magnitude = np.abs(values[np.isfinite(values)])
    if not len(magnitude):
        return {}
    return {
        'mean': float(magnitude.mean()),
        'median': float(np.median(magnitude)),
        'p95': float(np.percentile(magnitude, 95.0)),
        'max': float(magnitude.max()),
    }


def ride_figures(errors: RideErrors) -> dict[str, Any]:
    """Return the figures of metrics.json that need a truth."""
    nees = position_nees(errors.vector, errors.covariance)
    nees_mean = float(np.mean(nees[np.isfinite(nees)])) if np.isfinite(nees).any() else np.nan
    gross = errors.distance > GROSS_M
    return present(
        {
            'position_m': summary(errors.distance),
            'along_m': summary(errors.along),
            'cross_m': summary(errors.cross),
            'speed_mps': summary(errors.speed),
            'inside_2_sigma': inside_sigma(errors.along, errors.sigma_along, 2.0),
            'nees_mean': nees_mean,
            'nees_position_over_3': nees_mean / 3.0,
            'gross_share': float(gross.mean()) if len(gross) else np.nan,
            'gross_inside_3_sigma': inside_sigma(
                errors.distance[gross], errors.sigma_along[gross], 3.0
            ),
            'covered': errors.covered,
        }
    )


def marker_figures(errors: MarkerErrors, floor: MarkerErrors | None = None) -> dict[str, Any]:
    """Return the figures of metrics.json at markers; ``floor`` is that of the design line."""
    figures = {'markers_m': summary(errors.design), 'markers_truth_m': summary(errors.truth)}
    if floor is not None:
        figures['markers_floor_m'] = summary(floor.design)
    return present(figures)


def present(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``figures`` without what is NaN, infinite, None or empty, at every depth."""
    kept: dict[str, Any] = {}
    for name, value in figures.items():
        inner = present(value) if isinstance(value, Mapping) else value
        if inner is None or (isinstance(inner, dict) and not inner):
            continue
        if isinstance(inner, float) and not np.isfinite(inner):
            continue
        kept[name] = inner
    return kept

"""
Figures of a vehicle on a known line, whose place is one number: its chainage.

Errors are taken at the estimate's own epochs, against the truth between its stamps: an estimate
once a second says nothing about the half second between, where a straight line would be off by
a T^2 / 8.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import MAX_GAP_S, at_times, speed_of
from track_localization.evaluation.metrics import (
    MOVING_MPS,
    RideErrors,
    moving,
    present,
    ride_errors,
    ride_figures,
    summary,
)

Array = NDArray[np.float64]


def epoch_errors(estimate: Trajectory, truth: Trajectory) -> RideErrors:
    """
    Compare an estimate with the truth at the estimate's epochs while the vehicle moves.

    ``covered`` is the share of the moving truth that lies between two epochs of the estimate that
    are near each other.
    """
    there = at_times(truth, estimate.time_s)
    errors = ride_errors(estimate, there)
    return dataclasses.replace(errors, covered=_covered(estimate, truth))


def standing_errors(estimate: Trajectory, truth: Trajectory) -> Array:
    """Return the errors of the chainage (K,) [m] at the epochs at which the vehicle stands."""
    there = at_times(truth, estimate.time_s)
    if there.chainage is None or estimate.chainage is None:
        return np.empty(0)
    with np.errstate(invalid='ignore'):
        stands = speed_of(there) <= MOVING_MPS
    error: Array = (estimate.chainage - there.chainage)[stands]
    return error


def since(errors: RideErrors, time_s: float) -> RideErrors:
    """Return the errors from a time [s] on; the covered share is that of the whole ride."""
    mask = errors.time_s >= time_s
    parts = {
        f.name: getattr(errors, f.name)[mask]
        for f in dataclasses.fields(errors)
        if f.name != 'covered'
    }
    return dataclasses.replace(errors, **parts)


def line_figures(errors: RideErrors) -> dict[str, Any]:
    """
    Return the figures of metrics.json for a vehicle on a line.

    Those of ``ride_figures``, with ``rmse`` beside the mean. NEES has one degree of freedom:
    (error along the line / sigma)^2, 1 on average when sigma is honest.
    """
    figures = ride_figures(errors)
    for name in ('cross_m', 'nees_position_over_3'):
        figures.pop(name, None)
    for name, values in (
        ('position_m', errors.distance),
        ('along_m', errors.along),
        ('speed_mps', errors.speed),
    ):
        if name in figures:
            figures[name] = spread(values)
    nees = nees_along(errors)
    figures['nees_mean'] = float(nees.mean()) if len(nees) else float('nan')
    return present(figures)


def nees_along(errors: RideErrors) -> Array:
    """Return (error / sigma)^2 along the line where both are known and sigma is positive."""
    known = np.isfinite(errors.along) & (errors.sigma_along > 0.0)
    nees: Array = (errors.along[known] / errors.sigma_along[known]) ** 2
    return nees


def spread(values: Array) -> dict[str, float]:
    """Return ``summary`` with the root mean square as ``rmse``; empty when nothing is finite."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return {}
    return {'rmse': float(np.sqrt(np.mean(finite**2))), **summary(finite)}


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

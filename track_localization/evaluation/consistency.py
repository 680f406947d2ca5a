"""Whether an estimator's covariance tells the truth: NEES, its chi-square bounds, coverage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]


def position_nees(error: Array, covariance: Array) -> Array:
    """
    Return e' P^-1 e for each row, (N,): 3 on average when P is honest.

    Args:
        error: (N, 3) [m].
        covariance: (N, 3, 3) [m^2]. Rows that are not finite, or not positive definite to
            working precision, give NaN.
    """
    nees = np.full(len(error), np.nan)
    finite = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
    rows = np.flatnonzero(finite)
    if not len(rows):
        return nees
    P = 0.5 * (covariance[rows] + np.swapaxes(covariance[rows], 1, 2))
    eigenvalues = np.linalg.eigvalsh(P)
    regular = eigenvalues[:, 0] > 1e-12 * np.maximum(eigenvalues[:, -1], 1e-300)
    rows, P = rows[regular], P[regular]
    nees[rows] = np.einsum(
        'ij,ij->i', error[rows], np.linalg.solve(P, error[rows, :, None])[..., 0]
    )
    return nees


def mean_nees_bounds(dimension: int, count: int, confidence: float = 0.95) -> tuple[float, float]:
    """
    Return the interval in which the mean of ``count`` independent NEES values should lie.

    Divided by ``dimension``, so that 1 is ideal. Epochs of one ride are correlated: count rides.
    """
    tail = 0.5 * (1.0 - confidence)
    low, high = chi2.ppf([tail, 1.0 - tail], dimension * count) / (dimension * count)
    return float(low), float(high)


def inside_sigma(error: Array, sigma: Array, factor: float) -> float:
    """
    Return the share of errors with |e| <= factor * sigma; NaN when no row has both.

    A scalar Gaussian gives 0.954 at factor 2.
    """
    known = np.isfinite(error) & np.isfinite(sigma)
    if not known.any():
        return float('nan')
    return float(np.mean(np.abs(error[known]) <= factor * sigma[known]))

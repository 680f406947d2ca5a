"""
Federated filtering: information shared among local filters, fused by a master, faults isolated.

Carlson's scheme. A global estimate (X, P) with process noise Q is shared as (X, P / beta_i) and
Q / beta_i with shares beta_i that sum to one. Each local filter predicts and corrects on its own;
the master adds their information. With a fusion between any correction and the next prediction,
linear local filters lose nothing: the fused estimate is that of one filter with all measurements.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, ncx2

from track_localization.estimation.cholesky import inverse

Array = NDArray[np.float64]


def share(mean: Array, P: Array, beta: float) -> tuple[Array, Array]:
    """
    Return a local filter's start from the global estimate: (D,) and (D, D) divided by its share.

    Its process noise is the global one divided by the share too: ``share_noise``.
    """
    _check_share(beta)
    return np.array(mean, float), np.asarray(P, float) / beta


def share_noise(Q: Array, beta: float) -> Array:
    """Return a local filter's process noise (D, D): what all of them know together is then Q."""
    _check_share(beta)
    return np.asarray(Q, float) / beta


def fuse(
    means: Sequence[Array] | Array, covariances: Sequence[Array] | Array
) -> tuple[Array, Array]:
    """
    Return the mean (D,) and covariance (D, D) of all local estimates' information together.

    P = (sum P_i^-1)^-1, X = P sum P_i^-1 X_i for any number of locals, (K, D) and (K, D, D).
    Raise ValueError where a covariance is not positive definite.
    """
    all_means = np.ascontiguousarray(means, float)
    mean, P, regular = fuse_information(all_means, np.ascontiguousarray(covariances, float))
    if not regular:
        raise ValueError('fuse: a covariance is not positive definite')
    return mean, P


@numba.njit(cache=True)
def fuse_information(means: Array, covariances: Array) -> tuple[Array, Array, bool]:
    """
    Return mean, covariance, and whether all of ``covariances`` (K, D, D) are positive definite.

    States are scaled by their least standard deviation, and means are taken from the first one, so
    that neither units nor a large chainage costs digits.
    """
    count, states = means.shape
    scale = np.empty(states)
    for i in range(states):
        scale[i] = np.sqrt(max(covariances[:, i, i].min(), 1e-300))
    information = np.zeros((states, states))
    vector = np.zeros(states)
    for k in range(count):
        scaled = np.empty((states, states))
        for i in range(states):
            for j in range(states):
                both = covariances[k, i, j] + covariances[k, j, i]
                scaled[i, j] = 0.5 * both / (scale[i] * scale[j])
        W, regular = inverse(scaled)
        if not regular:
            return means[0].copy(), covariances[0].copy(), False
        for i in range(states):
            for j in range(states):
                information[i, j] += W[i, j]
                vector[i] += W[i, j] * (means[k, j] - means[0, j]) / scale[j]
    P, regular = inverse(information)
    mean = means[0].copy()
    for i in range(states):
        for j in range(states):
            mean[i] += scale[i] * P[i, j] * vector[j]
    for i in range(states):
        for j in range(states):
            P[i, j] *= scale[i] * scale[j]
    return mean, P, regular


@dataclasses.dataclass(frozen=True)
class Verdict:
    """
    What the comparison of every local estimate with the others' fusion says.

    Attributes:
        distance: (K,) squared Mahalanobis distance of each; chi-square of D when none is at fault.
        gate: what a distance may be.
        faulty: the one that does not agree with the others; None when all agree.
        ambiguous: two estimates disagree and no third tells which is wrong; ``faulty`` is None.
    """

    distance: Array
    gate: float
    faulty: int | None
    ambiguous: bool


def disagreement(mean: Array, P: Array, others_mean: Array, others_P: Array) -> float:
    """
    Return the squared Mahalanobis distance of a local estimate from the fusion of the others.

    Chi-square of D where their errors are independent. Estimates that share a prediction, as
    between a feedback and the next fusion, agree better than that: the test is then careful.
    """
    d = np.asarray(mean, float) - np.asarray(others_mean, float)
    S = np.asarray(P, float) + np.asarray(others_P, float)
    return float(d @ np.linalg.solve(S, d))


def isolate(
    means: Sequence[Array] | Array, covariances: Sequence[Array] | Array, false_alarm: float = 1e-3
) -> Verdict:
    """
    Find the local estimate that disagrees with the fusion of all others.

    ``false_alarm`` is the most probability that sound estimates raise an alarm at all; the K tests
    share it. Give the master's own prediction as one more estimate where only two locals are.
    """
    count, states = np.shape(means)
    if count < 2:
        raise ValueError('isolate: needs two estimates at least')
    distance = np.empty(count)
    for k in range(count):
        others = [i for i in range(count) if i != k]
        others_mean, others_P = fuse([means[i] for i in others], [covariances[i] for i in others])
        distance[k] = disagreement(means[k], covariances[k], others_mean, others_P)
    # Two estimates make one test, not two.
    gate = float(chi2.isf(false_alarm / (count if count > 2 else 1), states))
    worst = int(np.argmax(distance))
    alarm = bool(distance[worst] > gate)
    return Verdict(distance, gate, worst if alarm and count > 2 else None, alarm and count == 2)


def detection_probability(bias: Array, P: Array, others_P: Array, gate: float) -> float:
    """Return the probability that a local's ``bias`` (D,) lifts its distance above ``gate``."""
    b = np.asarray(bias, float)
    strength = float(b @ np.linalg.solve(np.asarray(P, float) + np.asarray(others_P, float), b))
    return float(ncx2.sf(gate, len(b), strength))


def redistribute(shares: Sequence[float] | Array, isolated: Sequence[int]) -> Array:
    """
    Return shares (K,) that sum to one with none left to the isolated locals.

    Raise ValueError when no local with a share is left.
    """
    left = np.array(shares, float)
    left[list(isolated)] = 0.0
    total = float(left.sum())
    if not total > 0.0:
        raise ValueError('redistribute: no local filter is left to carry the information')
    return left / total


def _check_share(beta: float) -> None:
    if not 0.0 < beta <= 1.0:
        raise ValueError(f'share {beta} is not in (0, 1]')

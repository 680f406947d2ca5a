"""Loops over particles of the paper's filter, compiled; a cloud is (3, N), all clouds (2, 3, N)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.cholesky import lower_inverse, lower_root

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NOTHING, MEAN, ALL = 0, 1, 2
"""What the master gives back."""

FREE = {'reassoc', 'contract', 'nsz'}
"""Sums over particles may be taken in any order, so that they run in parallel lanes."""


@numba.njit(cache=True)
def advance(
    clouds: Array,
    w: Array,
    means: Array,
    covariances: Array,
    mean: Array,
    P: Array,
    shares: Array,
    given: int,
    T: float,
    variance: float,
    rng: np.random.Generator,
) -> bool:
    """
    Give the master's ``mean`` and ``P`` back to all clouds, carry them and it over T; in place.

    A particle x becomes F (mean + A (x - its cloud's mean)) + G W, eqs (3) and (8), where A turns
    its cloud's covariance into P / share, and W is a jerk of its own, its variance also divided by
    the share. ``given`` is what the master gives: NOTHING, MEAN (A is the identity) or ALL.
    ``means`` (2, 3) and ``covariances`` (2, 3, 3) follow. Return False, nothing done, where a
    covariance is singular.
    """
    count = clouds.shape[2]
    A = np.zeros_like(covariances)
    for i in range(len(clouds)):
        A[i] = np.eye(3)
        if given == ALL:
            L_now, regular_now = lower_root(covariances[i])
            L, regular = lower_root(P / shares[i])
            if not (regular and regular_now):
                return False
            A[i] = L @ lower_inverse(L_now)
    F = np.array([[1.0, T, 0.5 * T * T], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    G = np.array([T**3 / 6.0, 0.5 * T * T, T])
    jerk = np.zeros(count)
    for i in range(len(clouds)):
        if T > 0.0:
            sigma = np.sqrt(variance / shares[i])
            for n in range(count):
                jerk[n] = sigma * rng.standard_normal()
        after = F @ (means[i] if given == NOTHING else mean)
        transform(clouds[i], means[i], F @ A[i], after, G, jerk)
        measure(clouds[i], w[i], after, means[i], covariances[i])
    mean[:] = F @ mean
    P[:, :] = F @ P @ F.T + variance * np.outer(G, G)
    return True


@numba.njit(cache=True, fastmath=FREE)
def transform(cloud: Array, now: Array, A: Array, after: Array, G: Array, jerk: Array) -> None:
    """Make every particle ``after + A (x - now) + G W`` in place; jerks W (N,)."""
    for n in range(cloud.shape[1]):
        p, v, a = cloud[0, n] - now[0], cloud[1, n] - now[1], cloud[2, n] - now[2]
        cloud[0, n] = after[0] + A[0, 0] * p + A[0, 1] * v + A[0, 2] * a + G[0] * jerk[n]
        cloud[1, n] = after[1] + A[1, 0] * p + A[1, 1] * v + A[1, 2] * a + G[1] * jerk[n]
        cloud[2, n] = after[2] + A[2, 0] * p + A[2, 1] * v + A[2, 2] * a + G[2] * jerk[n]


@numba.njit(cache=True, fastmath=FREE)
def measure(cloud: Array, w: Array, near: Array, mean: Array, P: Array) -> tuple[float, float]:
    """
    Put mean (3,) and covariance (3, 3) under weights (N,) of any sum in ``mean`` and ``P``.

    ``near`` (3,) is a point near the mean: one pass costs no digits then. Return the weights' sum
    and the sum of their squares; all is zero when the weights are.
    """
    total = squares = 0.0
    p = v = a = pp = pv = pa = vv = va = aa = 0.0
    for n in range(len(w)):
        x, y, z = cloud[0, n] - near[0], cloud[1, n] - near[1], cloud[2, n] - near[2]
        wx, wy, wz = w[n] * x, w[n] * y, w[n] * z
        total += w[n]
        squares += w[n] * w[n]
        p += wx
        v += wy
        a += wz
        pp += wx * x
        pv += wx * y
        pa += wx * z
        vv += wy * y
        va += wy * z
        aa += wz * z
    if total <= 0.0:
        return 0.0, 0.0
    off = np.array([p, v, a]) / total
    square = np.array([[pp, pv, pa], [pv, vv, va], [pa, va, aa]]) / total
    for i in range(3):
        mean[i] = near[i] + off[i]
        for j in range(3):
            P[i, j] = square[i, j] - off[i] * off[j]
    return total, squares


@numba.njit(cache=True, fastmath=FREE)
def weigh(x: Array, log_w: Array, z: float, variance: float, out: Array) -> None:
    """Put log weights (N,) plus the log likelihood of ``z`` measuring ``x`` (N,) in ``out``."""
    scale = -0.5 / variance
    for n in range(len(x)):
        out[n] = log_w[n] + scale * (x[n] - z) * (x[n] - z)


@numba.njit(cache=True, fastmath=FREE)
def settle(log_w: Array, w: Array, total: float, log_out: Array, w_out: Array) -> None:
    """Copy log weights and weights (N,), whose sum is ``total``, normalised."""
    share, shift = 1.0 / total, np.log(total)
    for n in range(len(w)):
        w_out[n] = share * w[n]
        log_out[n] = log_w[n] - shift


@numba.njit(cache=True)
def pick(cloud: Array, indices: Indices, near: Array, out: Array) -> tuple[Array, Array, bool]:
    """
    Copy the particles drawn to ``out`` (3, N).

    Return their mean (3,) and covariance (3, 3), and whether that is positive definite. ``near``
    (3,) is a point near the mean.
    """
    count = len(indices)
    for i in range(len(cloud)):
        for n in range(count):
            out[i, n] = cloud[i, indices[n]]
    mean, P = np.empty(3), np.empty((3, 3))
    measure(out, np.full(count, 1.0 / count), near, mean, P)
    return mean, P, lower_root(P)[1]

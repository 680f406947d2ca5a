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

LEAST_EFFECTIVE = 20.0
"""Fewer effective particles do not tell a mean and covariance of three states."""

WITHIN = 9.0
"""
Squared innovation over its variance up to which particles tell the posterior.

A cloud has no particles to speak of beyond three sigma. One that is pulled there time after time
narrows, and follows less and less: what the model allows once in 370 measurements.
"""

FREE = {'reassoc', 'contract', 'nsz'}
"""Sums over particles may be taken in any order, so that they run in parallel lanes."""


@numba.njit(cache=True)
def times(A: Array, B: Array) -> Array:
    """Return A B (3, 3), sooner than a library is called."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += A[i, k] * B[k, j]
    return out


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
    noise: Array,
) -> bool:
    """
    Give the master's ``mean`` and ``P`` back to all clouds, carry them and it over T; in place.

    A particle x becomes F (mean + A (x - its cloud's mean)) + G W, eqs (3) and (8). A turns its
    cloud's covariance into P / share; its jerk W, from ``noise`` (2, N) of standard normal numbers,
    has the ``variance`` divided by the share too. ``given`` is what the master gives: NOTHING, MEAN
    (A is the identity) or ALL. ``means`` (2, 3) and ``covariances`` (2, 3, 3) follow. Return False,
    nothing done, where a covariance is singular.
    """
    A = np.zeros((2, 3, 3))
    for i in range(2):
        A[i, 0, 0] = A[i, 1, 1] = A[i, 2, 2] = 1.0
        if given == ALL:
            L_now, regular_now = lower_root(covariances[i])
            L, regular = lower_root(P / shares[i])
            if not (regular and regular_now):
                return False
            A[i] = times(L, lower_inverse(L_now))
    half, sixth = 0.5 * T * T, T**3 / 6.0
    F = np.array([[1.0, T, half], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    reach = np.sqrt(variance) * np.array([sixth, half, T])
    after = np.empty(3)
    for i in range(2):
        start = means[i] if given == NOTHING else mean
        after[0] = start[0] + T * start[1] + half * start[2]
        after[1] = start[1] + T * start[2]
        after[2] = start[2]
        wider = 1.0 / np.sqrt(shares[i])
        transform(clouds[i], means[i], times(F, A[i]), after, reach * wider, noise[i])
        measure(clouds[i], w[i], after, means[i], covariances[i])
    mean[0] += T * mean[1] + half * mean[2]
    mean[1] += T * mean[2]
    P[:, :] = times(times(F, P), F.T) + np.outer(reach, reach)
    return True


@numba.njit(cache=True, fastmath=FREE)
def transform(cloud: Array, now: Array, A: Array, after: Array, reach: Array, noise: Array) -> None:
    """Make every particle ``after + A (x - now) + reach w`` in place; noise w (N,)."""
    for n in range(cloud.shape[1]):
        p, v, a = cloud[0, n] - now[0], cloud[1, n] - now[1], cloud[2, n] - now[2]
        cloud[0, n] = after[0] + A[0, 0] * p + A[0, 1] * v + A[0, 2] * a + reach[0] * noise[n]
        cloud[1, n] = after[1] + A[1, 0] * p + A[1, 1] * v + A[1, 2] * a + reach[1] * noise[n]
        cloud[2, n] = after[2] + A[2, 0] * p + A[2, 1] * v + A[2, 2] * a + reach[2] * noise[n]


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
def weigh(
    clouds: Array,
    log_w: Array,
    means: Array,
    covariances: Array,
    local: int,
    z: float,
    variance: float,
    out: Array,
) -> bool:
    """
    Put log weights plus the log likelihood of ``z`` in ``out`` (N,): a cloud's own measurement.

    Return False, nothing done, where ``z`` is too far from the cloud; see WITHIN.
    """
    nu, S = z - means[local, local], covariances[local, local, local] + variance
    if nu * nu > WITHIN * S:
        return False
    x, before, scale = clouds[local, local], log_w[local], -0.5 / variance
    for n in range(len(x)):
        out[n] = before[n] + scale * (x[n] - z) * (x[n] - z)
    return True


@numba.njit(cache=True, fastmath=FREE)
def settle(
    clouds: Array,
    log_w: Array,
    w: Array,
    means: Array,
    covariances: Array,
    local: int,
    new_log_w: Array,
    new_w: Array,
) -> float:
    """
    Give a cloud new weights (N,), of any sum, normalised; its moments follow. Return N_eff.

    Nothing is done where that is below LEAST_EFFECTIVE.
    """
    mean, P = np.empty(3), np.empty((3, 3))
    total, squares = measure(clouds[local], new_w, means[local], mean, P)
    n_eff = total * total / squares if squares > 0.0 else 0.0
    if n_eff < LEAST_EFFECTIVE:
        return n_eff
    means[local], covariances[local] = mean, P
    own, own_log = w[local], log_w[local]
    share, shift = 1.0 / total, np.log(total)
    for n in range(len(new_w)):
        own[n] = share * new_w[n]
        own_log[n] = new_log_w[n] - shift
    return n_eff


@numba.njit(cache=True)
def draw(
    clouds: Array,
    log_w: Array,
    w: Array,
    means: Array,
    covariances: Array,
    local: int,
    indices: Indices,
    spare: Array,
) -> None:
    """
    Let a cloud be the particles drawn, of equal weight; its moments follow.

    Nothing is done where too few different ones were drawn. ``spare`` (3, N) is overwritten.
    """
    cloud, count = clouds[local], len(indices)
    for i in range(3):
        for n in range(count):
            spare[i, n] = cloud[i, indices[n]]
    mean, P = np.empty(3), np.empty((3, 3))
    equal = np.full(count, 1.0 / count)
    measure(spare, equal, means[local], mean, P)
    if lower_root(P)[1]:
        means[local], covariances[local] = mean, P
        cloud[:, :] = spare
        w[local, :] = equal
        log_w[local, :] = -np.log(count)

"""
Weighted particle sets: the steps that every particle filter here shares.

Particles are rows, (N, D). Bayes' rule works on natural logarithms of weights, ``log_w``; draws and
moments on the weights ``w = exp(log_w)`` themselves, which sum to one. Every random draw takes the
caller's Generator, so a run is repeatable from its seed. Loops over particles are fastest where a
state lies in one piece of memory: in the transpose of a (D, N) array.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.cholesky import lower_inverse, lower_root

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Normals:
    """
    Standard normal numbers of a Generator, drawn in blocks.

    Compiled draws cost a third of numpy's, but handing the Generator over costs as much as two
    thousand of them.
    """

    BLOCK = 16384

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._drawn = np.empty(0)
        self._used = 0

    def take(self, count: int) -> Array:
        """Return the next ``count`` numbers; the array is good until the next call."""
        if self._used + count > len(self._drawn):
            if len(self._drawn) < count:
                self._drawn = np.empty(max(count, self.BLOCK))
            _fill(self._rng, self._drawn)
            self._used = 0
        self._used += count
        return self._drawn[self._used - count : self._used]


def equal_weights(count: int) -> Array:
    """Return the logarithms (count,) of equal weights."""
    return np.full(count, -np.log(count))


def reweight(log_w: Array, log_likelihood: Array) -> Array:
    """
    Apply Bayes' rule: multiply by a likelihood, then normalise.

    Raise ValueError when no particle explains the measurement; the caller decides whether to skip
    it or to draw the particles anew.
    """
    posterior = log_w + log_likelihood
    peak = float(posterior.max())
    if not np.isfinite(peak):
        raise ValueError('measurement has no likelihood under any particle')
    posterior -= peak
    posterior -= np.log(np.exp(posterior).sum())
    return posterior


def effective_sample_size(log_w: Array) -> float:
    """Return N_eff = 1 / sum(w**2): 1 if degenerate, len(log_w) if uniform."""
    w = np.exp(log_w)
    return float(1.0 / np.dot(w, w))


def systematic(w: Array, rng: np.random.Generator, count: int | None = None) -> Indices:
    """Return drawn indices (count,), ascending: one uniform number, evenly spaced from there."""
    count = len(w) if count is None else count
    return _one_each(rng.random(1), w, count)


def stratified(w: Array, rng: np.random.Generator, count: int | None = None) -> Indices:
    """Return drawn indices (count,), ascending: a uniform number in each of ``count`` strata."""
    count = len(w) if count is None else count
    return _one_each(rng.random(count), w, count)


def multinomial(w: Array, rng: np.random.Generator, count: int | None = None) -> Indices:
    """Return drawn indices (count,), ascending: independent draws, ordered."""
    count = len(w) if count is None else count
    return _inverse_cdf(_ordered_uniforms(count, rng), _checked(w))


def residual(w: Array, rng: np.random.Generator, count: int | None = None) -> Indices:
    """Return drawn indices (count,): floor(count * w) copies each, the rest multinomially."""
    count = len(w) if count is None else count
    expected = count * _checked(w)
    copies = np.floor(expected)
    rest = count - int(copies.sum())
    kept = np.repeat(np.arange(len(w)), copies.astype(np.int64))
    if rest <= 0:
        return kept[:count]
    left = expected - copies
    drawn = _inverse_cdf(_ordered_uniforms(rest, rng), left / left.sum())
    return np.concatenate([kept, drawn])


Resampling = Callable[[Array, np.random.Generator], Indices]

RESAMPLING: Mapping[str, Resampling] = {
    'systematic': systematic,
    'stratified': stratified,
    'residual': residual,
    'multinomial': multinomial,
}
"""Schemes by name; all unbiased: particle i is drawn ``count * w[i]`` times on average."""


def roughen(particles: Array, rng: np.random.Generator, constant: float = 0.2) -> Array:
    """
    Return resampled particles with independent jitter (Gordon, Salmond, Smith 1993).

    Its standard deviation is ``constant * E * N**(-1/D)`` in each state, E the state's range.
    """
    count, states = particles.shape
    sigma = constant * np.ptp(particles, axis=0) * count ** (-1.0 / states)
    return particles + sigma * rng.standard_normal((count, states))


def affine_map(particles: Array, w: Array, mean: Array, P: Array) -> Array:
    """
    Return particles (N, D) moved so that their weighted mean and covariance are ``mean`` and ``P``.

    The map is the lower triangular one, x -> mean + L L_now^-1 (x - m_now). Raise ValueError when
    ``P`` or the particles' own covariance is not positive definite.
    """
    now, P_now = moments(particles, w)
    out = np.array(particles, order='F')
    if not move(out, now, P_now, np.asarray(mean, float), np.asarray(P, float)):
        raise ValueError('affine map: a covariance is not positive definite')
    return out


@numba.njit(cache=True, fastmath={'reassoc', 'contract', 'nsz'})
def moments(particles: Array, w: Array) -> tuple[Array, Array]:
    """Return the mean (D,) and covariance (D, D) under weights (N,) that sum to one."""
    count, states = particles.shape
    mean = np.empty(states)
    P = np.empty((states, states))
    for i in range(states):
        total = 0.0
        for n in range(count):
            total += w[n] * particles[n, i]
        mean[i] = total
    for i in range(states):
        for j in range(i + 1):
            total = 0.0
            for n in range(count):
                total += w[n] * (particles[n, i] - mean[i]) * (particles[n, j] - mean[j])
            P[i, j] = total
            P[j, i] = total
    return mean, P


@numba.njit(cache=True)
def move(particles: Array, now: Array, P_now: Array, mean: Array, P: Array) -> bool:
    """Move particles (N, D) in place from mean and covariance to others; False: not possible."""
    count, states = particles.shape
    L_now, regular_now = lower_root(P_now)
    L, regular = lower_root(P)
    if not (regular_now and regular):
        return False
    A = L @ lower_inverse(L_now)
    # The last state first: it needs those before it as they were.
    for i in range(states - 1, -1, -1):
        for n in range(count):
            particles[n, i] = mean[i] + A[i, i] * (particles[n, i] - now[i])
        for j in range(i):
            for n in range(count):
                particles[n, i] += A[i, j] * (particles[n, j] - now[j])
    return True


@numba.njit(cache=True)
def _fill(rng: np.random.Generator, out: Array) -> None:
    for n in range(len(out)):
        out[n] = rng.standard_normal()


@numba.njit(cache=True)
def _checked(w: Array) -> Array:
    """Return weights that sum to one to rounding; raise ValueError where they do not at all."""
    total, least = 0.0, 0.0
    for n in range(len(w)):
        total += w[n]
        least = min(least, w[n])
    if not (abs(total - 1.0) < 1e-6 and least == 0.0):
        raise ValueError('weights must not be negative and sum to one; normalise them first')
    return w


@numba.njit(cache=True)
def _one_each(jitter: Array, w: Array, count: int) -> Indices:
    """Draw one index in each of ``count`` strata; ``jitter`` in [0, 1) of each, or one for all."""
    # Two indices are written whether they are wanted or not, and overwritten if not: a branch on
    # how often a particle is drawn could not be predicted.
    _checked(w)
    out = np.empty(count + 2, np.int64)
    alone = len(jitter) == 1
    reached, begin = 0.0, 0
    for index in range(len(w)):
        reached += w[index] * count
        whole = min(int(reached), count - 1)
        end = whole + int(reached - whole > jitter[0 if alone else whole])
        out[begin] = index
        out[begin + 1] = index
        for n in range(begin + 2, end):
            out[n] = index
        begin = end
    # Rounding may leave the last strata out.
    out[begin:count] = _last(w)
    return out[:count]


@numba.njit(cache=True)
def _last(w: Array) -> int:
    """Return the last index with a weight: rounding must not draw those beyond."""
    last = len(w) - 1
    while last > 0 and w[last] == 0.0:
        last -= 1
    return last


@numba.njit(cache=True)
def _inverse_cdf(u: Array, w: Array) -> Indices:
    """Return for each of the ascending ``u`` the index whose share of [0, 1) it lies in."""
    last = _last(w)
    out = np.empty(len(u), np.int64)
    index, reached = 0, w[0]
    for n in range(len(u)):
        while reached <= u[n] and index < last:
            index += 1
            reached += w[index]
        out[n] = index
    return out


def _ordered_uniforms(count: int, rng: np.random.Generator) -> Array:
    """Return ``count`` independent uniform numbers in ascending order."""
    gaps = np.cumsum(rng.standard_exponential(count + 1))
    return gaps[:-1] / gaps[-1]

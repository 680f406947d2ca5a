"""
A bank of weighted hypotheses: what the sensors may have done, each with its federated estimate.

This is a Rao-Blackwellised particle filter. A particle is one account of the discrete events
(crossings missed or counted twice, a radar that slips, whose balise was heard); given it the rest
is linear and Gaussian, and two local filters carry it, one fed by the loop and one by the radar.
Every event that a measurement allows makes a child. Children that say the same are merged, those
without weight are dropped, and if more than the greatest number are left they are resampled
(Fearnhead and Clifford, 2003, J. R. Statist. Soc. B 65: the likely ones are kept as they are, the
others drawn so that the weights stay unbiased).

A bank is (log_w (n,), x (n, 2, 6), P (n, 2, 6, 6)); index 0 is the loop's local filter. What makes
the children is in ``hearing`` and ``passing``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maglev_localization.line_kernels import SIZE, A, B, C, K, Noise, V, fuse, predict, recount

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARE = 0.5
"""Share of information of each local filter; with feedback of mean and covariance it cancels."""

LEAST = -14.0
"""Natural logarithm of the weight, against the heaviest, below which a hypothesis is dropped."""

NEAR_SIGMAS, NEAR_M = 5.0, 1.0
"""Hypotheses nearer than this to the heaviest are the same place."""
DOUBT = 0.01
"""Other places that weigh more open the covariance."""


@njit(cache=True)
def choose(log_w: Array, most: int, uniform: float) -> tuple[Ints, Array]:
    """
    Return which of the candidates stay, the heaviest first, and their normalised log weights.

    Those below ``LEAST`` go. Of the others at most ``most`` stay: weights above a threshold as
    they are, the rest drawn systematically from ``uniform`` in [0, 1) and given the threshold.
    """
    order = np.argsort(-log_w)
    top = log_w[order[0]]
    n = 0
    while n < len(order) and log_w[order[n]] > top + LEAST:
        n += 1
    kept = order[:n].copy()
    weight = np.exp(log_w[kept] - top)
    weight /= weight.sum()
    if n > most:
        rest, sure = weight.sum(), 0
        while sure < most and weight[sure] * (most - sure) > rest:
            rest -= weight[sure]
            sure += 1
        threshold = rest / (most - sure) if most > sure else 0.0
        m, level = sure, -uniform * threshold
        for i in range(sure, n):
            level += weight[i]
            if level > 0.0 and m < most:
                level -= threshold
                kept[m] = kept[i]
                weight[m] = threshold
                m += 1
        kept, weight = kept[:m], weight[:m] / weight[:m].sum()
    return kept, np.log(weight)


@njit(cache=True)
def merge(log_w: Array, x: Array, P: Array, closeness: float) -> tuple[Array, Array, Array]:
    """
    Merge hypotheses that say the same, by moments; the heaviest come first and stay.

    Two say the same when their counter offsets differ by less than ``closeness`` [m] or half a
    sigma, and so do their radar scales (half a sigma) and chainages (half a sigma).
    """
    n = len(log_w)
    into = np.full(n, -1, np.int64)
    count = 0
    for i in range(n):
        for j in range(i):
            if into[j] == j and _alike(x[i, 0], x[j, 0], P[j, 0], closeness):
                into[i] = j
                break
        if into[i] < 0:
            into[i] = i
            count += 1
    if count == n:
        return log_w, x, P
    new_w, new_x, new_P = (
        np.empty(count),
        np.empty((count, 2, SIZE)),
        np.empty((count, 2, SIZE, SIZE)),
    )
    place = 0
    for j in range(n):
        if into[j] != j:
            continue
        total = 0.0
        for i in range(j, n):
            if into[i] == j:
                total += math.exp(log_w[i] - log_w[j])
        new_w[place] = log_w[j] + math.log(total)
        for local in range(2):
            mean = np.zeros(SIZE)
            for i in range(j, n):
                if into[i] == j:
                    mean += math.exp(log_w[i] - log_w[j]) / total * (x[i, local] - x[j, local])
            spread = np.zeros((SIZE, SIZE))
            for i in range(j, n):
                if into[i] == j:
                    w = math.exp(log_w[i] - log_w[j]) / total
                    d = x[i, local] - x[j, local] - mean
                    for a in range(SIZE):
                        for b in range(SIZE):
                            spread[a, b] += w * (P[i, local, a, b] + d[a] * d[b] / SHARE)
            new_x[place, local] = x[j, local] + mean
            new_P[place, local] = spread
        place += 1
    return new_w, new_x, new_P


@njit(cache=True)
def _alike(one: Array, other: Array, P: Array, closeness: float) -> bool:
    offset = abs(one[B] - other[B])
    if offset > closeness and offset > 0.5 * math.sqrt(SHARE * P[B, B]):
        return False
    if abs(one[K] - other[K]) > 0.5 * math.sqrt(SHARE * P[K, K]):
        return False
    count = abs(one[C] - other[C])
    if count > closeness and count > 0.5 * math.sqrt(SHARE * P[C, C]):
        return False
    along = one[C] - one[B] - other[C] + other[B]
    variance = SHARE * (P[C, C] + P[B, B] - 2.0 * P[C, B])
    return abs(along) < max(0.5 * math.sqrt(max(variance, 0.0)), 0.25 * closeness)


@njit(cache=True)
def predict_local(x: Array, P: Array, local: int, dt: float, noise: Noise) -> None:
    """Move one local filter of every hypothesis on, in place."""
    for i in range(len(x)):
        predict(x[i, local], P[i, local], dt, noise, SHARE)


@njit(cache=True)
def federate(x: Array, P: Array) -> None:
    """Fuse the local estimates of every hypothesis and give the result back, in place."""
    work = np.empty((SIZE, 13))
    for i in range(len(x)):
        if not fuse(x[i], P[i], work):
            continue
        for a in range(SIZE):
            x[i, 1, a] = x[i, 0, a]
            for b in range(SIZE):
                P[i, 0, a, b] /= SHARE
                P[i, 1, a, b] = P[i, 0, a, b]


@njit(cache=True)
def begin_count(x: Array, P: Array, position: float, variance: float) -> None:
    """Let the counter begin anew in every hypothesis, federated: see ``recount``."""
    for i in range(len(x)):
        for local in range(2):
            recount(x[i, local], P[i, local], position, variance / SHARE)


@njit(cache=True)
def moments(log_w: Array, x: Array, P: Array) -> tuple[Array, Array, float]:
    """
    Return the likeliest place's mean (3,) and covariance (3, 3), and the weight of all others.

    Of chainage, speed and acceleration. Hypotheses near the heaviest are one place. A mean over
    places that exclude each other would be none of them; the covariance is that of all, about the
    mean, as soon as the others weigh more than ``DOUBT``.
    """
    n = len(log_w)
    T = np.zeros((3, SIZE))
    T[0, C], T[0, B], T[1, V], T[2, A] = 1.0, -1.0, 1.0, 1.0
    w, means, inside = np.exp(log_w), np.empty((n, 3)), np.empty((n, 3, 3))
    for i in range(n):
        means[i] = T @ x[i, 0]
        inside[i] = SHARE * (T @ P[i, 0] @ T.T)
    heaviest = np.argmax(w)
    reach = NEAR_SIGMAS * math.sqrt(inside[heaviest, 0, 0]) + NEAR_M
    near = np.abs(means[:, 0] - means[heaviest, 0]) < reach
    here = w[near].sum()
    mean = np.zeros(3)
    for i in range(n):
        if near[i]:
            mean += w[i] / here * means[i]
    everything = w.sum()
    elsewhere = 1.0 - here / everything
    covariance = np.zeros((3, 3))
    for i in range(n):
        if near[i] or elsewhere > DOUBT:
            share = w[i] / (everything if elsewhere > DOUBT else here)
            for a in range(3):
                for b in range(3):
                    apart = (means[i, a] - mean[a]) * (means[i, b] - mean[b])
                    covariance[a, b] += share * (inside[i, a, b] + apart)
    return mean, covariance, elsewhere

"""
A bank of weighted hypotheses: what the sensors may have done, each with its federated estimate.

This is a Rao-Blackwellised particle filter. A particle is one account of the discrete events
(crossings missed or counted twice, a radar that slips, whose balise was heard); given it the rest
is linear and Gaussian, and two local filters carry it, one fed by the loop and one by the radar.
Every event that a measurement allows makes a child. Children that say the same are merged, those
without weight are dropped, and if more than the greatest number are left they are resampled
(Fearnhead and Clifford, 2003, J. R. Statist. Soc. B 65: the likely ones are kept as they are, the
others drawn so that the weights stay unbiased).

A bank is (log_w (n,), x (n, 2, 6), P (n, 2, 6, 6)); index 0 is the loop's local filter.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maglev_localization.line_kernels import (
    SIZE,
    A,
    B,
    C,
    K,
    Noise,
    V,
    correct,
    fuse,
    jump,
    predict,
    project,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARE = 0.5
"""Share of information of each local filter; with feedback of mean and covariance it cancels."""

LEAST = -14.0
"""Natural logarithm of the weight, against the heaviest, below which a hypothesis is dropped."""

PLAIN, SHIFT, UNKNOWN, IGNORED, SLIP, NEARBY, MOVED = range(7)
"""What a child says of its measurement: as expected; the counter jumped by whole crossings, or by
an unknown distance; it means nothing; the radar's scale changed; another balise than it said; the
train is somewhere else than thought."""

LOG_TWO_PI = math.log(2.0 * math.pi)
SINGLES = 3
"""As many crossings may be missed one by one between two readings; more are a burst."""
JUMP_SIGMA_M = 60.0
"""Of a jump of the counter; a greater one has its own size for a sigma."""
DEPARTURE_MPS, DEPARTURE_MPS2, STOPPED_MPS2 = 0.5, 0.5, 0.3
NEAR_SIGMAS, NEAR_M = 5.0, 1.0
"""Hypotheses nearer than this to the heaviest are the same place."""
DOUBT = 0.01
"""Other places that weigh more open the covariance."""
RANGE_M, RANGE_MPS = 200.0, 20.0
"""How far readings that mean nothing may be off."""


@njit(cache=True)
def log_normal(nu: float, variance: float) -> float:
    """Return the logarithm of the normal density of an innovation."""
    return -0.5 * (nu * nu / variance + math.log(variance) + LOG_TWO_PI)


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
def shift(x: Array, P: Array, size: float, variance: float) -> None:
    """Let the counter jump in every hypothesis: by ``size`` [m], known to ``variance`` [m^2]."""
    for i in range(len(x)):
        for local in range(2):
            jump(x[i, local], P[i, local], size, variance / SHARE)


@njit(cache=True)
def hear_loop(
    log_w: Array,
    x: Array,
    P: Array,
    reading: float,
    R: float,
    pitch: float,
    missed: float,
    extra: float,
    burst: float,
    most: int,
    uniform: float,
) -> tuple[Array, Array, Array, float, int, float]:
    """
    Weigh a loop reading (of which ``R`` is the variance) and update the loop's local filters.

    Args:
        log_w: (n,) weights; ``x``, ``P``: the bank, predicted to the reading's stamp.
        reading: what the counter read, set to the middle of what that may mean [m].
        R: its variance [m^2].
        pitch: of the crossings [m]; 0 where jumps are not of whole crossings.
        missed: crossings expected to have been missed singly since the last reading.
        extra: crossings expected to have been counted twice.
        burst: probability of a jump of any other size.
        most: hypotheses to keep.
        uniform: a draw from [0, 1).

    Returns:
        The new bank, the NIS of the likeliest hypothesis, what it says of the reading, and how many
        crossings the bank thinks were missed singly.
    """
    n = len(log_w)
    each = 6
    weight, parent = np.empty(n * each), np.empty(n * each, np.int64)
    kind, steps = np.empty(n * each, np.int64), np.zeros(n * each, np.int64)
    m = 0
    for i in range(n):
        nu = reading - x[i, 0, C]
        S = P[i, 0, C, C] + R
        base = log_w[i]
        weight[m], parent[m], kind[m] = base - missed - extra + log_normal(nu, S), i, PLAIN
        m += 1
        weight[m], parent[m], kind[m] = base + math.log(1e-6 / RANGE_M), i, IGNORED
        m += 1
        if pitch > 0.0 and math.sqrt(S) < pitch:
            nearest = int(round(nu / pitch))
            for j in range(nearest - 1, nearest + 2):
                if j == 0:
                    continue
                chance = burst / (60.0 if abs(j) <= 60 else 6000.0)
                if abs(j) <= SINGLES:
                    chance += _poisson(-j, missed) if j < 0 else _poisson(j, extra)
                weight[m] = base + math.log(chance + 1e-12) + log_normal(nu - j * pitch, S)
                parent[m], kind[m], steps[m] = i, SHIFT, j
                m += 1
        else:
            wide = S + max(JUMP_SIGMA_M, abs(nu)) ** 2
            weight[m] = base + math.log(burst + 1e-12) + log_normal(nu, wide)
            parent[m], kind[m] = i, UNKNOWN
            m += 1
    kept, new_w = choose(weight[:m], most, uniform)
    new_x, new_P = x[parent[kept]], P[parent[kept]]
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    H[C] = 1.0
    first = 0.0
    for i in range(len(kept)):
        what = kind[kept[i]]
        if what == SHIFT or what == UNKNOWN:
            size, variance = steps[kept[i]] * pitch, 0.0
            if what == UNKNOWN:
                off = abs(reading - new_x[i, 0, C])
                size, variance = 0.0, max(JUMP_SIGMA_M, off) ** 2 / SHARE
            for local in range(2):
                jump(new_x[i, local], new_P[i, local], size, variance)
        nu = reading - new_x[i, 0, C]
        S = project(new_P[i, 0], H, PH) + R
        if i == 0:
            first = nu * nu / S
        if what != IGNORED:
            correct(new_x[i, 0], new_P[i, 0], PH, S, nu)
    few = 0.0
    for i in range(len(kept)):
        if kind[kept[i]] == SHIFT and -SINGLES <= steps[kept[i]] < 0:
            few -= math.exp(new_w[i]) * steps[kept[i]]
    says = kind[kept[0]]
    new_w, new_x, new_P = merge(new_w, new_x, new_P, 0.4 * pitch)
    return new_w, new_x, new_P, first, says, few


@njit(cache=True)
def _poisson(count: int, expected: float) -> float:
    chance = math.exp(-expected)
    for i in range(count):
        chance *= expected / (i + 1)
    return chance


@njit(cache=True)
def hear_radar(
    log_w: Array,
    x: Array,
    P: Array,
    speed: float,
    R: float,
    outlier: float,
    slip: float,
    slip_sigma: float,
    most: int,
    uniform: float,
) -> tuple[Array, Array, Array, float, int]:
    """
    Weigh a radar speed [m/s] of variance ``R`` and update the radar's local filters.

    ``outlier`` is the share of readings that mean nothing, ``slip`` the probability that the scale
    changed just now, by ``slip_sigma``. Other arguments and the result as for ``hear_loop``.
    """
    n = len(log_w)
    weight, parent = np.empty(n * 2), np.empty(n * 2, np.int64)
    kind = np.empty(n * 2, np.int64)
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    nothing = math.log(outlier / RANGE_MPS)
    m = 0
    for i in range(n):
        v, k = x[i, 1, V], x[i, 1, K]
        H[V], H[K] = 1.0 + k, v
        nu = speed - (1.0 + k) * v
        S = project(P[i, 1], H, PH) + R
        plain = math.log(1.0 - outlier) + log_normal(nu, S)
        parent[m], kind[m] = i, PLAIN if plain > nothing else IGNORED
        weight[m] = log_w[i] + max(plain, nothing)
        m += 1
        changed = math.log(slip + 1e-12) + log_normal(nu, S + (v * slip_sigma) ** 2)
        if changed > max(plain, nothing) + LEAST + 2.0:
            weight[m], parent[m], kind[m] = log_w[i] + changed, i, SLIP
            m += 1
    kept, new_w = choose(weight[:m], most, uniform)
    new_x, new_P = x[parent[kept]], P[parent[kept]]
    first = 0.0
    for i in range(len(kept)):
        what = kind[kept[i]]
        if what == SLIP:
            for local in range(2):
                new_P[i, local, K, K] += slip_sigma**2 / SHARE
        v, k = new_x[i, 1, V], new_x[i, 1, K]
        H[V], H[K] = 1.0 + k, v
        nu = speed - (1.0 + k) * v
        S = project(new_P[i, 1], H, PH) + R
        if i == 0:
            first = nu * nu / S
        if what != IGNORED:
            correct(new_x[i, 1], new_P[i, 1], PH, S, nu)
    return new_w, new_x, new_P, first, kind[kept[0]]


@njit(cache=True)
def hear_slowness(x: Array, P: Array, least: float) -> None:
    """
    Tell the radar's local filters that it reads less than it can, ``least`` [m/s], in place.

    Such a reading is no speed, and the next is no news: it only holds a speed that leaves its
    bounds. A train that is braked to a stop stays there, and does not go backward.
    """
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    for i in range(len(x)):
        v = x[i, 1, V]
        if 0.0 <= v <= least:
            continue
        level, sigma = (0.5 * least, 0.5 * least) if v > least else (0.0, 0.1)
        H[V], H[A] = 1.0, 0.0
        S = project(P[i, 1], H, PH) + sigma * sigma
        correct(x[i, 1], P[i, 1], PH, S, level - v)
        if v < 0.0:
            H[V], H[A] = 0.0, 1.0
            S = project(P[i, 1], H, PH) + STOPPED_MPS2**2
            correct(x[i, 1], P[i, 1], PH, S, -x[i, 1, A])


@njit(cache=True)
def hear_balise(
    log_w: Array,
    x: Array,
    P: Array,
    chainage: Array,
    R: Array,
    told: int,
    wrong: float,
    nothing: float,
    astray: float,
    length: float,
    most: int,
    uniform: float,
) -> tuple[Array, Array, Array, float, int]:
    """
    Weigh a balise passing in the master: whose it was, or whether the train is elsewhere.

    Args:
        log_w: (n,) weights; ``x``, ``P``: the bank, federated at the passing's stamp.
        chainage: (M,) where the antenna would be if the balise were that of the table [m].
        R: (M,) variances of it [m^2].
        told: row of the table whose id was told; -1 when it has none.
        wrong: probability that the id is another's.
        nothing: probability that no balise of the table was there.
        astray: probability that the train is not where all hypotheses have it.
        length: of the line [m].
        most: hypotheses to keep.
        uniform: a draw from [0, 1).

    Returns:
        The new bank, the NIS of the likeliest hypothesis, and what it says of the passing.
    """
    n, entries = len(log_w), len(chainage)
    room = n * (entries + 2)
    weight, parent = np.empty(room), np.empty(room, np.int64)
    kind, which = np.empty(room, np.int64), np.zeros(room, np.int64)
    others = max(entries - (1 if told >= 0 else 0), 1)
    m = 0
    for i in range(n):
        p = x[i, 0, C] - x[i, 0, B]
        spread = SHARE * (P[i, 0, C, C] + P[i, 0, B, B] - 2.0 * P[i, 0, C, B])
        for j in range(entries):
            chance = 1.0 - wrong if j == told else wrong / others
            if told < 0:
                chance = 1.0 / others
            ahead = chainage[j] - p
            if ahead * ahead > 81.0 * (spread + R[j]):
                continue
            weight[m] = log_w[i] + math.log(chance + 1e-12) + log_normal(ahead, spread + R[j])
            parent[m], which[m], kind[m] = i, j, PLAIN if j == told else NEARBY
            m += 1
        weight[m], parent[m], kind[m] = log_w[i] + math.log(nothing / length), i, IGNORED
        m += 1
        if told >= 0:
            weight[m] = log_w[i] + math.log(astray * (1.0 - wrong) / length)
            parent[m], which[m], kind[m] = i, told, MOVED
            m += 1
    kept, new_w = choose(weight[:m], most, uniform)
    new_x, new_P = x[parent[kept]], P[parent[kept]]
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    H[C], H[B] = 1.0, -1.0
    first = 0.0
    for i in range(len(kept)):
        what, j = kind[kept[i]], which[kept[i]]
        if what == IGNORED:
            continue
        for local in range(2):
            if what == MOVED:
                new_P[i, local, B, B] += length * length / SHARE
            nu = chainage[j] - new_x[i, local, C] + new_x[i, local, B]
            S = project(new_P[i, local], H, PH) + R[j] / SHARE
            if i == 0 and local == 0:
                first = nu * nu / (S * SHARE)
            correct(new_x[i, local], new_P[i, local], PH, S, nu)
    return new_w, new_x, new_P, first, kind[kept[0]]


@njit(cache=True)
def depart(x: Array, P: Array, distance: float) -> None:
    """Allow that every hypothesis' train has set out unnoticed and gone ``distance`` [m]."""
    for i in range(len(x)):
        for local in range(2):
            P[i, local, C, C] += distance * distance / SHARE
            P[i, local, V, V] += DEPARTURE_MPS**2 / SHARE
            P[i, local, A, A] += DEPARTURE_MPS2**2 / SHARE


@njit(cache=True)
def bounded(x: Array, P: Array, position: float, variance: float) -> bool:
    """Whether the likeliest hypothesis keeps within what a standing count says by itself."""
    inside = SHARE * P[0, 0, C, C] < 1.5 * variance
    return inside and (x[0, 0, C] - position) ** 2 < 3.0 * variance


@njit(cache=True)
def stand_still(x: Array, P: Array, speed_sigma: float, acceleration_sigma: float) -> None:
    """Tell every hypothesis, federated, that the train stands, in place."""
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    for i in range(len(x)):
        for local in range(2):
            for state, sigma in ((V, speed_sigma), (A, acceleration_sigma)):
                H[V], H[A] = 0.0, 0.0
                H[state] = 1.0
                S = project(P[i, local], H, PH) + sigma * sigma / SHARE
                correct(x[i, local], P[i, local], PH, S, -x[i, local, state])


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

"""
What a bank of hypotheses makes of each kind of measurement: children, their weights, updates.

Every function returns a new bank, the NIS of the measurement under the likeliest hypothesis, and
what that hypothesis says of it; ``hear_slowness``, ``stand_still`` and ``depart`` work in place.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maglev_localization.bank import LEAST, SHARE, choose, merge
from maglev_localization.line_kernels import (
    SIZE,
    A,
    B,
    C,
    K,
    V,
    correct,
    correct_fully,
    jump,
    project,
    recount,
    relocate,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PLAIN, SHIFT, UNKNOWN, IGNORED, SLIP, NEARBY, MOVED = range(7)
"""What a child says of its measurement: as expected; the counter jumped by whole crossings, or by
an unknown distance; it means nothing; the radar's scale changed; another balise than it said; the
train is somewhere else than thought."""

SINGLES = 3
"""As many crossings may be missed one by one between two readings; more are a burst."""
BURST, GLITCH = 60, 6000
"""Crossings that a burst may cost, and a glitch of the counter."""
JUMP_SIGMA_M = 60.0
"""Of a jump of the counter; a greater one has its own size for a sigma."""
AFTER_JUMP_M = 1.0
"""How well the radar's filter knows the count after such a jump: far worse than the loop's."""
NOTHING, RANGE_M, RANGE_MPS = 1e-6, 200.0, 20.0
"""Share of loop readings that mean nothing; how far such readings of loop and radar usually go."""
GATE = 81.0
"""A balise so many sigmas squared off is not the one."""
DEPARTURE_MPS, DEPARTURE_MPS2, STOPPED_MPS2 = 0.5, 0.5, 0.3
BACKWARD_MPS = 0.1
NEVER = 1e-12
"""Added to chances that may be nought, for the sake of their logarithm."""
LOG_TWO_PI = math.log(2.0 * math.pi)


@njit(cache=True)
def log_normal(nu: float, variance: float) -> float:
    """Return the logarithm of the normal density of an innovation."""
    return -0.5 * (nu * nu / variance + math.log(variance) + LOG_TWO_PI)


@njit(cache=True)
def poisson(count: int, expected: float) -> float:
    """Return the chance of ``count`` events where ``expected`` are."""
    chance = math.exp(-expected)
    for i in range(count):
        chance *= expected / (i + 1)
    return chance


@njit(cache=True)
def _loop_children(
    log_w: Array,
    x: Array,
    P: Array,
    reading: float,
    R: float,
    pitch: float,
    missed: float,
    extra: float,
    burst: float,
) -> tuple[Array, Ints, Ints, Ints]:
    """Return weight, parent, kind and crossings jumped of what may have become of a reading."""
    room = 5 * len(log_w)
    weight, parent = np.empty(room), np.empty(room, np.int64)
    kind, steps = np.empty(room, np.int64), np.zeros(room, np.int64)
    m = 0
    for i in range(len(log_w)):
        nu = reading - x[i, 0, C]
        S = P[i, 0, C, C] + R
        weight[m], parent[m], kind[m] = -missed - extra + log_normal(nu, S), i, PLAIN
        far = max(abs(nu), RANGE_M)
        weight[m + 1], parent[m + 1], kind[m + 1] = math.log(NOTHING / far), i, IGNORED
        begin, m = m, m + 2
        if pitch > 0.0 and math.sqrt(S) < pitch:
            nearest = round(nu / pitch)
            for j in range(nearest - 1, nearest + 2):
                if j == 0:
                    continue
                chance = burst / (BURST if abs(j) <= BURST else GLITCH)
                if abs(j) <= SINGLES:
                    chance += poisson(-j, missed) if j < 0 else poisson(j, extra)
                weight[m] = math.log(chance + NEVER) + log_normal(nu - j * pitch, S)
                parent[m], kind[m], steps[m] = i, SHIFT, j
                m += 1
        else:
            wide = S + max(JUMP_SIGMA_M, abs(nu)) ** 2
            weight[m], parent[m], kind[m] = math.log(burst + NEVER), i, UNKNOWN
            weight[m] += log_normal(nu, wide)
            m += 1
        for child in range(begin, m):
            weight[child] += log_w[i]
    return weight[:m], parent[:m], kind[:m], steps[:m]


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
    Weigh a loop reading and update the loop's local filters.

    Args:
        log_w: (n,) weights.
        x: (n, 2, 6) means, the loop's predicted to the reading's stamp.
        P: (n, 2, 6, 6) covariances.
        reading: what the counter read, set to the middle of what that may mean [m].
        R: its variance [m^2].
        pitch: of the crossings [m]; 0 where jumps are not of whole crossings.
        missed: crossings expected to have been missed singly since the last reading.
        extra: crossings expected to have been counted twice.
        burst: probability of a jump of any other size.
        most: hypotheses to keep.
        uniform: a draw from [0, 1).

    Returns:
        The new bank, NIS, what the likeliest says, and how many crossings the bank thinks were
        missed singly.
    """
    weight, parent, kind, steps = _loop_children(
        log_w, x, P, reading, R, pitch, missed, extra, burst
    )
    kept, new_w = choose(weight, most, uniform)
    new_x, new_P = x[parent[kept]], P[parent[kept]]
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    H[C] = 1.0
    first, singles = 0.0, 0.0
    for i in range(len(kept)):
        what, j = kind[kept[i]], steps[kept[i]]
        if what == SHIFT and -SINGLES <= j < 0:
            singles -= math.exp(new_w[i]) * j
        if what == SHIFT:
            for local in range(2):
                jump(new_x[i, local], j * pitch)
        nu = reading - new_x[i, 0, C]
        S = project(new_P[i, 0], H, PH) + R
        if what == UNKNOWN:
            S += max(JUMP_SIGMA_M, abs(nu)) ** 2
            # The radar's filter is told the size; what it knows of the count weighs nothing.
            recount(new_x[i, 1], new_P[i, 1], new_x[i, 1, C] + nu, AFTER_JUMP_M**2 / SHARE)
            recount(new_x[i, 0], new_P[i, 0], reading, R)
        elif what != IGNORED:
            correct(new_x[i, 0], new_P[i, 0], PH, S, nu)
        if i == 0:
            first = nu * nu / S
    says = kind[kept[0]]
    new_w, new_x, new_P = merge(new_w, new_x, new_P, 0.4 * pitch)
    return new_w, new_x, new_P, first, says, singles


@njit(cache=True)
def _radar_nu(x: Array, P: Array, speed: float, H: Array, PH: Array) -> tuple[float, float]:
    """Return innovation and its variance without noise; write ``H`` (6,) and P H'."""
    H[V], H[K] = 1.0 + x[K], x[V]
    return speed - (1.0 + x[K]) * x[V], project(P, H, PH)


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
    changed just now, by ``slip_sigma``. Other arguments as for ``hear_loop``.
    """
    room = 2 * len(log_w)
    weight, parent, kind = np.empty(room), np.empty(room, np.int64), np.empty(room, np.int64)
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    nothing = math.log(outlier / RANGE_MPS + NEVER)
    m = 0
    for i in range(len(log_w)):
        nu, spread = _radar_nu(x[i, 1], P[i, 1], speed, H, PH)
        plain = math.log(1.0 - outlier) + log_normal(nu, spread + R)
        best = max(plain, nothing)
        weight[m], parent[m], kind[m] = log_w[i] + best, i, PLAIN if plain > nothing else IGNORED
        m += 1
        wide = spread + R + (x[i, 1, V] * slip_sigma) ** 2
        changed = math.log(slip + NEVER) + log_normal(nu, wide)
        if changed > best + LEAST + 2.0:
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
        nu, spread = _radar_nu(new_x[i, 1], new_P[i, 1], speed, H, PH)
        if i == 0:
            first = nu * nu / (spread + R)
        if what != IGNORED:
            correct(new_x[i, 1], new_P[i, 1], PH, spread + R, nu)
    return new_w, new_x, new_P, first, kind[kept[0]]


@njit(cache=True)
def hear_slowness(x: Array, P: Array, least: float, outlier: float) -> bool:
    """
    Tell the radar's local filters that it reads less than it can, ``least`` [m/s], in place.

    Such a reading is no speed, and the next is no news: it only holds a speed that leaves its
    bounds or is in doubt. A train braked to a stop stays there, and does not go backward. One that
    runs does not stand because its radar lost the ground: where that is likelier, ``outlier`` being
    the share of readings that mean nothing, it is ignored. Return whether the first one does.
    """
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    plain, nothing = math.log(1.0 - outlier), math.log(outlier / RANGE_MPS + NEVER)
    ignored = False
    for i in range(len(x)):
        v, level, sigma = x[i, 1, V], 0.0, 0.5 * least
        H[V], H[A] = 1.0, 0.0
        spread = project(P[i, 1], H, PH)
        if 0.0 <= v <= least and SHARE * spread <= sigma * sigma:
            continue
        if v > least:
            level = 0.5 * least
        elif v < 0.0:
            sigma = BACKWARD_MPS
        S = spread + sigma * sigma
        if plain + log_normal(level - v, S) < nothing:
            ignored = ignored or i == 0
            continue
        correct(x[i, 1], P[i, 1], PH, S, level - v)
        if v < 0.0:
            H[V], H[A] = 0.0, 1.0
            S = project(P[i, 1], H, PH) + STOPPED_MPS2**2
            correct(x[i, 1], P[i, 1], PH, S, -x[i, 1, A])
    return ignored


@njit(cache=True)
def _balise_children(
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
) -> tuple[Array, Ints, Ints, Ints]:
    """Return weight, parent, kind and row of the table of what a passing may have been."""
    entries = len(chainage)
    room = len(log_w) * (entries + 2)
    weight, parent = np.empty(room), np.empty(room, np.int64)
    kind, row = np.empty(room, np.int64), np.zeros(room, np.int64)
    others = max(entries - (1 if told >= 0 else 0), 1)
    m = 0
    for i in range(len(log_w)):
        p = x[i, 0, C] - x[i, 0, B]
        spread = SHARE * (P[i, 0, C, C] + P[i, 0, B, B] - 2.0 * P[i, 0, C, B])
        for j in range(entries):
            chance = wrong / others if told >= 0 else 1.0 / others
            if j == told:
                chance = 1.0 - wrong
            ahead = chainage[j] - p
            if ahead * ahead > GATE * (spread + R[j]):
                continue
            weight[m] = log_w[i] + math.log(chance + NEVER) + log_normal(ahead, spread + R[j])
            parent[m], row[m], kind[m] = i, j, PLAIN if j == told else NEARBY
            m += 1
        weight[m], parent[m], kind[m] = log_w[i] + math.log(nothing / length), i, IGNORED
        m += 1
        if told >= 0:
            weight[m] = log_w[i] + math.log(astray * (1.0 - wrong) / length)
            parent[m], row[m], kind[m] = i, told, MOVED
            m += 1
    return weight[:m], parent[:m], kind[:m], row[:m]


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
        log_w: (n,) weights.
        x: (n, 2, 6) means, federated at the passing's stamp.
        P: (n, 2, 6, 6) covariances.
        chainage: (M,) where the antenna would be if the balise were that of the table [m].
        R: (M,) variances of it [m^2].
        told: row of the table whose id was told; -1 when it has none.
        wrong: probability that the id is another's.
        nothing: probability that no balise of the table was there.
        astray: probability that the train is not where all hypotheses have it.
        length: of the line [m].
        most: hypotheses to keep.
        uniform: a draw from [0, 1).
    """
    weight, parent, kind, row = _balise_children(
        log_w, x, P, chainage, R, told, wrong, nothing, astray, length
    )
    kept, new_w = choose(weight, most, uniform)
    new_x, new_P = x[parent[kept]], P[parent[kept]]
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    H[C], H[B] = 1.0, -1.0
    first = 0.0
    for i in range(len(kept)):
        what, j = kind[kept[i]], row[kept[i]]
        if what == IGNORED:
            continue
        for local in range(2):
            nu = chainage[j] - new_x[i, local, C] + new_x[i, local, B]
            S = SHARE * project(new_P[i, local], H, PH) + R[j]
            if what == MOVED:
                S += length * length
                relocate(new_x[i, local], new_P[i, local], chainage[j], R[j] / SHARE)
            else:
                correct_fully(new_x[i, local], new_P[i, local], H, R[j] / SHARE, nu)
            if i == 0 and local == 0:
                first = nu * nu / S
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
    """
    Tell every hypothesis, federated, that the train stands, in place.

    Not those that know better: a count may stand and a radar read nothing in a running train.
    """
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    for i in range(len(x)):
        if x[i, 0, V] ** 2 > GATE * (SHARE * P[i, 0, V, V] + speed_sigma**2):
            continue
        for local in range(2):
            for state, sigma in ((V, speed_sigma), (A, acceleration_sigma)):
                H[V], H[A] = 0.0, 0.0
                H[state] = 1.0
                S = project(P[i, local], H, PH) + sigma * sigma / SHARE
                correct(x[i, local], P[i, local], PH, S, -x[i, local, state])

"""
What a bank of hypotheses makes of loop and radar: children, their weights, updates.

Every function returns a new bank, the NIS of the measurement under the likeliest hypothesis, and
what that hypothesis says of it. Balises are heard in ``passing``; trains that stand or crawl are
the matter of ``standing``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maglev_localization.bank import LEAST, SHARE, choose, merge
from maglev_localization.line_kernels import SIZE, A, C, K, V, correct, jump, project, recount

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PLAIN, SHIFT, UNKNOWN, IGNORED, SLIP, NEARBY, MOVED, DEPARTED = range(8)
"""What a child says of its measurement: as expected; the counter jumped by whole crossings, or by
an unknown distance; it means nothing; the radar's scale changed; another balise than it said; the
train is somewhere else than thought; a train that stood has set out unnoticed."""

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
DEPARTURE = 0.001
"""Chance that a train that stood has set out when a radar speed is heard."""
DEPARTURE_MPS2 = 0.5
"""Acceleration of a train that sets out, 1 sigma [m/s^2]."""
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
def set_out(P: Array, distance: float, speed: float) -> None:
    """Allow in place that a train has gone ``distance`` [m] and runs at ``speed``, 1 sigma."""
    P[C, C] += distance * distance / SHARE
    P[V, V] += speed * speed / SHARE
    P[A, A] += DEPARTURE_MPS2**2 / SHARE


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
    least: float,
    unseen_m: float,
    unseen_mps: float,
    most: int,
    uniform: float,
) -> tuple[Array, Array, Array, float, int]:
    """
    Weigh a radar speed [m/s] of variance ``R`` and update the radar's local filters.

    ``outlier`` is the share of readings that mean nothing, ``slip`` the probability that the scale
    changed just now, by ``slip_sigma``. Of trains slower than ``least`` [m/s] a radar tells nothing
    and reads up to that and more. A train that stood may be as fast as ``unseen_mps`` by now and
    anywhere up to ``unseen_m``; 0: it did not stand. Other arguments as for ``hear_loop``.
    """
    room = 3 * len(log_w)
    weight, parent, kind = np.empty(room), np.empty(room, np.int64), np.empty(room, np.int64)
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    unfounded = math.exp(log_normal(speed, (0.5 * least) ** 2)) if least > 0.0 else 0.0
    m = 0
    for i in range(len(log_w)):
        nu, spread = _radar_nu(x[i, 1], P[i, 1], speed, H, PH)
        slow = 0.5 * math.erfc((abs(x[i, 1, V]) - least) / math.sqrt(2.0 * spread + NEVER))
        nothing = math.log(outlier / RANGE_MPS + slow * unfounded + NEVER)
        plain = math.log(1.0 - outlier) + log_normal(nu, spread + R)
        best = max(plain, nothing)
        weight[m], parent[m], kind[m] = log_w[i] + best, i, PLAIN if plain > nothing else IGNORED
        m += 1
        wide = spread + R + (x[i, 1, V] * slip_sigma) ** 2
        changed = math.log(slip + NEVER) + log_normal(nu, wide)
        if changed > best + LEAST + 2.0:
            weight[m], parent[m], kind[m] = log_w[i] + changed, i, SLIP
            m += 1
        if abs(x[i, 1, V]) < 0.5 * unseen_mps:
            weight[m] = log_w[i] + math.log(DEPARTURE) + log_normal(nu, spread + R + unseen_mps**2)
            parent[m], kind[m] = i, DEPARTED
            m += 1
    kept, new_w = choose(weight[:m], most, uniform)
    new_x, new_P = x[parent[kept]], P[parent[kept]]
    first = 0.0
    for i in range(len(kept)):
        what = kind[kept[i]]
        if what == SLIP:
            for local in range(2):
                new_P[i, local, K, K] += slip_sigma**2 / SHARE
        elif what == DEPARTED:
            for local in range(2):
                new_x[i, local, C] += 0.5 * unseen_m
                set_out(new_P[i, local], unseen_m / math.sqrt(12.0), unseen_mps)
        nu, spread = _radar_nu(new_x[i, 1], new_P[i, 1], speed, H, PH)
        if i == 0:
            first = nu * nu / (spread + R)
        if what != IGNORED:
            correct(new_x[i, 1], new_P[i, 1], PH, spread + R, nu)
    return new_w, new_x, new_P, first, kind[kept[0]]

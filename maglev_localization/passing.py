"""
What a bank of hypotheses makes of a balise, in the master: whose it was, or where the train is.

Children, weights and updates as in ``hearing``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maglev_localization.bank import SHARE, choose
from maglev_localization.hearing import IGNORED, MOVED, NEARBY, NEVER, PLAIN, log_normal
from maglev_localization.line_kernels import SIZE, B, C, correct_fully, project, relocate
from maglev_localization.line_kernels import S as SLOPE

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ASTRAY_SLOPE, NOT_FAR_M = 0.005, 50.0
"""A train that is astray by no more than that [m] may have a count whose pitch is not as set."""
GATE = 81.0
"""A balise so many sigmas squared off is not the one."""


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
                if nu * nu < NOT_FAR_M * NOT_FAR_M:
                    new_P[i, local, SLOPE, SLOPE] += ASTRAY_SLOPE**2 / SHARE
            else:
                correct_fully(new_x[i, local], new_P[i, local], H, R[j] / SHARE, nu)
            if i == 0 and local == 0:
                first = nu * nu / S
    return new_w, new_x, new_P, first, kind[kept[0]]

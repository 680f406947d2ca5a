"""Trains that stand or crawl, told to every hypothesis of a bank, in place."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maglev_localization.bank import SHARE
from maglev_localization.hearing import NEVER, RANGE_MPS, log_normal, set_out
from maglev_localization.line_kernels import SIZE, A, C, V, correct, project

Array = NDArray[np.float64]

GATE = 81.0
"""A train whose speed is so many sigmas squared off nought does not stand."""
DEPARTURE_MPS, STOPPED_MPS2, BACKWARD_MPS = 0.5, 0.3, 0.1
SLOWNESS_MPS = 0.05
"""Noise of a radar where it begins to tell speeds [m/s]."""


@njit(cache=True)
def hear_slowness(
    log_w: Array, x: Array, P: Array, heading: float, least: float, outlier: float
) -> bool:
    """
    Tell the radar's local filters that it reads less than it can, ``least`` [m/s], in place.

    Such a reading is no speed, and the next is no news: it only holds a speed that leaves its
    bounds or is in doubt. A train braked to a stop stays there, and does not go back against its
    ``heading`` (1 or -1). One that runs does not stand because its radar lost the ground: where
    that is likelier, ``outlier`` being the share of readings that mean nothing, it is ignored.
    Hypotheses of trains too fast for such a reading lose weight. Return whether the first one
    ignores it.
    """
    PH, H = np.empty(SIZE), np.zeros(SIZE)
    plain, nothing = math.log(1.0 - outlier), math.log(outlier / RANGE_MPS + NEVER)
    ignored, top = False, -math.inf
    for i in range(len(x)):
        v, level, sigma = heading * x[i, 1, V], 0.0, 0.5 * least
        H[V], H[A] = 1.0, 0.0
        spread = project(P[i, 1], H, PH)
        slow = 0.5 * math.erfc((abs(v) - least) / math.sqrt(2.0 * (spread + SLOWNESS_MPS**2)))
        log_w[i] += math.log((1.0 - outlier) * slow + outlier)
        top = max(top, log_w[i])
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
        correct(x[i, 1], P[i, 1], PH, S, heading * (level - v))
        if v < 0.0:
            H[V], H[A] = 0.0, 1.0
            S = project(P[i, 1], H, PH) + STOPPED_MPS2**2
            correct(x[i, 1], P[i, 1], PH, S, -x[i, 1, A])
    log_w -= top + math.log(np.exp(log_w - top).sum())
    return ignored


@njit(cache=True)
def depart(P: Array, distance: float) -> None:
    """Allow that every hypothesis' train has set out unnoticed and gone ``distance`` [m]."""
    for i in range(len(P)):
        for local in range(2):
            set_out(P[i, local], distance, DEPARTURE_MPS)


@njit(cache=True)
def bounded(x: Array, P: Array, position: float, variance: float) -> bool:
    """Whether all hypotheses keep within what a standing count says by itself."""
    for i in range(len(x)):
        inside = SHARE * P[i, 0, C, C] < 1.5 * variance
        if not inside or (x[i, 0, C] - position) ** 2 >= 3.0 * variance:
            return False
    return True


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

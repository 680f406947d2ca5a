"""
One conditional-Gaussian hypothesis of where the train is, compiled.

The state ``x`` (6,) is ``[c, v, a, b, s, k]``: what a loop counter without misses would read [m],
speed [m/s], acceleration [m/s^2], that reading minus the chainage [m], its slope against the
chainage, and the radar's scale error. The chainage is ``c - b``: in these coordinates ``P`` (6, 6)
is well conditioned even while the place on the line is unknown.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

C, V, A, B, S, K = range(6)
SIZE = 6


class Noise(NamedTuple):
    """
    Spectral densities of what drives the state.

    Attributes:
        jerk: [m^2/s^5].
        offset: of b, for each metre travelled [m^2/m].
        slope: of s, for each metre travelled [1/m].
        scale: of k [1/s].
    """

    jerk: float
    offset: float
    slope: float
    scale: float


@njit(cache=True)
def predict(x: Array, P: Array, dt: float, noise: Noise, share: float) -> None:
    """Move a local estimate on by ``dt`` [s], in place; its process noise is Q / share."""
    if dt <= 0.0:
        return
    half = 0.5 * dt * dt
    travel = x[V] * dt + x[A] * half
    stretch = 1.0 + x[S]
    for transposed in range(2):
        for j in range(SIZE):
            if transposed == 0:
                v, a, s = P[V, j], P[A, j], P[S, j]
            else:
                v, a, s = P[j, V], P[j, A], P[j, S]
            step = dt * v + half * a
            to_c = stretch * step + travel * s
            to_b = x[S] * step + travel * s
            if transposed == 0:
                P[C, j] += to_c
                P[B, j] += to_b
                P[V, j] += dt * a
            else:
                P[j, C] += to_c
                P[j, B] += to_b
                P[j, V] += dt * a
    x[C] += stretch * travel
    x[B] += x[S] * travel
    x[V] += dt * x[A]
    q = noise.jerk / share
    cv, ca, va = q * dt**4 / 8.0, q * dt**3 / 6.0, q * half
    P[C, C] += q * dt**5 / 20.0
    P[V, V] += q * dt**3 / 3.0
    P[A, A] += q * dt
    P[C, V] += cv
    P[V, C] += cv
    P[C, A] += ca
    P[A, C] += ca
    P[V, A] += va
    P[A, V] += va
    wander = noise.offset * abs(travel) / share
    P[C, C] += wander
    P[B, B] += wander
    P[C, B] += wander
    P[B, C] += wander
    P[S, S] += noise.slope * abs(travel) / share
    P[K, K] += noise.scale * dt / share


@njit(cache=True)
def project(P: Array, H: Array, PH: Array) -> float:
    """Write P H' into ``PH`` (6,) and return H P H'."""
    total = 0.0
    for i in range(SIZE):
        PH[i] = 0.0
        for j in range(SIZE):
            PH[i] += P[i, j] * H[j]
        total += H[i] * PH[i]
    return total


@njit(cache=True)
def correct(x: Array, P: Array, PH: Array, variance: float, nu: float) -> None:
    """Apply a scalar measurement in place: ``PH`` = P H', ``variance`` of its innovation ``nu``."""
    for i in range(SIZE):
        gain = PH[i] / variance
        x[i] += gain * nu
        for j in range(i, SIZE):
            P[i, j] -= gain * PH[j]
            P[j, i] = P[i, j]


@njit(cache=True)
def correct_fully(x: Array, P: Array, H: Array, R: float, nu: float) -> None:
    """
    Apply a scalar measurement of variance ``R`` in place, in Joseph's form.

    It costs more than ``correct``, and keeps P positive where it is vast against ``R``.
    """
    PH = np.empty(SIZE)
    S = project(P, H, PH) + R
    K = PH / S
    x += K * nu
    A = np.eye(SIZE) - np.outer(K, H)
    AP = A @ P
    for i in range(SIZE):
        for j in range(i, SIZE):
            P[i, j] = R * K[i] * K[j]
            for m in range(SIZE):
                P[i, j] += AP[i, m] * A[j, m]
            P[j, i] = P[i, j]


@njit(cache=True)
def jump(x: Array, size: float) -> None:
    """Let the counter jump by ``size`` [m] in place; the train does not."""
    x[C] += size
    x[B] += size


@njit(cache=True)
def recount(x: Array, P: Array, position: float, variance: float) -> None:
    """
    Let the counter begin anew in place: it reads ``position`` [m], known to ``variance`` [m^2].

    What it counted before is not to be compared with that, so the train stays where it was.
    """
    x[B] += position - x[C]
    x[C] = position
    spread = P[C, C] + P[B, B] - 2.0 * P[C, B]
    for j in range(SIZE):
        P[B, j] -= P[C, j]
        P[j, B] = P[B, j]
    for j in range(SIZE):
        P[C, j] = P[j, C] = 0.0
    P[C, C] = P[C, B] = P[B, C] = variance
    P[B, B] = spread + variance


@njit(cache=True)
def relocate(x: Array, P: Array, chainage: float, variance: float) -> None:
    """Put the train at ``chainage`` [m], to ``variance`` [m^2], in place; the counter goes on."""
    x[B] = x[C] - chainage
    for j in range(SIZE):
        P[B, j] = P[C, j]
        P[j, B] = P[C, j]
    P[B, B] = P[C, C] + variance


@njit(cache=True)
def fuse(x: Array, P: Array, work: Array) -> bool:
    """
    Fuse two local estimates ``x`` (2, 6), ``P`` (2, 6, 6) into the first, by information (eq. 8).

    With G = P1 (P1 + P2)^-1 it is x1 + G (x2 - x1) and P1 - G P1, so that nothing has to be
    inverted but the sum. ``work`` (6, 13) is scratch. Return False, leaving both as they were,
    when the sum is not positive definite.
    """
    scale = work[:, 12]
    for i in range(SIZE):
        if not P[0, i, i] + P[1, i, i] > 0.0:
            return False
        scale[i] = 1.0 / np.sqrt(P[0, i, i] + P[1, i, i])
    for i in range(SIZE):
        for j in range(SIZE):
            work[i, j] = (P[0, i, j] + P[1, i, j]) * scale[i] * scale[j]
            work[i, SIZE + j] = P[0, i, j] * scale[i]
    for i in range(SIZE):  # Cholesky: the lower triangle of work[:, :6]
        for j in range(i + 1):
            total = work[i, j]
            for m in range(j):
                total -= work[i, m] * work[j, m]
            if i == j:
                if total <= 1e-14:
                    return False
                work[i, i] = np.sqrt(total)
            else:
                work[i, j] = total / work[j, j]
    for column in range(SIZE):  # L^-1 P1
        for i in range(SIZE):
            total = work[i, SIZE + column]
            for m in range(i):
                total -= work[i, m] * work[m, SIZE + column]
            work[i, SIZE + column] = total / work[i, i]
    nu = np.empty(SIZE)  # L^-1 (x2 - x1)
    for i in range(SIZE):
        total = (x[1, i] - x[0, i]) * scale[i]
        for m in range(i):
            total -= work[i, m] * nu[m]
        nu[i] = total / work[i, i]
    for i in range(SIZE):
        for m in range(SIZE):
            x[0, i] += work[m, SIZE + i] * nu[m]
        for j in range(i, SIZE):
            for m in range(SIZE):
                P[0, i, j] -= work[m, SIZE + i] * work[m, SIZE + j]
            P[0, j, i] = P[0, i, j]
    return True

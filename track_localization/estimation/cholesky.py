"""Cholesky factor and inverse of small matrices, compiled, that tell instead of raise."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_PIVOT = 1e-13
"""A pivot below this part of its diagonal element is rounding: the matrix is singular."""


@numba.njit(cache=True)
def lower_root(P: Array) -> tuple[Array, bool]:
    """Return L (D, D), lower triangular, L L' = P, and whether ``P`` is positive definite."""
    states = len(P)
    L = np.zeros((states, states))
    for i in range(states):
        for j in range(i + 1):
            left = P[i, j]
            for k in range(j):
                left -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = left / L[j, j]
            elif left > LEAST_PIVOT * P[i, i]:
                L[i, i] = np.sqrt(left)
            else:
                return L, False
    return L, True


@numba.njit(cache=True)
def lower_inverse(L: Array) -> Array:
    """Return the inverse (D, D) of a lower triangular matrix."""
    states = len(L)
    inverse = np.zeros((states, states))
    for j in range(states):
        inverse[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, states):
            total = 0.0
            for k in range(j, i):
                total -= L[i, k] * inverse[k, j]
            inverse[i, j] = total / L[i, i]
    return inverse


@numba.njit(cache=True)
def inverse(P: Array) -> tuple[Array, bool]:
    """Return the inverse (D, D) of a symmetric ``P``, and whether it is positive definite."""
    L, regular = lower_root(P)
    out = np.zeros_like(P)
    if not regular:
        return out, False
    root = lower_inverse(L)
    for i in range(len(P)):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, len(P)):
                total += root[k, i] * root[k, j]
            out[i, j] = total
            out[j, i] = total
    return out, True

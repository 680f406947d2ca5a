"""
Measurements one number at a time: a compiled scalar Kalman update, and robust weights for it.

An innovation ``nu`` is that against the state before any of the numbers; the correction gathers in
``dx`` and is taken into account for the next one. Numbers with correlated noise are made
independent by ``whiten`` first.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@numba.njit(cache=True)
def innovation(P: Array, h: Array, R: float, nu: float, dx: Array) -> tuple[float, float]:
    """
    Return what ``dx`` leaves of an innovation, and its variance S = h P h' + R.

    The first squared over the second is the NIS by which a gate or a weight judges.
    """
    left, S = nu, R
    for i in range(len(h)):
        if h[i] != 0.0:
            left -= h[i] * dx[i]
            for j in range(len(h)):
                S += h[i] * P[i, j] * h[j]
    return left, S


@numba.njit(cache=True)
def update(P: Array, h: Array, R: float, nu: float, dx: Array) -> float:
    """
    Correct ``P`` (n, n) and ``dx`` (n,) in place by one number and return S = h P h' + R.

    ``h`` (n,) is its row of H, ``R`` its variance, ``nu`` its innovation. P - P h' h P / S is
    taken element by element, so that it stays exactly symmetric; for one number with the best gain
    that is as accurate as Joseph's form. Nothing happens where S is not a positive number.
    """
    states = len(h)
    Ph = np.zeros(states)
    for j in range(states):
        if h[j] != 0.0:
            for i in range(states):
                Ph[i] += P[j, i] * h[j]
    S, left = R, nu
    for i in range(states):
        S += h[i] * Ph[i]
        left -= h[i] * dx[i]
    if not 0.0 < S < np.inf:
        return S
    for i in range(states):
        gain = Ph[i] / S
        dx[i] += gain * left
        for j in range(i + 1):
            value = P[i, j] - gain * Ph[j]
            P[i, j] = value
            P[j, i] = value
    return S


@numba.njit(cache=True)
def whiten(H: Array, R: Array, nu: Array) -> bool:
    """
    Make ``m`` numbers independent with unit variance, in place: H (m, n) and nu (m,).

    ``R`` (m, m) is their covariance and becomes its lower root. Return whether it is positive
    definite; where it is not, H and nu are as they were.
    """
    size = len(R)
    for i in range(size):
        for j in range(i + 1):
            left = R[i, j]
            for k in range(j):
                left -= R[i, k] * R[j, k]
            if i > j:
                R[i, j] = left / R[j, j]
            elif left > 0.0:
                R[i, i] = np.sqrt(left)
            else:
                return False
    for i in range(size):
        for k in range(i):
            R[k, i] = 0.0
            nu[i] -= R[i, k] * nu[k]
            for j in range(H.shape[1]):
                H[i, j] -= R[i, k] * H[k, j]
        nu[i] /= R[i, i]
        for j in range(H.shape[1]):
            H[i, j] /= R[i, i]
    return True


@numba.njit(cache=True)
def huber_weight(nis: float, knee: float) -> float:
    """
    Return the weight of a number whose NIS is ``nis``: 1 up to ``knee``, sqrt(knee / nis) above.

    Divide R by it: far out the pull on the state then no longer grows with the innovation.
    """
    return 1.0 if nis <= knee else np.sqrt(knee / nis)


@numba.njit(cache=True)
def innovation_power(V: float, nu: float, memory: float = 0.95) -> float:
    """Return the fading mean of nu^2 after one more innovation: (memory V + nu^2)/(memory + 1)."""
    return (memory * V + nu * nu) / (memory + 1.0)


@numba.njit(cache=True)
def fading_factor(V: float, R: float, hPh: float) -> float:
    """
    Return by what the predicted P is to be multiplied: max(1, (V - R) / hPh).

    ``V`` is the innovations' power, ``R`` the number's variance, ``hPh`` what P says of it. A
    number that P says nothing of leaves P alone.
    """
    return max(1.0, (V - R) / hPh) if hPh > 0.0 else 1.0


class Lockout:
    """
    A gate that a filter gone wrong cannot shut for good.

    A number whose NIS is above ``limit`` is refused, but never more than ``patience`` of them in a
    row: the next one is let in, whatever it says, and the count starts anew.
    """

    def __init__(self, limit: float, patience: int) -> None:
        if not limit > 0.0 or patience < 1:
            raise ValueError('Lockout: the limit must be positive and the patience one at least')
        self._limit = limit
        self._patience = patience
        self._run = 0

    @property
    def run(self) -> int:
        """How many numbers in a row were refused until now."""
        return self._run

    def admits(self, nis: float) -> bool:
        """Return whether a number may enter; one whose NIS is not finite never does."""
        if not np.isfinite(nis):
            return False
        if nis > self._limit and self._run < self._patience:
            self._run += 1
            return False
        self._run = 0
        return True

    def reset(self) -> None:
        """Forget the run of refusals."""
        self._run = 0

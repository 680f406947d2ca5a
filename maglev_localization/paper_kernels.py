"""Loops over particles of the paper's filter, compiled."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.particles import weighted_moments

Array = NDArray[np.float64]


@numba.njit(cache=True)
def transition(T: float) -> tuple[Array, Array]:
    """Return F (3, 3) of constant acceleration and the reach G (3,) of a constant jerk over T."""
    F = np.array([[1.0, T, 0.5 * T * T], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    G = np.array([T**3 / 6.0, 0.5 * T * T, T])
    return F, G


@numba.njit(cache=True)
def predict_global(mean: Array, P: Array, T: float, variance: float) -> None:
    """Carry the master's mean (3,) and covariance (3, 3) over T in place; jerk of ``variance``."""
    F, G = transition(T)
    mean[:] = F @ mean
    P[:, :] = F @ P @ F.T + variance * np.outer(G, G)


@numba.njit(cache=True)
def predict_local(
    cloud: Array, w: Array, T: float, sigma: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """
    Carry particles (3, N) over T in place, each with a jerk of its own of ``sigma`` [m/s^3].

    Return their mean (3,) and covariance (3, 3) under the weights (N,).
    """
    count = cloud.shape[1]
    jerk = np.empty(count)
    for n in range(count):
        jerk[n] = sigma * rng.standard_normal()
    half, sixth = 0.5 * T * T, T**3 / 6.0
    for n in range(count):
        cloud[0, n] += T * cloud[1, n] + half * cloud[2, n] + sixth * jerk[n]
    for n in range(count):
        cloud[1, n] += T * cloud[2, n] + half * jerk[n]
    for n in range(count):
        cloud[2, n] += T * jerk[n]
    return weighted_moments(cloud.T, w)

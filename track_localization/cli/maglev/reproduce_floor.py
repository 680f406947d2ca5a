"""What the paper's scenario allows: Kalman filters from the textbook, told all that is true."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.sim.maglev import MaglevSimConfig, SimulatedRun

Array = NDArray[np.float64]

START_VARIANCE = (1.0, 0.25, 1.0)
"""Of place, speed and acceleration at the start, as the paper's method is told by default."""

EXACT_M2 = 1e-8
"""Variance of a balise that is where the table has it, passed at its stamp [m^2]."""


def optimal(run: SimulatedRun, config: MaglevSimConfig) -> Trajectory:
    """
    Return what the Kalman filter of eqs (3), (5) and (7) makes of an absolute loop and the radar.

    It begins where the paper's method does: at the first reading of either, acceleration 0. On the
    paper's scenario without balises no filter has a smaller mean square error.
    """
    time_s = _in_step(run)
    x, P = np.array([run.loop.value[0], run.radar.value[0], 0.0]), np.diag(START_VARIANCE)
    H, R = np.eye(2, 3), np.diag([config.loop.noise_m**2, config.radar.noise_mps**2])
    readings = np.stack([run.loop.value, run.radar.value], axis=1)
    means, covariances = [x], [P]
    for T, z in zip(np.diff(time_s).tolist(), readings[1:], strict=True):
        F = np.array([[1.0, T, T**2 / 2.0], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
        G = np.array([T**3 / 6.0, T**2 / 2.0, T])
        x, P = F @ x, F @ P @ F.T + config.motion.jerk_variance * np.outer(G, G)
        x, P = _corrected(x, P, H, R, z)
        means.append(x)
        covariances.append(P)
    return _along_x(time_s, np.array(means), np.array(covariances))


def linear_optimum(run: SimulatedRun, config: MaglevSimConfig) -> Trajectory:
    """
    Return what the best linear filter makes of a counter that misses crossings, and of balises.

    It is told what no method is: which share is missed, so that only the chance of it is left; the
    variance of the jerk and when it changes; where balises are, without error. The state is
    chainage, speed, acceleration, jerk, and the counter's error, of which n crossings take n p
    pitch, with a variance of n p (1 - p) pitch^2. A counter is half a pitch behind on average.
    """
    time_s, pitch = _in_step(run), config.loop.pitch_m
    readings = np.stack([run.loop.value + 0.5 * pitch, run.radar.value], axis=1)
    R = np.diag([pitch**2 / 12.0, config.radar.noise_mps**2])
    sees, at = np.eye(2, 5), np.eye(1, 5)
    sees[0, 4] = 1.0
    x = np.array([*readings[0], 0.0, 0.0, 0.0])
    P = np.diag([R[0, 0], R[1, 1], START_VARIANCE[2], 0.0, 0.0])
    passed = _passings(run)
    means, covariances = [x], [P]
    for begin, end, z in zip(time_s[:-1].tolist(), time_s[1:].tolist(), readings[1:], strict=True):
        x[3], P[3], P[:, 3] = 0.0, 0.0, 0.0
        P[3, 3] = config.motion.jerk_variance
        now = begin
        for when, place in passed:
            if begin < when <= end:
                x, P = _carried(x, P, when - now, config)
                x, P = _corrected(x, P, at, np.array([[EXACT_M2]]), np.array([place]))
                now = when
        x, P = _carried(x, P, end - now, config)
        x, P = _corrected(x, P, sees, R, z)
        means.append(x.copy())
        covariances.append(P.copy())
    return _along_x(time_s, np.array(means), np.array(covariances))


def _carried(x: Array, P: Array, T: float, config: MaglevSimConfig) -> tuple[Array, Array]:
    """Return a state of ``linear_optimum`` and its covariance a time T later."""
    F = np.eye(5)
    for power in (1, 2, 3):
        for row in range(4 - power):
            F[row, row + power] = T**power / math.factorial(power)
    later, P = F @ x, F @ P @ F.T
    missed, pitch = config.loop.missed, config.loop.pitch_m
    crossings = float(later[0] - x[0]) / pitch
    later[4] -= crossings * missed * pitch
    P[4, 4] += crossings * missed * (1.0 - missed) * pitch**2
    return later, P


def _corrected(x: Array, P: Array, H: Array, R: Array, z: Array) -> tuple[Array, Array]:
    """Return state and covariance after a measurement; Joseph's form keeps P positive."""
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    rest = np.eye(len(x)) - K @ H
    return x + K @ (z - H @ x), rest @ P @ rest.T + K @ R @ K.T


def _in_step(run: SimulatedRun) -> Array:
    """Return the stamps (N,) that loop and radar have in common."""
    if not np.array_equal(run.loop.time_s, run.radar.time_s):
        raise ValueError('loop and radar are not in step')
    return run.loop.time_s


def _passings(run: SimulatedRun) -> list[tuple[float, float]]:
    """Return (stamp [s], chainage of the antenna [m]) of every balise heard."""
    places = dict(zip(run.table.id, run.table.chainage.tolist(), strict=True))
    heard = zip(run.balise.time_s.tolist(), run.balise.id, run.balise.value.tolist(), strict=True)
    return [(time_s, places[told] + offset) for time_s, told, offset in heard]


def _along_x(time_s: Array, mean: Array, P: Array) -> Trajectory:
    zero = np.zeros(len(time_s))
    covariance = np.zeros((len(time_s), 3, 3))
    covariance[:, 0, 0] = P[:, 0, 0]
    return Trajectory(
        time_s=time_s,
        position=np.stack([mean[:, 0], zero, zero], axis=1),
        velocity=np.stack([mean[:, 1], zero, zero], axis=1),
        chainage=mean[:, 0],
        speed=mean[:, 1],
        covariance=covariance,
        sigma_along=np.sqrt(P[:, 0, 0]),
        sigma_speed=np.sqrt(P[:, 1, 1]),
    )

"""
What the sensors of a simulated run carry: the errors of an estimator that is told all that is true.

It is told every statistic of the simulator, the correlation time and the HDOP of these fixes, which
of them are reflections, which odometer speeds are slips, where the line is straight, and the true
trajectory, about which its errors are linear. Of what makes the problem harder, the odometer's
pulses are left out, its scale (plus or minus a known figure) unless that is not to be told, and the
Earth's turning. With errors that are linear and normal the Kalman filter and the
Rauch-Tung-Striebel smoother have the least errors there are: at no one time has any estimator a
smaller probability of being further off than some bound. (Groves, Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems, 2nd ed., ch. 3 and 14.) That holds for what it is told:
of a line's shape it knows no more than where it is straight.

Nothing of an estimator is used here. The error state (30,), estimated minus true, is position,
velocity and attitude against the horizon (east, north, up), the gyro's constant and wandering bias
and the accelerometer's in the body (3 each), the car's yaw and pitch in it, the fixes' slow error,
the odometer's scale, a constant offset of the map to the left and upward, and the course of the
straight.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.estimation import so3
from track_localization.sim.train import SimulatedRun, TrainSimConfig
from track_localization.sim.train.inertial import figures_of, start_sigmas

Array = NDArray[np.float64]

STEP_S = 0.5
"""Time between epochs; with 0.1 s the greatest errors are 2 to 5 % greater."""
SIZE = 30
R, V, PSI, GYRO, GYRO_WANDER, ACCEL, ACCEL_WANDER = (slice(k, k + 3) for k in range(0, 21, 3))
MOUNT, SLOW, SCALE, OFFSET, LINE = slice(21, 23), slice(23, 26), 26, slice(27, 29), 29
UNKNOWN_MPS = 1.0
"""Velocity at the start, before the first odometer speed."""
RAILS_MPS = 1e-3
"""A simulated car leaves its rails by nothing at all; this keeps covariances regular."""
STRAIGHT_RAD, ANY_RAD = 1e-5, 1.0
"""A straight's course is that of the train, whatever it is; uneven rails turn a train by more."""
KNOTS = 2.0
"""The map's error is drawn so many times in its correlation length, and smooth between."""
GRAVITY = 9.8

IN_PLACE_OF = {False: ('robust', 'smoothed'), True: ('robust_map', 'smoothed_map')}
"""Whether there is a map -> what the best filter and the best smoother stand beside."""

DRAWS = 100
"""Exams that are drawn of the best estimator, each along the true ways of all runs."""


@dataclasses.dataclass(frozen=True)
class System:
    """
    A linear system with normal errors, by epochs: x' = F x + w, z = H x + v.

    Attributes:
        P: (n, n) of the state at the first epoch.
        F: (K - 1, n, n) from each epoch to the next.
        Q: (K - 1, n, n) covariances of w.
        H: K matrices (m, n), m by epoch.
        R: K variances (m,) of v.
    """

    P: Array
    F: Array
    Q: Array
    H: list[Array]
    R: list[Array]


class Unknown(NamedTuple):
    """What the simulator has fixed and an estimator may be told, or not: N(0, this)."""

    scale: float = 1e-9
    map_m: float = 1e-6


TOLD = Unknown()
UNTOLD_MAP_M = 0.4
"""What a surveyed map may be off as a whole, where nobody says that it is not."""


def floors(run: SimulatedRun, config: TrainSimConfig, seed: int) -> dict[str, float]:
    """
    Return the greatest level error in a run's first outage [m] that the best estimators have.

    Named as the method that may reach it and the draw, ``robust.0``; ``untold.robust.0`` where the
    odometer's scale and the map's offset are not told.
    """
    rng = np.random.default_rng((seed, DRAWS))
    untold = Unknown(config.odometer.scale, UNTOLD_MAP_M)
    out: dict[str, float] = {}
    for prefix, unknown in (('', TOLD), ('untold.', untold)):
        for with_map, names in IN_PLACE_OF.items():
            time_s, errors = floor_errors(run, config, rng, DRAWS, with_map, unknown)
            for name, error in zip(names, (errors.filtered, errors.smoothed), strict=True):
                most = greatest(time_s, error, run.outages[0])
                out |= {f'{prefix}{name}.{k}': float(value) for k, value in enumerate(most)}
    return out


def greatest(time_s: Array, error: Array, span: tuple[float, float]) -> Array:
    """Return the greatest level error within a span (draws,) [m], of errors (K, n, draws)."""
    inside = (time_s >= span[0]) & (time_s < span[1])
    return np.asarray(np.hypot(error[inside, 0], error[inside, 1]).max(axis=0))


class Errors(NamedTuple):
    """Errors (K, n, draws) of the best filter and smoother, and their covariances (K, n, n)."""

    filtered: Array
    smoothed: Array
    P_filtered: Array
    P_smoothed: Array


def floor_errors(
    run: SimulatedRun,
    config: TrainSimConfig,
    rng: Generator,
    draws: int,
    with_map: bool,
    unknown: Unknown = TOLD,
) -> tuple[Array, Errors]:
    """Return stamps (K,) [s] and drawn errors of the best estimators along a run's true way."""
    time_s = np.arange(run.time_s[0], run.time_s[-1], STEP_S)
    F, Q = _transitions(run, config, time_s)
    H, R = _measurements(run, config, time_s, with_map)
    return time_s, best_errors(System(_start(config, unknown), F, Q, H, R), rng, draws)


def best_errors(system: System, rng: Generator, draws: int) -> Errors:
    """Draw what truly happens; return how far the best filter and the best smoother are off."""
    x = _drawn(rng, system.P, draws)
    mean, P = np.zeros_like(x), system.P
    truths, means, covariances, before = [], [], [], []
    for k, (H, R) in enumerate(zip(system.H, system.R, strict=True)):
        if k:
            F, Q = system.F[k - 1], system.Q[k - 1]
            x = F @ x + _drawn(rng, Q, draws)
            mean, P = F @ mean, F @ P @ F.T + Q
        before.append(P)
        if len(R):
            z = H @ x + np.sqrt(R)[:, None] * rng.standard_normal((len(R), draws))
            gain = np.linalg.solve(H @ P @ H.T + np.diag(R), H @ P).T
            rest = np.eye(len(P)) - gain @ H
            mean, P = mean + gain @ (z - H @ mean), rest @ P @ rest.T + (gain * R) @ gain.T
        truths.append(x)
        means.append(mean)
        covariances.append(P)
    truth, filtered, P_filtered = np.array(truths), np.array(means), np.array(covariances)
    smoothed, P_smoothed = filtered.copy(), P_filtered.copy()
    for k in range(len(truth) - 2, -1, -1):
        F = system.F[k]
        G = np.linalg.solve(before[k + 1], F @ P_filtered[k]).T
        smoothed[k] += G @ (smoothed[k + 1] - F @ filtered[k])
        P_smoothed[k] += G @ (P_smoothed[k + 1] - before[k + 1]) @ G.T
    return Errors(filtered - truth, smoothed - truth, P_filtered, P_smoothed)


def _start(config: TrainSimConfig, unknown: Unknown) -> Array:
    """Return the covariance of the errors of an aligned start (n, n)."""
    accel, gyro = figures_of(config.imu)
    level, yaw = start_sigmas(config.start, config.imu)
    sigma = np.zeros(SIZE)
    sigma[R] = config.start.horizontal_m, config.start.horizontal_m, config.start.vertical_m
    sigma[V], sigma[PSI] = UNKNOWN_MPS, (level, level, yaw)
    sigma[GYRO], sigma[GYRO_WANDER] = gyro.bias, gyro.wander
    sigma[ACCEL], sigma[ACCEL_WANDER] = accel.bias, accel.wander
    sigma[MOUNT] = np.radians(config.odometer.mount_deg)
    sigma[SLOW] = config.gnss.drift_m, config.gnss.drift_m, config.gnss.drift_up_m
    sigma[SCALE], sigma[OFFSET] = unknown
    sigma[LINE] = ANY_RAD
    return np.asarray(np.diag(sigma**2))


def _transitions(run: SimulatedRun, config: TrainSimConfig, time_s: Array) -> tuple[Array, Array]:
    """Return F and Q (K - 1, n, n) between epochs (K,)."""
    accel, gyro = figures_of(config.imu)
    steps, middle = np.diff(time_s), 0.5 * (time_s[1:] + time_s[:-1])
    row = np.searchsorted(run.time_s, middle)
    C = so3.matrix_from_quat(run.local.quaternion[row])
    force = np.gradient(run.local.velocity, run.time_s, axis=0)[row] + np.array([0, 0, GRAVITY])
    A = np.zeros((len(steps), SIZE, SIZE))
    A[:, R, V] = np.eye(3)
    A[:, V, PSI] = -so3.hat(force)
    A[:, V, ACCEL] = A[:, V, ACCEL_WANDER] = C
    A[:, PSI, GYRO] = A[:, PSI, GYRO_WANDER] = C
    A *= steps[:, None, None]
    F = np.eye(SIZE) + A + 0.5 * A @ A
    Q = np.zeros_like(F)
    Q[:, V, V] = np.eye(3) * (accel.density**2 * steps)[:, None, None]
    Q[:, PSI, PSI] = np.eye(3) * (gyro.density**2 * steps)[:, None, None]
    slow = config.gnss.drift_m, config.gnss.drift_m, config.gnss.drift_up_m
    drift_s = float(run.info['gnss']['drift_s'])
    for part, sigma, lasting_s in (
        (GYRO_WANDER, gyro.wander, config.imu.in_run_s),
        (ACCEL_WANDER, accel.wander, config.imu.in_run_s),
        (SLOW, np.array(slow), drift_s),
    ):
        keep = np.exp(-steps / lasting_s)[:, None, None]
        F[:, part, part] = np.eye(3) * keep
        Q[:, part, part] = np.eye(3) * (1.0 - keep**2) * np.square(sigma)
    straight = _straight(run, time_s)
    begins = straight[1:] & ~straight[:-1]
    F[begins, LINE, LINE], Q[begins, LINE, LINE] = 0.0, ANY_RAD**2
    return F, Q


def _straight(run: SimulatedRun, time_s: Array) -> NDArray[np.bool_]:
    """Return which epochs (K,) are on a straight."""
    s = np.interp(time_s, run.time_s, run.chainage)
    curves = np.array(run.info['curves_m']).reshape(-1, 2)
    inside = (s[:, None] >= curves[:, 0]) & (s[:, None] <= curves[:, 1])
    return np.asarray(~inside.any(axis=1))


def _measurements(
    run: SimulatedRun, config: TrainSimConfig, time_s: Array, with_map: bool
) -> tuple[list[Array], list[Array]]:
    """Return H (m, n) and the variances (m,) at each epoch."""
    row = np.clip(np.searchsorted(run.time_s, time_s), 0, len(run.time_s) - 1)
    C = so3.matrix_from_quat(run.local.quaternion[row])
    velocity, speed = run.local.velocity[row], run.speed[row]
    odometer = config.odometer.noise_m**2 * config.odometer.rate_hz / STEP_S
    car = np.zeros((len(row), 3, SIZE))
    car[:, :, V] = np.swapaxes(C @ run.mount, 1, 2)
    car[:, :, PSI] = car[:, :, V] @ so3.hat(velocity)
    car[:, 0, SCALE], car[:, 1, MOUNT.start], car[:, 2, MOUNT.start + 1] = speed, speed, -speed
    rails = np.array([odometer, RAILS_MPS**2, RAILS_MPS**2])
    H, variances = list(car), [rails] * len(row)
    if with_map:
        told = run.info['track']
        across = np.stack([-velocity[:, 1], velocity[:, 0]], axis=1)
        across /= np.hypot(velocity[:, 0], velocity[:, 1])[:, None]
        knots = speed * STEP_S * KNOTS / config.survey.correlation_m
        for k in range(len(row)):
            beside = np.zeros((2, SIZE))
            beside[0, :2], beside[1, 2], beside[:, OFFSET] = across[k], 1.0, -np.eye(2)
            H[k] = np.concatenate([H[k], beside])
            wander = np.array([told['cross_m'], told['height_m']]) ** 2 / knots[k]
            variances[k] = np.concatenate([variances[k], wander])
    line = np.zeros((1, SIZE))
    line[0, PSI.stop - 1], line[0, LINE] = 1.0, -1.0
    for k in np.flatnonzero(_straight(run, time_s)).tolist():
        H[k] = np.concatenate([H[k], line])
        variances[k] = np.append(variances[k], STRAIGHT_RAD**2)
    for k, hdop in _fixes(run, time_s):
        fix = np.zeros((3, SIZE))
        fix[:, R], fix[:, SLOW] = np.eye(3), -hdop * np.eye(3)
        white = np.array([config.gnss.noise_m, config.gnss.noise_m, config.gnss.noise_up_m])
        H[k] = np.concatenate([H[k], fix])
        variances[k] = np.concatenate([variances[k], (hdop * white) ** 2])
    return H, variances


def _fixes(run: SimulatedRun, time_s: Array) -> list[tuple[int, float]]:
    """Return the epoch nearest to each fix that is no reflection, and its HDOP."""
    gnss = run.gnss
    since = gnss.time_s - run.time_s[0]
    reflected = np.isin(np.round(since, 6), np.round(run.info['gnss']['reflected_s'], 6))
    good = gnss.status & ~reflected
    epoch = np.clip(np.rint(since[good] / STEP_S).astype(int), 0, len(time_s) - 1)
    return list(zip(epoch.tolist(), gnss.hdop[good].tolist(), strict=True))


def _drawn(rng: Generator, covariance: Array, draws: int) -> Array:
    """Return draws (n, draws) of a covariance that may be singular."""
    value, vector = np.linalg.eigh(covariance)
    scaled = vector * np.sqrt(np.maximum(value, 0.0))
    return np.asarray(scaled @ rng.standard_normal((len(value), draws)))

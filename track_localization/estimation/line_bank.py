"""
Several hypotheses of one vehicle on a line, each a line filter of its own, weighed by likelihood.

One hypothesis is the usual case. Where the start, the mount or the whole position is in doubt
there are many, and what the sensor shows decides. Beside them stands the chance that none of them
is right: the probability of being lost.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import line_motion, line_rows, line_state, line_updates

Array = NDArray[np.float64]

LOST_SIGMA = 0.15
"""How far the attitude is off, about each axis, where a hypothesis is wrong [rad]."""
LOST_FORCE = 5.0
"""How far the force across the line is off, along each axis, where one is wrong [m/s^2]."""
LOST_RATE = 1e-4
"""Chance per second that a right hypothesis becomes wrong."""
INDEPENDENT_S, INDEPENDENT_RAD = 0.6, 0.15
"""Comparisons with the line closer than this, in time or in turn, tell the same."""
SAME_MOUNT = float(np.cos(np.deg2rad(5.0)))
"""Cosine of the angle within which two mounts are the same."""
STILL_ACCEL = 0.1
"""A vehicle that stands is not pulled along its line by more than this [m/s^2]."""


@numba.njit(cache=True)
def advance_all(
    X: Array, sums: Array, f: Array, w: Array, dt: float, rows: Array, step: float, closed: bool
) -> None:
    """Move every hypothesis by one IMU step; see ``line_motion.advance``."""
    for h in range(len(X)):
        line_motion.advance(X[h], sums[h], f, w, dt, rows, step, closed)


@numba.njit(cache=True)
def close_epoch(
    x: Array,
    P: Array,
    sums: Array,
    driven: Array,
    rows: Array,
    step: float,
    closed: bool,
    settings: Array,
    noise: Array,
    mean: Array,
    shake: Array,
    rate_std: float,
    quiet: bool,
    level_due: bool,
    nis: Array,
) -> tuple[Array, Array, Array, float, bool]:
    """
    Predict, compare with the line, and fuse what else is known, for one hypothesis.

    ``settings`` (11,): of ``match_attitude`` (4), ``match_speed`` (2), sigma of a standstill,
    multiples of the force's and rate's shake, least white acceleration per sample at 100 Hz
    [m/s^2], scale error of the force. ``noise`` (6,): of ``predict``; what the shake and errors
    that last add is added here. ``mean`` (6,): running means of force and rate. ``shake`` (6,):
    variances above 4 Hz of force and rate; ``rate_std``: standard deviation of the rate. ``quiet``:
    the sensor shakes no more than at rest; ``level_due``: a standstill may be levelled by. The rest
    is as in ``line_motion`` and ``line_updates``.

    Return F, the prediction (x, P), the log likelihood, and whether it stands.
    """
    T = max(sums[line_motion.SUM_TIME], 1e-6)
    M = x[11:20].copy().reshape((3, 3))
    force = M @ (sums[line_motion.SUM_FORCE : line_motion.SUM_FORCE + 3] / T - x[26:29])
    own = noise.copy()
    along = M[0, 0] ** 2 * shake[0] + M[0, 1] ** 2 * shake[1] + M[0, 2] ** 2 * shake[2]
    own[0] += max(settings[9] ** 2, settings[7] ** 2 * along) / 100.0
    own[0] += line_motion.lasting_noise(x, force, rows, step, closed, settings[0], settings[10])
    own[1] += settings[8] ** 2 * (shake[3] + shake[4] + shake[5]) / 300.0
    F = line_motion.predict(x, P, sums, own, rows, step, closed)
    still = False
    if quiet and abs(x[1]) < 0.3 + 2.0 * np.sqrt(P[1, 1]):
        b = M @ (mean[0:3] - x[26:29])
        pull = line_rows.acceleration(rows, step, closed, x[0], 0.0, b[0], b[1], b[2])
        still = abs(pull) < STILL_ACCEL
    follows = still
    if still:
        driven[0] = 0.0
    else:
        strongest = np.sqrt(max(shake[0], shake[1], shake[2]))
        follows = line_motion.follow_drive(
            x, P, F, T, rows, step, closed, driven, force, strongest, noise[5]
        )
    x_before, P_before = x.copy(), P.copy()
    if still:
        likelihood = line_updates.match_attitude(
            x.copy(), P.copy(), T, rows, step, closed, settings[0:4], nis
        )
        line_updates.hold(x, P, settings[6])
        if level_due:
            line_updates.level(x, P, mean[0:3], 0.02)
            line_updates.still_gyro(x, P, mean[3:6], max(0.3 * rate_std, 2e-4))
    else:
        likelihood = line_updates.match_attitude(x, P, T, rows, step, closed, settings[0:4], nis)
    if not follows:
        line_updates.match_speed(x, P, T, rows, step, closed, settings[4:6])
    return F, x_before, P_before, likelihood, still


@numba.njit(cache=True)
def close_all(
    X: Array,
    P: Array,
    sums: Array,
    driven: Array,
    log_weight: Array,
    rows: Array,
    step: float,
    closed: bool,
    settings: Array,
    noise: Array,
    mean: Array,
    shake: Array,
    rate_std: float,
    quiet: bool,
    level_due: bool,
    force_sigma: float,
    share: float,
    force_share: float,
) -> None:
    """
    Close the epoch of every hypothesis and weigh it: by attitude, and by the force across.

    ``log_weight`` (H,) is changed in place. ``force_sigma`` [m/s^2] is the noise of an epoch's
    mean force, ``share`` and ``force_share`` how much of the epoch's attitude and force is news;
    see ``close_epoch`` for the rest.
    """
    nis = np.zeros(3)
    for h in range(len(X)):
        x = X[h]
        T = max(sums[h, line_motion.SUM_TIME], 1e-6)
        f = sums[h, line_motion.SUM_FORCE : line_motion.SUM_FORCE + 3] / T - x[26:29]
        f = x[11:20].copy().reshape((3, 3)) @ f
        _, _, _, likelihood, _ = close_epoch(
            x,
            P[h],
            sums[h],
            driven[h],
            rows,
            step,
            closed,
            settings,
            noise,
            mean,
            shake,
            rate_std,
            quiet,
            level_due,
            nis,
        )
        across = force_likelihood(x, P[h], f, force_sigma, rows, step, closed)
        log_weight[h] += share * likelihood + force_share * across


@numba.njit(cache=True)
def force_likelihood(
    x: Array, P: Array, f: Array, sigma: float, rows: Array, step: float, closed: bool
) -> float:
    """
    Return the log likelihood of the specific force (3,) in body axes, across the line.

    It weighs hypotheses and moves none: its errors (sway, map) last too long to fuse.
    """
    i, _ = line_rows.row_of(rows, step, closed, x[0])
    row = rows[i]
    turn, t = row[9:12], row[12:15]
    v = x[1] * row[15]
    # Centripetal force of a body that turns with its path, and gravity in its axes.
    across = np.empty(2)
    across[0] = (turn[2] * t[0] - turn[0] * t[2]) * v * x[1] + row[7] * 9.80665
    across[1] = (turn[0] * t[1] - turn[1] * t[0]) * v * x[1] + row[8] * 9.80665
    bend = np.array([abs(turn[2]) + abs(turn[0]), abs(turn[1]) + abs(turn[0])])
    j, _ = line_rows.row_of(rows, step, closed, x[0] + 2.0)
    out = 0.0
    for k in range(2):
        ahead = abs(rows[j, 7 + k] - row[7 + k]) * 4.9 * np.sqrt(P[0, 0])
        mount = (P[5, 5] + P[6, 6] + P[7, 7]) / 3.0 * (f[0] ** 2 + f[1] ** 2 + f[2] ** 2)
        spread = (2.0 * bend[k] * v) ** 2 * P[1, 1] + ahead * ahead + sigma * sigma + mount
        miss = f[1 + k] - across[k]
        out -= 0.5 * (min(miss * miss / spread, 40.0) + np.log(spread))
    return out


LOST_LIKELIHOOD = -1.5 * (1.0 + float(np.log(LOST_SIGMA**2)))
"""Log likelihood of a comparison with the line where no hypothesis is right."""
LOST_FORCE_LIKELIHOOD = -(1.0 + float(np.log(LOST_FORCE**2)))
"""The same of the force across the line."""


@numba.njit(cache=True)
def news(
    T: float, rate: Array, X: Array, log_weight: Array, rows: Array, step: float, closed: bool
) -> float:
    """
    Return how much of a comparison with the line is news, between 0 and 1.

    After ``T`` [s] in which the sensor showed the mean ``rate`` (3,) [rad/s], or the line turned
    under the hypotheses by their weight: what does not turn shows the same again.
    """
    sensor = 0.0
    for j in range(3):
        sensor += (rate[j] - X[0, 20 + j]) ** 2
    most, total, line = log_weight.max(), 0.0, 0.0
    for h in range(len(X)):
        i, _ = line_rows.row_of(rows, step, closed, X[h, 0])
        bend = np.sqrt(rows[i, 9] ** 2 + rows[i, 10] ** 2 + rows[i, 11] ** 2)
        weight = np.exp(log_weight[h] - most)
        total += weight
        line += weight * bend * abs(X[h, 1])
    turned = max(np.sqrt(sensor), line / total) * T
    return min(1.0, T / INDEPENDENT_S, turned / INDEPENDENT_RAD)


@numba.njit(cache=True)
def merge(X: Array, P: Array, log_weight: Array, least: float, lap_m: float) -> NDArray[np.int64]:
    """
    Return the indices of the hypotheses worth keeping, the heaviest first.

    One that is where a heavier one is becomes one with it, of their common mean and covariance;
    one lighter than ``least`` times the heaviest goes. ``lap_m``: after so many metres it is the
    same place again (infinite on an open line). Everything is changed in place.
    """
    order = np.argsort(-log_weight)
    kept = np.empty(len(order), dtype=np.int64)
    count = 0
    limit = log_weight[order[0]] + np.log(least)
    for h in order:
        if log_weight[h] < limit:
            break
        twin = -1
        for k in kept[:count]:
            apart = abs(X[h, 0] - X[k, 0])
            if np.isfinite(lap_m):
                apart = abs(apart - lap_m * np.rint(apart / lap_m))
            if apart >= 0.5 * (np.sqrt(P[h, 0, 0]) + np.sqrt(P[k, 0, 0])):
                continue
            turned = 0.0
            for j in range(11, 20):
                turned += X[h, j] * X[k, j]
            if abs(X[h, 1] - X[k, 1]) < 1.0 and 0.5 * (turned - 1.0) > SAME_MOUNT:
                twin = k
                break
        if twin < 0:
            kept[count] = h
            count += 1
        else:
            light = np.exp(log_weight[h] - log_weight[twin])
            log_weight[twin] += np.log1p(light)
            _unite(X[twin], P[twin], X[h], P[h], light / (1.0 + light), lap_m)
    return kept[:count]


@numba.njit(cache=True)
def _unite(x: Array, P: Array, x_other: Array, P_other: Array, share: float, lap_m: float) -> None:
    """Give a hypothesis the moments of itself and of ``share`` of another one, in place."""
    d = line_state.difference(x_other, x)
    if np.isfinite(lap_m):
        d[0] -= lap_m * np.rint(d[0] / lap_m)
    P *= 1.0 - share
    P += share * P_other
    for r in range(line_state.ERRORS):
        for c in range(line_state.ERRORS):
            P[r, c] += share * (1.0 - share) * d[r] * d[c]
    line_state.add_error(x, share * d)

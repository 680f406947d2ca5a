"""
Kalman filter of a vehicle that rides on a known line: its position is one number, the chainage.

The attitude integrated from the gyro is compared with the line's own: a line that turns tells
where on it the vehicle is, whatever its speed did. The specific force along the line drives the
speed, a usual speed by chainage may help, and standstill is a measurement.

Nominal state x (30,): chainage s [m], its rate v [m/s], C (9, sensor to map), M (9, sensor to
body), gyro bias (3) [rad/s], gyro scale (3), accelerometer bias (3) [m/s^2] and pace (how much
faster than usual the vehicle is here, a share). Error state (18,): s, v, tilt (C = exp(tilt) C^),
mount (M = exp(mount) M^), biases, scale and pace. Everything is compiled and changes ``x`` and
``P`` in place.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.estimation.so3 import exp_one, log_one, normalised_one

Array = NDArray[np.float64]

NOMINAL, ERRORS = 30, 18
S, V, TILT, MOUNT, GYRO_BIAS, GYRO_SCALE, ACCEL_BIAS, PACE = 0, 1, 2, 5, 8, 11, 14, 17
X_ATTITUDE, X_MOUNT, X_GYRO_BIAS, X_GYRO_SCALE, X_ACCEL_BIAS, X_PACE = 2, 11, 20, 23, 26, 29

SUM_TIME, SUM_FORCE, SUM_TURN, SUM_SCALED, SUMS = 0, 1, 4, 13, 22
"""What is summed between two epochs: time, force (3), C dt (9), C diag(w) dt (9)."""

# Columns of a row of the line, see LineMap.
_TURNING, _TANGENT, _STRETCH, _LEVER, _CLIMB = 9, 12, 15, 16, 17
_SPEED, _SPEED_SIGMA, _SIGMA, _RENEWAL = 18, 19, 20, 21
_BACK = 22
SQRT3 = np.sqrt(3.0)
DRIVEN_ACCEL, DRIVEN_S = 0.25, 0.5
"""An unusual drive or brake is at least this strong [m/s^2], over this time [s]."""
SLOWEST = 0.5
"""Below this no speed is usual: the vehicle stops, starts or waits [m/s]."""
STOPPED = 0.3
"""A vehicle slower than this has stopped [m/s]."""
ROLLBACK = -0.5
"""A vehicle slower than this runs backward [m/s]."""
DRIVEN_PACE = 0.005
"""What is then left of the pace's uncertainty beside the speed's own."""


@numba.njit(cache=True)
def row_of(rows: Array, step: float, closed: bool, s: float) -> tuple[int, float]:
    """Return the row below ``s`` and the share of the next one; ends hold on open lines."""
    last = len(rows) - 1
    at = s / step
    if closed:
        at -= last * np.floor(at / last)
    at = min(max(at, 0.0), float(last))
    i = min(int(at), last - 1)
    return i, at - i


@numba.njit(cache=True)
def attitude_at(rows: Array, step: float, closed: bool, s: float) -> Array:
    """Return the body's attitude (3, 3) at chainage ``s``."""
    i, share = row_of(rows, step, closed, s)
    R = rows[i, 0:9].copy().reshape((3, 3))
    return R @ exp_one(rows[i, _TURNING : _TURNING + 3] * (share * step))


@numba.njit(cache=True)
def acceleration(
    rows: Array, step: float, closed: bool, s: float, v: float, f0: float, f1: float, f2: float
) -> float:
    """Return s'' [m/s^2] under the specific force (f0, f1, f2) in body axes."""
    i, share = row_of(rows, step, closed, s)
    a, b = rows[i], rows[i + 1]
    rest = 1.0 - share
    along = (rest * a[_TANGENT] + share * b[_TANGENT]) * f0
    along += (rest * a[_TANGENT + 1] + share * b[_TANGENT + 1]) * f1
    along += (rest * a[_TANGENT + 2] + share * b[_TANGENT + 2]) * f2
    along -= rest * a[_CLIMB] + share * b[_CLIMB]
    if closed or 0.0 <= s <= (len(rows) - 1) * step:
        # Beyond the ends of an open line it goes on straight.
        along -= (rest * a[_LEVER] + share * b[_LEVER]) * v * v
    return along / (rest * a[_STRETCH] + share * b[_STRETCH])


@numba.njit(cache=True)
def advance(
    x: Array, sums: Array, f: Array, w: Array, dt: float, rows: Array, step: float, closed: bool
) -> None:
    """Move the nominal state by one IMU step of mean force and rate ``f``, ``w`` (sensor axes)."""
    C = x[2:11].copy().reshape((3, 3))
    M = x[11:20].copy().reshape((3, 3))
    turn = np.empty(3)
    force = np.empty(3)
    for j in range(3):
        turn[j] = ((1.0 - x[X_GYRO_SCALE + j]) * w[j] - x[X_GYRO_BIAS + j]) * dt
        force[j] = f[j] - x[X_ACCEL_BIAS + j]
    middle = C @ exp_one(0.5 * turn)
    sums[SUM_TIME] += dt
    for i in range(3):
        sums[SUM_FORCE + i] += f[i] * dt
        for j in range(3):
            sums[SUM_TURN + 3 * i + j] += middle[i, j] * dt
            sums[SUM_SCALED + 3 * i + j] += middle[i, j] * w[j] * dt
    body = M @ force
    s, v = x[0], x[1]
    half = s + 0.5 * v * dt
    a = acceleration(rows, step, closed, half, v, body[0], body[1], body[2])
    x[0] = s + v * dt + 0.5 * a * dt * dt
    x[1] = v + a * dt
    x[2:11] = normalised_one(C @ exp_one(turn)).ravel()


@numba.njit(cache=True)
def predict(
    x: Array, P: Array, sums: Array, noise: Array, rows: Array, step: float, closed: bool
) -> Array:
    """
    Carry ``P`` over the epoch that ``sums`` describes, clear them, return the transition (18, 18).

    ``noise`` (6,): white acceleration along the line, white rate [(m/s^2)^2 s, (rad/s)^2 s], the
    walks of gyro bias, accelerometer bias and mount [units^2/s], standard deviation of the pace.
    """
    T = sums[SUM_TIME]
    F = np.eye(ERRORS)
    if T <= 0.0:
        return F
    M = x[11:20].copy().reshape((3, 3))
    force = np.empty(3)
    for j in range(3):
        force[j] = sums[SUM_FORCE + j] / T - x[X_ACCEL_BIAS + j]
    b = M @ force
    s, v = x[0], x[1]
    reach = min(max(SQRT3 * np.sqrt(P[0, 0]), 0.5), 10.0)
    ahead = acceleration(rows, step, closed, s + reach, v, b[0], b[1], b[2])
    behind = acceleration(rows, step, closed, s - reach, v, b[0], b[1], b[2])
    a_s = (ahead - behind) / (2.0 * reach)
    i, _ = row_of(rows, step, closed, s)
    row = rows[i]
    a_v = -2.0 * row[_LEVER] * v / row[_STRETCH]
    t = row[_TANGENT : _TANGENT + 3] / row[_STRETCH]
    a = np.zeros(ERRORS)
    a[S], a[V] = a_s, a_v
    a[MOUNT] = b[1] * t[2] - b[2] * t[1]
    a[MOUNT + 1] = b[2] * t[0] - b[0] * t[2]
    a[MOUNT + 2] = b[0] * t[1] - b[1] * t[0]
    for j in range(3):
        a[ACCEL_BIAS + j] = -(M[0, j] * t[0] + M[1, j] * t[1] + M[2, j] * t[2])
    for j in range(ERRORS):
        F[S, j] += 0.5 * T * T * a[j]
        F[V, j] += T * a[j]
    F[S, V] += T
    for k in range(3):
        for j in range(3):
            F[TILT + k, GYRO_BIAS + j] = -sums[SUM_TURN + 3 * k + j]
            F[TILT + k, GYRO_SCALE + j] = -sums[SUM_SCALED + 3 * k + j]
    # A vehicle that has stopped, or turns back, starts with a pace of its own.
    keep = np.exp(-abs(v) * T * row[_RENEWAL]) if abs(v) > STOPPED else 0.0
    F[PACE, PACE] = keep
    x[X_PACE] *= keep
    P[PACE, :] *= keep
    P[:, PACE] *= keep
    P[PACE, PACE] += noise[5] ** 2 * (1.0 - keep * keep)
    FP = P.copy()
    for r in range(5):
        for c in range(ERRORS):
            total = 0.0
            for k in range(ERRORS):
                total += F[r, k] * P[k, c]
            FP[r, c] = total
    P[:, :] = FP
    for c in range(5):
        for r in range(c, ERRORS):
            total = 0.0
            for k in range(ERRORS):
                total += FP[r, k] * F[c, k]
            P[r, c] = total
            P[c, r] = total
    q = noise[0]
    P[S, S] += q * T**3 / 3.0
    P[S, V] += q * T**2 / 2.0
    P[V, S] += q * T**2 / 2.0
    P[V, V] += q * T
    for k in range(3):
        P[TILT + k, TILT + k] += noise[1] * T
        P[GYRO_BIAS + k, GYRO_BIAS + k] += noise[2] * T
        P[ACCEL_BIAS + k, ACCEL_BIAS + k] += noise[3] * T
        P[MOUNT + k, MOUNT + k] += noise[4] * T
    sums[:] = 0.0
    return F


@numba.njit(cache=True)
def add_error(x: Array, e: Array) -> None:
    """Correct the nominal state by an error (18,)."""
    x[0] += e[S]
    x[1] += e[V]
    C = exp_one(e[TILT : TILT + 3]) @ x[2:11].copy().reshape((3, 3))
    M = exp_one(e[MOUNT : MOUNT + 3]) @ x[11:20].copy().reshape((3, 3))
    x[2:11] = normalised_one(C).ravel()
    x[11:20] = normalised_one(M).ravel()
    x[20:30] += e[GYRO_BIAS:ERRORS]


@numba.njit(cache=True)
def difference(x: Array, reference: Array) -> Array:
    """Return the error (18,) that takes ``reference`` to ``x``."""
    e = np.empty(ERRORS)
    e[S], e[V] = x[0] - reference[0], x[1] - reference[1]
    for first, k in ((2, TILT), (11, MOUNT)):
        A = x[first : first + 9].copy().reshape((3, 3))
        B = reference[first : first + 9].copy().reshape((3, 3))
        e[k : k + 3] = log_one(A @ np.ascontiguousarray(B.T))
    e[GYRO_BIAS:ERRORS] = x[20:30] - reference[20:30]
    return e


@numba.njit(cache=True)
def correct(x: Array, P: Array, nu: Array, H: Array, R: Array) -> None:
    """
    Fuse a measurement of independent parts: ``nu`` (m,), ``H`` (m, 18), variances ``R`` (m,).

    One part at a time, which needs no inverse; then the nominal state takes the error over.
    """
    e = np.zeros(ERRORS)
    for i in range(len(nu)):
        h = H[i]
        Ph = P @ h
        variance = np.dot(h, Ph) + R[i]
        gain = Ph / variance
        e += gain * (nu[i] - np.dot(h, e))
        for r in range(ERRORS):
            for c in range(r, ERRORS):
                P[r, c] -= gain[r] * Ph[c]
                P[c, r] = P[r, c]
    add_error(x, e)
    # Tilt and mount are now measured from the corrected attitudes.
    for k in (TILT, MOUNT):
        angle = e[k : k + 3]
        if np.dot(angle, angle) < 1e-8:
            continue
        G = exp_one(0.5 * angle)
        block = G @ np.ascontiguousarray(P[k : k + 3, :])
        P[k : k + 3, :] = block
        P[:, k : k + 3] = np.ascontiguousarray(P[:, k : k + 3]) @ np.ascontiguousarray(G.T)


@numba.njit(cache=True)
def residual(x: Array, s: float, rows: Array, step: float, closed: bool) -> Array:
    """Return the rotation vector (3,) from the line's attitude at ``s`` to the body's own."""
    C = x[2:11].copy().reshape((3, 3))
    M = x[11:20].copy().reshape((3, 3))
    R = attitude_at(rows, step, closed, s)
    return log_one(np.ascontiguousarray(R.T) @ C @ np.ascontiguousarray(M.T))


@numba.njit(cache=True)
def log_slope(r: Array) -> Array:
    """Return how log(exp(d) exp(r)) grows with d (3, 3), to the first order in ``r`` (3,)."""
    return np.array(
        [
            [1.0, 0.5 * r[2], -0.5 * r[1]],
            [-0.5 * r[2], 1.0, 0.5 * r[0]],
            [0.5 * r[1], -0.5 * r[0], 1.0],
        ]
    )


@numba.njit(cache=True)
def match_attitude(
    x: Array,
    P: Array,
    T: float,
    rows: Array,
    step: float,
    closed: bool,
    settings: Array,
    nis: Array,
) -> float:
    """
    Fuse the comparison of the body's attitude with the line's; return its log likelihood.

    ``settings`` (4,): correlation length of the line's errors [m], soft gate, sigma_s above which
    the line is linearised statistically [m], most that it looks ahead [m]. ``nis`` (3,) takes the
    normalised squared innovation of each axis.
    """
    s = x[0]
    i, _ = row_of(rows, step, closed, s)
    sigma = np.sqrt(P[0, 0])
    r = residual(x, s, rows, step, closed)
    slope = -(log_slope(r) @ rows[i, _TURNING : _TURNING + 3])
    spread = np.zeros(3)
    if sigma > settings[2]:
        # Three points carry the line's bends into the innovation (a statistical linearisation).
        ahead = min(SQRT3 * sigma, settings[3])
        far = ahead / SQRT3
        plus = residual(x, s + ahead, rows, step, closed)
        minus = residual(x, s - ahead, rows, step, closed)
        mean = (4.0 * r + plus + minus) / 6.0
        slope = (plus - minus) / (2.0 * ahead)
        for j in range(3):
            square = (4.0 * (r[j] - mean[j]) ** 2) / 6.0
            square += ((plus[j] - mean[j]) ** 2 + (minus[j] - mean[j]) ** 2) / 6.0
            spread[j] = max(square - (slope[j] * far) ** 2, 0.0)
        r = mean
    H = np.zeros((3, ERRORS))
    R = np.ascontiguousarray(attitude_at(rows, step, closed, s).T)
    half = log_slope(r)
    H[:, TILT : TILT + 3] = half @ R
    H[:, MOUNT : MOUNT + 3] = -np.ascontiguousarray(half.T)
    for j in range(3):
        H[j, S] = slope[j]
    moved = max(abs(x[1]) * T, 1e-4)
    variance = rows[i, _SIGMA] ** 2 * max(1.0, settings[0] / moved)
    noise = np.empty(3)
    likelihood = 0.0
    for j in range(3):
        noise[j] = variance + spread[j]
        own = np.dot(H[j], P @ H[j]) + noise[j]
        ratio = r[j] * r[j] / own
        nis[j] = ratio
        spot = own - variance + rows[i, _SIGMA] ** 2
        likelihood -= 0.5 * (min(r[j] * r[j] / spot, 40.0) + np.log(spot))
        if ratio > settings[1]:
            noise[j] += own * (ratio / settings[1] - 1.0)
    correct(x, P, -r, H, noise)
    return likelihood


@numba.njit(cache=True)
def usual_speed(
    rows: Array, step: float, closed: bool, s: float, v: float, sigma: float
) -> tuple[float, float, float]:
    """
    Return the usual speed at ``s`` [m/s], its slope [1/s] and spread; NaN where not known.

    That of running backward, which is negative, where ``v`` says that the vehicle does.
    """
    column = _SPEED if v > ROLLBACK else _BACK
    i, share = row_of(rows, step, closed, s)
    usual = (1.0 - share) * rows[i, column] + share * rows[i + 1, column]
    reach = min(max(SQRT3 * sigma, 0.5), 10.0)
    j, _ = row_of(rows, step, closed, s + reach)
    k, _ = row_of(rows, step, closed, s - reach)
    return usual, (rows[j, column] - rows[k, column]) / (2.0 * reach), rows[i, column + 1]


@numba.njit(cache=True)
def follow_drive(
    x: Array,
    P: Array,
    F: Array,
    T: float,
    rows: Array,
    step: float,
    closed: bool,
    driven: Array,
    force: Array,
    shake: float,
) -> bool:
    """
    Let the pace follow the speed where the vehicle is driven or braked as it usually is not.

    Part of the prediction: ``F`` is changed with ``P``. ``driven`` (1,) averages the unusual
    acceleration, from the specific ``force`` (3,) in body axes, whose noise is ``shake`` [m/s^2].
    Return whether it is so; never where the vehicle rolls back.
    """
    usual, slope, _ = usual_speed(rows, step, closed, x[0], x[1], np.sqrt(P[0, 0]))
    if not (abs(usual) > SLOWEST and np.isfinite(slope)):
        driven[0] = 0.0
        return False
    a = acceleration(rows, step, closed, x[0], x[1], force[0], force[1], force[2])
    unusual = a - x[1] * slope * (1.0 + x[X_PACE])
    driven[0] += T / (T + DRIVEN_S) * (unusual - driven[0])
    if abs(driven[0]) < DRIVEN_ACCEL + 0.3 * shake:
        return False
    x[X_PACE] = x[1] / usual - 1.0
    by_s = -x[1] * slope / usual**2
    F[PACE, :] = F[V, :] / usual + by_s * F[S, :]
    P[PACE, :] = P[V, :] / usual + by_s * P[S, :]
    own = P[PACE, V] / usual + by_s * P[PACE, S]
    P[:, PACE] = P[PACE, :]
    P[PACE, PACE] = own + DRIVEN_PACE**2
    return True


@numba.njit(cache=True)
def match_speed(
    x: Array, P: Array, T: float, rows: Array, step: float, closed: bool, settings: Array
) -> float:
    """
    Fuse the usual speed at this chainage times 1 + pace, if there is one; return the NIS.

    A vehicle that stands is not usual: its speed is left alone.

    ``settings`` (2,): what pace leaves unexplained, a share, and the distance over which that
    persists [m]. The row's own standard deviation comes on top.
    """
    usual, slope, spread = usual_speed(rows, step, closed, x[0], x[1], np.sqrt(P[0, 0]))
    if not (min(abs(usual), abs(x[1])) > SLOWEST and np.isfinite(slope + spread)):
        return 0.0
    pace = 1.0 + x[X_PACE]
    H = np.zeros((1, ERRORS))
    H[0, S], H[0, V], H[0, PACE] = -slope * pace, 1.0, -usual
    nu = np.array([usual * pace - x[1]])
    variance = spread**2 + (settings[0] * usual) ** 2
    R = np.array([variance * max(1.0, settings[1] / (abs(x[1]) * T))])
    own = np.dot(H[0], P @ H[0]) + R[0]
    ratio = nu[0] ** 2 / own
    if ratio > 9.0:
        R[0] += own * (ratio / 9.0 - 1.0)
    correct(x, P, nu, H, R)
    return ratio


@numba.njit(cache=True)
def hold(x: Array, P: Array, sigma: float) -> None:
    """Fuse a standstill: ds/dt is zero within ``sigma`` [m/s]."""
    H = np.zeros((1, ERRORS))
    H[0, V] = 1.0
    correct(x, P, np.array([-x[1]]), H, np.array([sigma * sigma]))


@numba.njit(cache=True)
def level(x: Array, P: Array, force: Array, sigma: float) -> None:
    """Fuse the mean specific force (3,) of a standstill: gravity and the bias."""
    C = x[2:11].copy().reshape((3, 3))
    Ct = np.ascontiguousarray(C.T)
    up = np.array([0.0, 0.0, GRAVITY])
    nu = force - Ct @ up - x[X_ACCEL_BIAS : X_ACCEL_BIAS + 3]
    # C' exp(-tilt) up = C' up + C' [up]x tilt
    skew = np.array([[0.0, -GRAVITY, 0.0], [GRAVITY, 0.0, 0.0], [0.0, 0.0, 0.0]])
    H = np.zeros((3, ERRORS))
    H[:, TILT : TILT + 3] = Ct @ skew
    for j in range(3):
        H[j, ACCEL_BIAS + j] = 1.0
    correct(x, P, nu, H, np.full(3, sigma * sigma))


@numba.njit(cache=True)
def still_gyro(x: Array, P: Array, rate: Array, sigma: float) -> None:
    """Fuse the mean angular rate (3,) of a standstill: the gyro's bias."""
    H = np.zeros((3, ERRORS))
    nu = np.empty(3)
    for j in range(3):
        H[j, GYRO_BIAS + j] = 1.0
        nu[j] = rate[j] - x[X_GYRO_BIAS + j]
    correct(x, P, nu, H, np.full(3, sigma * sigma))

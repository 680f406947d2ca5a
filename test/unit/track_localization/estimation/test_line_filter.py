"""The line filter's formulas: by finite differences, textbook updates and a brute-force Bayes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from track_localization.estimation import line_motion, line_rows, line_state, line_updates
from track_localization.track import line_map
from track_localization.track.centreline import Centreline
from track_localization.track.line_map import LineMap

G = 9.80665
RATE_HZ, SAMPLES = 100.0, 5
SIGMA = 0.004
SETTINGS = np.array([6.0, 9.0, 0.4, 25.0])


def climbing_bend(s):
    """Seat 1.1 m above a track whose pitch and yaw both change: position and attitude (N, 3, 3)."""
    yaw, pitch, roll = 3e-4 * s * s, -0.6 * np.sin(s / 40.0), 0.4 * np.sin(s / 25.0)
    R = Rotation.from_euler('ZYX', np.stack([yaw, pitch, roll], axis=1)).as_matrix()
    middle = 0.5 * (R[1:, :, 0] + R[:-1, :, 0])
    path = np.vstack([np.zeros(3), np.cumsum(middle * np.diff(s)[:, None], axis=0)])
    return path + 1.1 * R[:, :, 2], R


@pytest.fixture(scope='module')
def table():
    s = np.arange(0.0, 200.01, 0.05)
    position, attitude = climbing_bend(s)
    made = LineMap(Centreline(s[::5], position[::5], attitude[::5], False, 200.0), SIGMA, 0.1)
    speed = 14.0 + 4.0 * np.sin(made.chainage / 30.0)
    made.set_speed(speed, np.full(len(speed), 0.3), np.full(len(speed), 0.02))
    return made


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def args(table):
    return table.rows, table.step_m, table.closed


def rotation(v):
    return Rotation.from_rotvec(v).as_matrix()


def rotvec(R):
    return Rotation.from_matrix(R).as_rotvec()


def plus(x, e):
    """Apply an error as the module's docstring defines it, with scipy's rotations."""
    out = x.copy()
    out[0:2] += e[0:2]
    out[2:11] = (rotation(e[2:5]) @ x[2:11].reshape(3, 3)).ravel()
    out[11:20] = (rotation(e[5:8]) @ x[11:20].reshape(3, 3)).ravel()
    out[20:30] += e[8:18]
    return out


def minus(x, reference):
    """Error that takes ``reference`` to ``x``."""
    e = np.empty(18)
    e[0:2] = x[0:2] - reference[0:2]
    for first, k in ((2, 2), (11, 5)):
        A, B = (y[first : first + 9].reshape(3, 3) for y in (x, reference))
        e[k : k + 3] = rotvec(A @ B.T)
    e[8:18] = x[20:30] - reference[20:30]
    return e


def state(rng, table, s=73.02, v=15.0, off=0.01):
    """Vehicle on the line, its attitude ``off`` [rad] from the line's, the mount anyhow."""
    M = rotation(rng.normal(size=3))
    R = table.line.attitude(s) @ rotation(off * rng.normal(size=3))
    biases = [0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 0.1, 0.1, 0.1, 0.05] * rng.normal(size=10)
    return np.concatenate([[s, v], (R @ M).ravel(), M.ravel(), biases])


SCALES = np.repeat([0.1, 0.2, 0.01, 0.01, 0.002, 0.002, 0.05, 0.03], [1, 1, 3, 3, 3, 3, 3, 1])
"""Standard deviations of a filter that is on its way."""


def covariance(rng, scales=SCALES):
    A = rng.normal(size=(18, 18)) + 2.0 * np.eye(18)
    P = A @ A.T
    d = scales / np.sqrt(np.diag(P))
    return P * np.outer(d, d)


def numeric_jacobian(function, x, step=1e-6):
    columns = []
    for j in range(18):
        e = np.zeros(18)
        e[j] = step
        columns.append((function(plus(x, e)) - function(plus(x, -e))) / (2.0 * step))
    return np.stack(columns, axis=-1)


def textbook(x, P, nu, H, R):
    """Joint Kalman update by Joseph's form, errors then measured from the corrected attitudes."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    e = K @ nu
    left = np.eye(18) - K @ H
    new = left @ P @ left.T + K @ R @ K.T
    reset = np.eye(18)
    h = 1e-6
    for k in (2, 5):
        for j in range(3):
            d = np.zeros(3)
            d[j] = h
            up, down = (rotation(e[k : k + 3] + q) @ rotation(-e[k : k + 3]) for q in (d, -d))
            reset[k : k + 3, k + j] = (rotvec(up) - rotvec(down)) / (2.0 * h)
    return plus(x, e), reset @ new @ reset.T


def assert_same_belief(got, expected, atol=1e-3):
    """Compare states and covariances in units of the expected standard deviations."""
    (x, P), (x_expected, P_expected) = got, expected
    d = 1.0 / np.sqrt(np.diag(P_expected))
    np.testing.assert_allclose(minus(x, x_expected) * d, 0.0, atol=atol)
    scale = np.outer(d, d)
    np.testing.assert_allclose(P * scale, P_expected * scale, atol=atol)


# The error state


def test_add_error_and_difference_follow_their_definition(rng, table):
    x = state(rng, table)
    e = rng.normal(size=18) * np.repeat([1.0, 0.3, 1.0], [2, 6, 10])
    moved = x.copy()
    line_state.add_error(moved, e)
    np.testing.assert_allclose(moved, plus(x, e), atol=1e-12)
    np.testing.assert_allclose(line_state.difference(moved, x), e, atol=1e-12)
    back = moved.copy()
    line_state.add_error(back, line_state.difference(x, moved))
    np.testing.assert_allclose(back, x, atol=1e-12)


# Prediction


def samples(rng, table, x):
    """Force and rate (SAMPLES, 3) as of a ride there: the line's turning and some more."""
    row = table.rows[int(x[0] / table.step_m)]
    M = x[11:20].reshape(3, 3)
    w = (x[1] * row[9:12] + 0.2 * rng.normal(size=(SAMPLES, 3))) @ M
    f = (np.array([3.0, 2.0, 12.0]) + rng.normal(size=(SAMPLES, 3))) @ M
    return f, w


def integrate(x, f, w, table):
    x, sums = x.copy(), np.zeros(line_motion.SUMS)
    for i in range(SAMPLES):
        line_motion.advance(x, sums, f[i], w[i], 1.0 / RATE_HZ, *args(table))
    return x, sums


@pytest.mark.parametrize('s', [40.0, 73.0, 120.0])
def test_transition_is_the_derivative_of_the_integration(rng, table, s):
    """
    F against the integration of five samples under each of the 18 errors.

    Rows are scaled to what they are rates of: acceleration errors for s and v, turn for tilt.
    The transition is taken at the end of the epoch instead of along it, 0.7 m of a line whose
    terms change by some per mille per metre.
    """
    x = state(rng, table, s)
    f, w = samples(rng, table, x)
    reference, sums = integrate(x, f, w, table)
    T = SAMPLES / RATE_HZ
    P = covariance(rng)
    F = line_motion.predict(reference.copy(), P, sums, np.zeros(6), *args(table))

    def predicted(start):
        return minus(integrate(start, f, w, table)[0], reference)

    numeric = numeric_jacobian(predicted, x)
    F_others, numeric_others = F[:17], numeric[:17]
    scale = np.repeat([2.0 / T**2, 1.0 / T, 1.0 / T, 1.0], [1, 1, 3, 12])[:, None]
    off = (F_others - numeric_others) * scale
    # s'' of s and v: gravity over metres, centrifugal share per m/s.
    np.testing.assert_allclose(off[0:2, 0:2], 0.0, atol=0.03)
    # s'' by a radian of mount: the 12 m/s^2 of force across; by accelerometer bias: one.
    np.testing.assert_allclose(off[0:2, 5:8], 0.0, atol=0.1)
    np.testing.assert_allclose(off[0:2, 14:17], 0.0, atol=0.01)
    # Tilt by gyro bias (one) and scale (the rate, about 1 rad/s).
    np.testing.assert_allclose(off[2:5], 0.0, atol=2e-4)
    np.testing.assert_allclose(off[5:], 0.0, atol=1e-9)
    assert np.abs(numeric_others[0:2, 5:8] * scale[0:2]).max() > 5.0
    assert F[17, 17] == pytest.approx(np.exp(-reference[1] * T * 0.02))
    np.testing.assert_array_equal(F[17, :17], 0.0)


def test_covariance_prediction_is_f_p_f_plus_q(rng, table):
    """The shortcut over the rows that move is F P F' + Q, for white noise on s'' and the walks."""
    x = state(rng, table)
    f, w = samples(rng, table, x)
    x, sums = integrate(x, f, w, table)
    P = covariance(rng)
    noise = np.array([0.3, 2e-3, 1e-4, 4e-3, 5e-5, 0.08])
    T = SAMPLES / RATE_HZ
    got, before = P.copy(), x[29]
    F = line_motion.predict(x, got, sums, noise, *args(table))
    Q = np.zeros((18, 18))
    Q[0:2, 0:2] = noise[0] * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    rates = {2: noise[1], 5: noise[4], 8: noise[2], 11: 0.0, 14: noise[3]}
    for k, q in rates.items():
        Q[k : k + 3, k : k + 3] = q * T * np.eye(3)
    Q[17, 17] = 0.08**2 * (1.0 - F[17, 17] ** 2)
    np.testing.assert_allclose(got, F @ P @ F.T + Q, atol=1e-14)
    np.testing.assert_array_equal(got, got.T)
    np.testing.assert_array_equal(sums, 0.0)
    assert x[29] == pytest.approx(before * F[17, 17])


def test_nothing_happens_over_no_time(rng, table):
    x, P = state(rng, table), covariance(rng)
    x_before, P_before = x.copy(), P.copy()
    F = line_motion.predict(x, P, np.zeros(line_motion.SUMS), np.ones(6), *args(table))
    np.testing.assert_array_equal(F, np.eye(18))
    np.testing.assert_array_equal(x, x_before)
    np.testing.assert_array_equal(P, P_before)


def test_white_noise_spreads_as_the_covariance_says(rng, table):
    """Thousand integrations of white force noise: variances of s and v within 15 %."""
    x = state(rng, table, s=60.0, v=8.0)
    f, w = samples(rng, table, x)
    density = 0.5
    row = table.rows[int(x[0] / table.step_m)]
    forward = x[11:20].reshape(3, 3).T @ row[12:15] * row[15]
    ends = []
    for _ in range(1000):
        noise = rng.normal(size=(SAMPLES, 1)) * np.sqrt(density * RATE_HZ)
        ends.append(integrate(x, f + noise * forward, w, table)[0][0:2])
    spread = np.cov(np.array(ends).T)
    reference, sums = integrate(x, f, w, table)
    P = np.zeros((18, 18))
    line_motion.predict(reference, P, sums, np.array([density, 0, 0, 0, 0, 0]), *args(table))
    np.testing.assert_allclose(spread, P[0:2, 0:2], rtol=0.15)


# Updates


def test_correct_is_the_joint_update(rng, table):
    """Part by part gives what the joint update with a matrix inverse gives."""
    x, P = state(rng, table), covariance(rng)
    H = rng.normal(size=(5, 18)) / SCALES
    R = rng.uniform(0.5, 3.0, 5)
    nu = rng.normal(size=5) * 2.0
    expected = textbook(x, P, nu, H, np.diag(R))
    line_state.correct(x, P, nu, H, R)
    assert_same_belief((x, P), expected, 1e-4)
    np.testing.assert_allclose(P, P.T, atol=1e-18)


def test_large_correction_turns_the_covariance_with_the_attitude(rng, table):
    """A correction of 0.2 rad: the reset is a rotation by half of it, to the second order."""
    scales = SCALES.copy()
    scales[2:8] = 0.2
    x, P = state(rng, table), covariance(rng, scales)
    H = np.zeros((2, 18))
    H[0, 2], H[1, 6] = 1.0, 1.0
    R, nu = np.array([0.01, 0.02]), np.array([0.2, -0.15])
    expected = textbook(x, P, nu, H, np.diag(R))
    line_state.correct(x, P, nu, H, R)
    # Second order: 0.2^2 / 24; without the reset parts are off by 0.1.
    assert_same_belief((x, P), expected, 6e-3)


def test_repeated_exact_measurements_leave_a_covariance(rng, table):
    x, P = state(rng, table), covariance(rng)
    for _ in range(50):
        line_state.correct(x, P, rng.normal(size=6) * 1e-6, np.eye(18)[2:8], np.full(6, 1e-14))
    np.testing.assert_allclose(P, P.T, atol=1e-18)
    d = 1.0 / SCALES
    assert np.linalg.eigvalsh(P * np.outer(d, d))[0] > -1e-10


def line_residual(x, table):
    """Rotation vector from the line's attitude, by the spline and scipy."""
    C, M = x[2:11].reshape(3, 3), x[11:20].reshape(3, 3)
    return rotvec(table.line.attitude(x[0]).T @ C @ M.T)


@pytest.mark.parametrize('v', [15.0, 250.0, -9.0])
def test_attitude_match_is_the_textbook_update(rng, table, v):
    """Innovation and Jacobian by finite differences; what repeats itself over 6 m counts once."""
    scales = SCALES.copy()
    scales[0] = 0.3
    x, P = state(rng, table, v=v, off=0.02), covariance(rng, scales)
    H = numeric_jacobian(lambda y: line_residual(y, table), x)
    assert np.abs(H[:, 0]).max() > 0.02
    r, T = line_residual(x, table), 0.05
    R = SIGMA**2 * max(1.0, 6.0 / (abs(v) * T)) * np.eye(3)
    expected = textbook(x, P, -r, H, R)
    nis = np.zeros(3)
    line_updates.match_attitude(x, P, T, *args(table), SETTINGS, nis)
    assert_same_belief((x, P), expected)
    assert (nis > 0.0).all()
    assert (nis < 9.0).all()


def test_nis_of_each_axis_is_its_squared_innovation(rng, table):
    x, P = state(rng, table), covariance(rng)
    H = numeric_jacobian(lambda y: line_residual(y, table), x)
    own = np.diag(H @ P @ H.T) + SIGMA**2 * 6.0 / (15.0 * 0.05)
    expected = line_residual(x, table) ** 2 / own
    nis = np.zeros(3)
    line_updates.match_attitude(x, P, 0.05, *args(table), SETTINGS, nis)
    np.testing.assert_allclose(nis, expected, rtol=5e-3)


def test_soft_gate_weighs_an_outlier_down_to_the_gate(rng, table):
    """An axis far off is fused with the variance that makes its NIS equal to the gate."""
    x, P = state(rng, table, off=0.0), covariance(rng)
    x[2:11] = (x[2:11].reshape(3, 3) @ rotation(np.array([0.2, 0.0, 0.0]))).ravel()
    free = x.copy(), P.copy()
    nis = np.zeros(3)
    H = numeric_jacobian(lambda y: line_residual(y, table), x)
    r = line_residual(x, table)
    own = np.diag(H @ P @ H.T) + SIGMA**2 * 6.0 / (15.0 * 0.05)
    R = np.maximum(own * r**2 / own / 9.0, own) - np.diag(H @ P @ H.T)
    assert R.max() > 0.003
    expected = textbook(x, P, -r, H, np.diag(R))
    line_updates.match_attitude(x, P, 0.05, *args(table), SETTINGS, nis)
    assert nis.max() > 30.0
    assert_same_belief((x, P), expected, 0.02)
    open_gate = SETTINGS.copy()
    open_gate[1] = 1e6
    line_updates.match_attitude(*free, 0.05, *args(table), open_gate, nis)
    moved = minus(x, free[0])
    assert np.abs(moved).max() > 1e-3


def test_likelihood_prefers_the_true_place(rng, table):
    """Of hypotheses 4 m apart the one where the vehicle is has the highest log likelihood."""
    totals = []
    for wrong in (-4.0, 0.0, 4.0):
        x = state(np.random.default_rng(1), table, s=80.0, off=0.0)
        P = covariance(rng)
        x[0] += wrong
        totals.append(line_updates.match_attitude(x, P, 0.05, *args(table), SETTINGS, np.zeros(3)))
    assert int(np.argmax(totals)) == 1


def speed_innovation(x, table):
    usual = 14.0 + 4.0 * np.sin(x[0] / 30.0)
    return np.array([x[1] - usual * (1.0 + x[29])])


def test_speed_match_is_the_textbook_update(rng, table):
    """``v = usual(s) (1 + pace)`` within 0.3 m/s and a share that repeats itself over 20 m."""
    x, P = state(rng, table, v=16.5), covariance(rng)
    H = numeric_jacobian(lambda y: speed_innovation(y, table), x)
    usual, T = 14.0 + 4.0 * np.sin(x[0] / 30.0), 0.05
    R = (0.3**2 + (0.02 * usual) ** 2) * 20.0 / (16.5 * T)
    nu = -speed_innovation(x, table)
    expected = textbook(x, P, nu, H, np.array([[R]]))
    nis = nu[0] ** 2 / (H @ P @ H.T + R)[0, 0]
    got = line_updates.match_speed(x, P, T, *args(table), np.array([0.02, 20.0]))
    assert_same_belief((x, P), expected, 5e-3)
    assert got == pytest.approx(nis, rel=0.01)


@pytest.mark.parametrize('v', [0.0, -8.0])
def test_usual_speed_says_nothing_of_a_train_that_stands_or_rolls_back(rng, table, v):
    x, P = state(rng, table, v=v), covariance(rng)
    x_before, P_before = x.copy(), P.copy()
    assert line_updates.match_speed(x, P, 0.05, *args(table), np.array([0.02, 20.0])) == 0.0
    np.testing.assert_array_equal(x, x_before)
    np.testing.assert_array_equal(P, P_before)


def test_unknown_usual_speed_says_nothing(rng, table):
    rows = table.rows.copy()
    rows[:, line_map.SPEED] = np.nan
    x, P = state(rng, table), covariance(rng)
    x_before, P_before = x.copy(), P.copy()
    assert (
        line_updates.match_speed(x, P, 0.05, rows, table.step_m, False, np.array([0.02, 20.0]))
        == 0.0
    )
    np.testing.assert_array_equal(x, x_before)
    np.testing.assert_array_equal(P, P_before)


def test_standstill_updates_are_textbook_updates(rng, table):
    """Gravity in the sensor and its bias, the gyro's bias, and a speed of nothing."""
    x, P = state(rng, table, v=0.1), covariance(rng)

    def gravity(y):
        return y[2:11].reshape(3, 3).T @ [0.0, 0.0, G] + y[26:29]

    force = gravity(x) + 0.05 * rng.normal(size=3)
    H = numeric_jacobian(gravity, x)
    expected = textbook(x, P, force - gravity(x), H, 0.02**2 * np.eye(3))
    line_updates.level(x, P, force, 0.02)
    assert_same_belief((x, P), expected)

    rate = np.array([0.012, -0.02, 0.004])
    H = numeric_jacobian(lambda y: y[20:23], x)
    expected = textbook(x, P, rate - x[20:23], H, 2e-3**2 * np.eye(3))
    line_updates.still_gyro(x, P, rate, 2e-3)
    assert_same_belief((x, P), expected)

    expected = textbook(x, P, -x[1:2], np.eye(18)[1:2], np.array([[1e-4]]))
    line_updates.hold(x, P, 0.01)
    assert_same_belief((x, P), expected)


# A vehicle whose place is uncertain


def flat_bend(begin, sharpening):
    """Level line: straight, then from ``begin`` on a clothoid; its yaw by chainage."""

    def yaw(s):
        return 0.5 * sharpening * np.maximum(s - begin, 0.0) ** 2

    s = np.arange(0.0, 120.01, 0.05)
    front = np.stack([np.cos(yaw(s)), np.sin(yaw(s)), 0.0 * s], axis=1)
    R = np.stack([front, np.cross([0.0, 0.0, 1.0], front), np.full_like(front, [0, 0, 1])], axis=2)
    path = np.vstack([np.zeros(3), np.cumsum(0.5 * (front[1:] + front[:-1]) * 0.05, axis=0)])
    return yaw, LineMap(Centreline(s[::5], path[::5], R[::5], False, 120.0), SIGMA, 0.1)


def on_a_level_line(s, yaw):
    C = Rotation.from_euler('z', yaw).as_matrix()
    return np.concatenate([[s, 10.0], C.ravel(), np.eye(3).ravel(), np.zeros(10)])


def bayes(s0, sigma, measured, yaw, variance):
    """Mean and standard deviation of the chainage after a yaw was seen, on a fine grid."""
    s = np.linspace(s0 - 8.0 * sigma, s0 + 8.0 * sigma, 40001)
    weight = -0.5 * ((s - s0) / sigma) ** 2 - 0.5 * (measured - yaw(s)) ** 2 / variance
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    mean = weight @ s
    return mean, np.sqrt(weight @ (s - mean) ** 2)


def matched(table, s0, sigma, measured, tilt_sigma, spread_m=0.4):
    """Belief on the chainage (mean, sigma) after one comparison with the line."""
    x = on_a_level_line(s0, measured)
    P = np.diag(np.repeat([sigma**2, 1e-8, tilt_sigma**2, 1e-12], [1, 1, 3, 13]))
    settings = np.array([0.5, 1e6, spread_m, 60.0])
    line_updates.match_attitude(x, P, 0.05, *args(table), settings, np.zeros(3))
    return x[0], np.sqrt(P[0, 0])


@pytest.mark.parametrize('true', [52.0, 54.0, 56.5])
def test_wide_belief_on_a_steady_bend_follows_bayes(true):
    """sigma_s = 3 m on a bend of 1/40 m to 1/25 m: mean and sigma are those of the grid."""
    yaw, table = flat_bend(10.0, 8e-4)
    expected, sigma = bayes(54.0, 3.0, yaw(true), yaw, 0.02**2 + SIGMA**2)
    got = matched(table, 54.0, 3.0, float(yaw(true)), 0.02)
    assert got[0] == pytest.approx(expected, abs=0.2)
    assert got[1] == pytest.approx(sigma, rel=0.25)


@pytest.mark.parametrize('measured', [0.01, 0.02])
def test_moments_over_a_bend_give_the_best_linear_estimate(measured):
    """A belief that reaches from the straight into the bend: against moments on a fine grid."""
    yaw, table = flat_bend(57.0, 1e-3)
    s0, sigma = 60.0, 3.0
    s = np.linspace(s0 - 24.0, s0 + 24.0, 40001)
    weight = np.exp(-0.5 * ((s - s0) / sigma) ** 2)
    weight /= weight.sum()
    mean = weight @ yaw(s)
    cross = weight @ ((s - s0) * (yaw(s) - mean))
    variance = weight @ (yaw(s) - mean) ** 2 + 0.003**2 + SIGMA**2
    expected = s0 + cross / variance * (measured - mean)
    left = np.sqrt(sigma**2 - cross**2 / variance)
    got = matched(table, s0, sigma, measured, 0.003)
    assert got[0] == pytest.approx(expected, abs=0.1)
    assert got[1] == pytest.approx(left, rel=0.05)
    # The slope at the mean alone is off by more than a metre and too sure of it.
    by_slope = matched(table, s0, sigma, measured, 0.003, spread_m=1e3)
    assert abs(by_slope[0] - expected) > 1.0
    assert by_slope[1] < 0.85 * left


def test_wide_belief_before_a_bend_learns_of_it():
    """Where the mean is the line does not turn yet: its slope tells nothing, the moments do."""
    yaw, table = flat_bend(60.0, 1e-3)
    truth, _ = bayes(60.0, 3.0, 0.02, yaw, 0.003**2 + SIGMA**2)
    got = matched(table, 60.0, 3.0, 0.02, 0.003)
    by_slope = matched(table, 60.0, 3.0, 0.02, 0.003, spread_m=1e3)
    assert truth > 65.0
    assert by_slope[0] < 60.5
    assert 63.5 < got[0] < truth
    assert got[0] + 2.0 * got[1] > truth


def test_wide_belief_is_not_overconfident_over_seeds():
    """Error over sigma of 400 draws over the onset of a bend: the filter's sigma covers them."""
    rng = np.random.default_rng(8)
    yaw, table = flat_bend(60.0, 1e-3)
    squares = []
    for _ in range(400):
        true = 62.0 + 3.0 * rng.normal()
        seen = float(yaw(true) + np.hypot(0.003, SIGMA) * rng.normal())
        s, sigma = matched(table, 62.0, 3.0, seen, 0.003)
        squares.append(((s - true) / sigma) ** 2)
    # One degree of freedom, not quite a Gaussian: 400 draws have a standard error of 0.07.
    assert 0.7 < np.mean(squares) < 1.3


# Drives and brakes


def test_pace_follows_an_unusual_drive(rng, table):
    """Driven harder than usual, pace becomes v / usual - 1 and F, P say that it came from v."""
    x, P = state(rng, table, v=12.0), covariance(rng)
    T = 0.05
    f, w = samples(rng, table, x)
    x, sums = integrate(x, f, w, table)
    F = line_motion.predict(x, P, sums, np.zeros(6), *args(table))
    row = table.rows[int(x[0] / table.step_m)]
    hard = row[12:15] * 6.0 + np.cross(row[12:15], [0.0, 1.0, 0.0]) * 5.0
    driven = np.zeros(1)
    flags = []
    for _ in range(30):
        flags.append(
            line_motion.follow_drive(x, P, F, T, *args(table), driven, hard, 0.02),
        )
    assert flags[-1]
    usual = 14.0 + 4.0 * np.sin(x[0] / 30.0)
    assert x[29] == pytest.approx(x[1] / usual - 1.0, abs=1e-4)
    # pace = v / u(s) - 1: its derivatives by v and by s.
    by_v, by_s = 1.0 / usual, -x[1] * 4.0 / 30.0 * np.cos(x[0] / 30.0) / usual**2
    np.testing.assert_allclose(
        F[17, :17], by_v * F[1, :17] + by_s * F[0, :17], rtol=2e-3, atol=1e-9
    )
    P_sv = P[:2, :2]
    np.testing.assert_allclose(
        P[17, :17], by_v * P[1, :17] + by_s * P[0, :17], rtol=2e-3, atol=1e-9
    )
    np.testing.assert_array_equal(P, P.T)
    variance = np.array([by_s, by_v]) @ P_sv @ np.array([by_s, by_v])
    assert P[17, 17] == pytest.approx(variance + line_motion.DRIVEN_PACE**2, rel=5e-3)
    assert np.linalg.eigvalsh(P)[0] > 0.0


def test_usual_acceleration_is_no_drive(rng, table):
    """The force that keeps the usual speed (and its slope) leaves the pace alone."""
    x, P = state(rng, table), covariance(rng)
    x[29] = 0.04
    usual = 14.0 + 4.0 * np.sin(x[0] / 30.0)
    slope = 4.0 / 30.0 * np.cos(x[0] / 30.0)
    x[1] = usual * 1.04
    wanted = x[1] * slope * 1.04
    row = table.rows[int(x[0] / table.step_m)]
    still = line_rows.acceleration(*args(table), x[0], x[1], 0.0, 0.0, 0.0)
    force = row[12:15] * (wanted - still) * row[15]
    driven, F, before = np.zeros(1), np.eye(18), P.copy()
    for _ in range(40):
        assert not line_motion.follow_drive(x, P, F, 0.05, *args(table), driven, force, 0.0)
    assert x[29] == 0.04
    np.testing.assert_array_equal(P, before)


def test_rollback_keeps_its_pace(rng, table):
    """A train that rolls back from a lift is not a train of pace -2."""
    x, P = state(rng, table, v=-6.0), covariance(rng)
    pace, before = x[29], P.copy()
    row = table.rows[int(x[0] / table.step_m)]
    driven = np.zeros(1)
    for _ in range(40):
        F = np.eye(18)
        assert not line_motion.follow_drive(
            x, P, F, 0.05, *args(table), driven, -6.0 * row[12:15], 0.02
        )
    assert x[29] == pace
    np.testing.assert_array_equal(P, before)

"""The line filter's prediction: by finite differences and seeded noise; drives and brakes."""

import copy

import numpy as np
import pytest

from track_localization.estimation import line_motion, line_rows

RATE_HZ, SAMPLES = 100.0, 5


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def samples(rng, table, x):
    """Force and rate (SAMPLES, 3) as of a ride there: the line's turning and some more."""
    row = table.rows[int(x[0] / table.step_m)]
    M = x[11:20].reshape(3, 3)
    w = (x[1] * row[9:12] + 0.2 * rng.normal(size=(SAMPLES, 3))) @ M
    f = (np.array([3.0, 2.0, 12.0]) + rng.normal(size=(SAMPLES, 3))) @ M
    return f, w


def integrate(ref, x, f, w, table):
    x, sums = x.copy(), np.zeros(line_motion.SUMS)
    for i in range(SAMPLES):
        line_motion.advance(x, sums, f[i], w[i], 1.0 / RATE_HZ, *ref.args(table))
    return x, sums


@pytest.mark.parametrize('s', [40.0, 73.0, 120.0])
def test_transition_is_the_derivative_of_the_integration(ref, rng, table, s):
    """
    F against the integration of five samples under each of the 18 errors.

    Rows are scaled to what they are rates of: acceleration errors for s and v, turn for tilt.
    The transition is taken at the end of the epoch instead of along it, 0.7 m of a line whose
    terms change by some per mille per metre.
    """
    x = ref.state(rng, table, s)
    f, w = samples(rng, table, x)
    reference, sums = integrate(ref, x, f, w, table)
    T = SAMPLES / RATE_HZ
    P = ref.covariance(rng)
    F = line_motion.predict(reference.copy(), P, sums, np.zeros(6), *ref.args(table))

    def predicted(start):
        return ref.minus(integrate(ref, start, f, w, table)[0], reference)

    numeric = ref.numeric_jacobian(predicted, x)
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


def test_covariance_prediction_is_f_p_f_plus_q(ref, rng, table):
    """The shortcut over the rows that move is F P F' + Q, for white noise on s'' and the walks."""
    x = ref.state(rng, table)
    f, w = samples(rng, table, x)
    x, sums = integrate(ref, x, f, w, table)
    P = ref.covariance(rng)
    noise = np.array([0.3, 2e-3, 1e-4, 4e-3, 5e-5, 0.08])
    T = SAMPLES / RATE_HZ
    got, before = P.copy(), x[29]
    F = line_motion.predict(x, got, sums, noise, *ref.args(table))
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


def test_nothing_happens_over_no_time(ref, rng, table):
    x, P = ref.state(rng, table), ref.covariance(rng)
    x_before, P_before = x.copy(), P.copy()
    F = line_motion.predict(x, P, np.zeros(line_motion.SUMS), np.ones(6), *ref.args(table))
    np.testing.assert_array_equal(F, np.eye(18))
    np.testing.assert_array_equal(x, x_before)
    np.testing.assert_array_equal(P, P_before)


def test_white_noise_spreads_as_the_covariance_says(ref, rng, table):
    """Thousand integrations of white force noise: variances of s and v within 15 %."""
    x = ref.state(rng, table, s=60.0, v=8.0)
    f, w = samples(rng, table, x)
    density = 0.5
    row = table.rows[int(x[0] / table.step_m)]
    forward = x[11:20].reshape(3, 3).T @ row[12:15] * row[15]
    ends = []
    for _ in range(1000):
        noise = rng.normal(size=(SAMPLES, 1)) * np.sqrt(density * RATE_HZ)
        ends.append(integrate(ref, x, f + noise * forward, w, table)[0][0:2])
    spread = np.cov(np.array(ends).T)
    reference, sums = integrate(ref, x, f, w, table)
    P = np.zeros((18, 18))
    line_motion.predict(reference, P, sums, np.array([density, 0, 0, 0, 0, 0]), *ref.args(table))
    np.testing.assert_allclose(spread, P[0:2, 0:2], rtol=0.15)


def test_pace_follows_an_unusual_drive(ref, rng, table):
    """Driven harder than usual, pace becomes v / usual - 1 and F, P say that it came from v."""
    x, P = ref.state(rng, table, v=12.0), ref.covariance(rng)
    T = 0.05
    f, w = samples(rng, table, x)
    x, sums = integrate(ref, x, f, w, table)
    F = line_motion.predict(x, P, sums, np.zeros(6), *ref.args(table))
    row = table.rows[int(x[0] / table.step_m)]
    hard = row[12:15] * 6.0 + np.cross(row[12:15], [0.0, 1.0, 0.0]) * 5.0
    driven = np.zeros(1)
    flags = []
    for _ in range(30):
        flags.append(
            line_motion.follow_drive(x, P, F, T, *ref.args(table), driven, hard, 0.02, 0.07),
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


def test_usual_acceleration_is_no_drive(ref, rng, table):
    """The force that keeps the usual speed (and its slope) leaves the pace alone."""
    x, P = ref.state(rng, table), ref.covariance(rng)
    x[29] = 0.04
    usual = 14.0 + 4.0 * np.sin(x[0] / 30.0)
    slope = 4.0 / 30.0 * np.cos(x[0] / 30.0)
    x[1] = usual * 1.04
    wanted = x[1] * slope * 1.04
    row = table.rows[int(x[0] / table.step_m)]
    still = line_rows.acceleration(*ref.args(table), x[0], x[1], 0.0, 0.0, 0.0)
    force = row[12:15] * (wanted - still) * row[15]
    driven, F, before = np.zeros(1), np.eye(18), P.copy()
    for _ in range(40):
        assert not line_motion.follow_drive(
            x, P, F, 0.05, *ref.args(table), driven, force, 0.0, 0.07
        )
    assert x[29] == 0.04
    np.testing.assert_array_equal(P, before)


def test_rollback_keeps_its_pace(ref, rng, table):
    """A train that rolls back from a lift is not a train of pace -2."""
    x, P = ref.state(rng, table, v=-6.0), ref.covariance(rng)
    pace, before = x[29], P.copy()
    row = table.rows[int(x[0] / table.step_m)]
    driven = np.zeros(1)
    for _ in range(40):
        F = np.eye(18)
        assert not line_motion.follow_drive(
            x, P, F, 0.05, *ref.args(table), driven, -6.0 * row[12:15], 0.02, 0.07
        )
    assert x[29] == pace
    np.testing.assert_array_equal(P, before)


@pytest.mark.parametrize('sigma', [0.2, 3.0])
def test_where_others_pass_a_creeping_train_has_no_pace(ref, rng, table, sigma):
    """1 m/s is no share of 14 +- 4, however vague: the usual speed is left alone, no pace kept."""
    x, P = ref.state(rng, table, v=1.0), ref.covariance(rng)
    P[1, :], P[:, 1] = 0.0, 0.0
    P[1, 1] = sigma**2
    x[29], others = -0.9, P[:17, :17].copy()
    F = np.eye(18)
    force = table.rows[int(x[0] / table.step_m), 12:15] * -1.0
    assert line_motion.follow_drive(x, P, F, 0.05, *ref.args(table), np.ones(1), force, 0.02, 0.07)
    assert (x[1], x[29]) == (1.0, 0.0)
    np.testing.assert_array_equal(P[:17, :17], others)
    np.testing.assert_array_equal(P[17], np.append(np.zeros(17), 0.07**2))
    np.testing.assert_array_equal(P, P.T)
    assert not F[17].any()


def test_a_speed_that_is_not_known_may_be_usual(ref, rng, table):
    """The same train, its speed known to 8 m/s: nothing says yet that it creeps."""
    x, P = ref.state(rng, table, v=1.0), ref.covariance(rng)
    P[1, 1], x[29] = 8.0**2, 0.02
    F, before = np.eye(18), P.copy()
    still = line_rows.acceleration(*ref.args(table), x[0], x[1], 0.0, 0.0, 0.0)
    row = table.rows[int(x[0] / table.step_m)]
    force = row[12:15] * -still * row[15]
    assert not line_motion.follow_drive(
        x, P, F, 0.05, *ref.args(table), np.zeros(1), force, 0.02, 0.07
    )
    assert x[29] == 0.02
    np.testing.assert_array_equal(P, before)


def test_a_train_a_third_slower_than_usual_has_no_pace(ref, rng, table):
    """A train that brakes to a stop where others leave is none of a small pace."""
    x, P = ref.state(rng, table), ref.covariance(rng)
    x[1], x[29] = 0.6 * (14.0 + 4.0 * np.sin(x[0] / 30.0)), -0.4
    P[1, 1] = 0.2**2
    force = table.rows[int(x[0] / table.step_m), 12:15] * -1.0
    assert line_motion.follow_drive(
        x, P, np.eye(18), 0.05, *ref.args(table), np.zeros(1), force, 0.02, 0.07
    )
    assert x[29] == 0.0


@pytest.fixture
def lift(table):
    """The same line where trains coast up to a lift that keeps 1 m/s from 100 m on."""
    other = copy.copy(table)
    other.rows = table.rows.copy()
    coasting = np.sqrt(1.0 + 15.0 * np.maximum(100.0 - table.chainage, 0.0))
    other.set_speed(coasting, np.full(len(coasting), 0.1), np.full(len(coasting), 0.02))
    return other


@pytest.mark.parametrize(('s', 'pull', 'drives'), [(101.0, 0.0, False), (101.0, 2.0, True)])
def test_where_a_lift_takes_hold_an_even_pull_is_no_drive(ref, rng, lift, s, pull, drives):
    """
    Known to 1 m, 1 m beyond the corner, the train may have been slowing a moment ago.

    That it no longer does is usual there; that it gains 2 m/s each second is not.
    """
    x, P = ref.state(rng, lift, s=s, v=0.9), ref.covariance(rng)
    P[0, 0], x[29] = 1.0, 0.0
    still = line_rows.acceleration(*ref.args(lift), x[0], x[1], 0.0, 0.0, 0.0)
    row = lift.rows[int(x[0] / lift.step_m)]
    force, driven = row[12:15] * (pull - still) * row[15], np.zeros(1)
    followed = [
        line_motion.follow_drive(x, P, np.eye(18), 0.05, *ref.args(lift), driven, force, 0.0, 0.07)
        for _ in range(40)
    ]
    assert any(followed) == drives


@pytest.mark.parametrize(('sigmas', 'unusual'), [(3.5, False), (4.5, True)])
def test_three_sigmas_off_the_usual_speed_is_sooner_an_error(ref, rng, lift, sigmas, unusual):
    """On the lift, 0.6 m/s slower than all others, and nothing was felt that made it so."""
    x, P = ref.state(rng, lift, s=150.0, v=0.4), ref.covariance(rng)
    P[1, 1], x[29] = (0.6 / sigmas) ** 2, 0.01
    still = line_rows.acceleration(*ref.args(lift), x[0], x[1], 0.0, 0.0, 0.0)
    row = lift.rows[int(x[0] / lift.step_m)]
    force = row[12:15] * -still * row[15]
    F, driven = np.eye(18), np.zeros(1)
    assert unusual == line_motion.follow_drive(
        x, P, F, 0.05, *ref.args(lift), driven, force, 0.02, 0.07
    )


@pytest.mark.parametrize('v', [2.0, 8.0])
def test_the_slope_of_the_built_line_pulls_for_as_long_as_it_lasts(rng, v):
    """
    Level line, built in pieces of 6 m each 4 mrad off: the speed after 60 m, over 4000 lines.

    Its attitude is matched to 8 mrad, half of it the line's own.
    """
    level = np.zeros((3, 22))
    level[:, 12] = level[:, 15] = 1.0
    level[:, line_rows.SIGMA] = 0.008
    x = np.zeros(30)
    x[1] = v
    pulls = 9.80665 * 0.004 * rng.normal(size=(4000, 10))
    spread = np.std(pulls.sum(axis=1) * 6.0 / v)
    density = line_motion.lasting_noise(x, np.zeros(3), level, 100.0, False, 6.0, 0.0)
    assert np.sqrt(density * 60.0 / v) == pytest.approx(spread, rel=0.05)


def test_where_the_line_stands_upright_its_slope_pulls_no_more():
    upright = np.zeros((3, 22))
    upright[:, 12] = upright[:, 15] = 1.0
    upright[:, line_rows.SIGMA], upright[:, line_rows.CLIMB] = 0.004, 9.80665
    x = np.zeros(30)
    x[1] = 5.0
    force = np.array([9.80665, 0.0, 0.0])
    assert line_motion.lasting_noise(x, force, upright, 100.0, False, 6.0, 0.0) < 1e-12


def test_the_scale_of_a_brakes_force_is_off_for_as_long_as_it_lasts():
    """Braked by 8 m/s^2 for 1 s, 0.5 % off: 0.04 m/s."""
    level = np.zeros((3, 22))
    level[:, 12] = level[:, 15] = 1.0
    force = np.array([-8.0, 1.0, 9.8])
    density = line_motion.lasting_noise(np.ones(30), force, level, 100.0, False, 6.0, 0.005)
    assert np.sqrt(density * 1.0) == pytest.approx(0.04)

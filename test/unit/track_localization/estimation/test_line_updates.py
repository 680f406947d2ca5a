"""The line filter's measurements, against textbook updates."""

import numpy as np
import pytest

from track_localization.estimation import line_updates
from track_localization.track import line_map

G = 9.80665
SIGMA = 0.004
SETTINGS = np.array([6.0, 9.0, 0.4, 25.0])


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def line_residual(ref, x, table):
    """Rotation vector from the line's attitude, by the spline and scipy."""
    C, M = x[2:11].reshape(3, 3), x[11:20].reshape(3, 3)
    return ref.rotvec(table.line.attitude(x[0]).T @ C @ M.T)


@pytest.mark.parametrize('v', [15.0, 250.0, -9.0])
def test_attitude_match_is_the_textbook_update(ref, rng, table, v):
    """Innovation and Jacobian by finite differences; what repeats itself over 6 m counts once."""
    scales = ref.SCALES.copy()
    scales[0] = 0.3
    x, P = ref.state(rng, table, v=v, off=0.02), ref.covariance(rng, scales)
    H = ref.numeric_jacobian(lambda y: line_residual(ref, y, table), x)
    assert np.abs(H[:, 0]).max() > 0.02
    r, T = line_residual(ref, x, table), 0.05
    R = SIGMA**2 * max(1.0, 6.0 / (abs(v) * T)) * np.eye(3)
    expected = ref.textbook(x, P, -r, H, R)
    nis = np.zeros(3)
    line_updates.match_attitude(x, P, T, *ref.args(table), SETTINGS, nis)
    ref.assert_same_belief((x, P), expected)
    assert (nis > 0.0).all()
    assert (nis < 9.0).all()


def test_nis_of_each_axis_is_its_squared_innovation(ref, rng, table):
    """By the variance of one comparison, not by the larger one of many that err alike."""
    x, P = ref.state(rng, table), ref.covariance(rng)
    H = ref.numeric_jacobian(lambda y: line_residual(ref, y, table), x)
    own = np.diag(H @ P @ H.T) + SIGMA**2
    expected = line_residual(ref, x, table) ** 2 / own
    nis = np.zeros(3)
    line_updates.match_attitude(x, P, 0.05, *ref.args(table), SETTINGS, nis)
    np.testing.assert_allclose(nis, expected, rtol=5e-3)


def test_soft_gate_weighs_an_outlier_down_to_the_gate(ref, rng, table):
    """An axis far off is fused with the variance that makes its NIS equal to the gate."""
    x, P = ref.state(rng, table, off=0.0), ref.covariance(rng)
    x[2:11] = (x[2:11].reshape(3, 3) @ ref.rotation(np.array([0.2, 0.0, 0.0]))).ravel()
    free = x.copy(), P.copy()
    nis = np.zeros(3)
    H = ref.numeric_jacobian(lambda y: line_residual(ref, y, table), x)
    r = line_residual(ref, x, table)
    own = np.diag(H @ P @ H.T) + SIGMA**2 * 6.0 / (15.0 * 0.05)
    R = np.maximum(own * r**2 / own / 9.0, own) - np.diag(H @ P @ H.T)
    assert R.max() > 0.003
    expected = ref.textbook(x, P, -r, H, np.diag(R))
    line_updates.match_attitude(x, P, 0.05, *ref.args(table), SETTINGS, nis)
    assert nis.max() > 30.0
    ref.assert_same_belief((x, P), expected, 0.02)
    open_gate = SETTINGS.copy()
    open_gate[1] = 1e6
    line_updates.match_attitude(*free, 0.05, *ref.args(table), open_gate, nis)
    moved = ref.minus(x, free[0])
    assert np.abs(moved).max() > 1e-3


def test_likelihood_prefers_the_true_place(ref, rng, table):
    """Of hypotheses 4 m apart the one where the vehicle is has the highest log likelihood."""
    totals = []
    for wrong in (-4.0, 0.0, 4.0):
        x = ref.state(np.random.default_rng(1), table, s=80.0, off=0.0)
        P = ref.covariance(rng)
        x[0] += wrong
        totals.append(
            line_updates.match_attitude(x, P, 0.05, *ref.args(table), SETTINGS, np.zeros(3))
        )
    assert int(np.argmax(totals)) == 1


def speed_innovation(x, table):
    usual = 14.0 + 4.0 * np.sin(x[0] / 30.0)
    return np.array([x[1] - usual * (1.0 + x[29])])


def test_speed_match_is_the_textbook_update(ref, rng, table):
    """``v = usual(s) (1 + pace)`` within 0.3 m/s and a share that repeats itself over 20 m."""
    x, P = ref.state(rng, table, v=16.5), ref.covariance(rng)
    H = ref.numeric_jacobian(lambda y: speed_innovation(y, table), x)
    usual, T = 14.0 + 4.0 * np.sin(x[0] / 30.0), 0.05
    R = (0.3**2 + (0.02 * usual) ** 2) * 20.0 / (16.5 * T)
    nu = -speed_innovation(x, table)
    expected = ref.textbook(x, P, nu, H, np.array([[R]]))
    nis = nu[0] ** 2 / (H @ P @ H.T + R)[0, 0]
    got = line_updates.match_speed(x, P, T, *ref.args(table), np.array([0.02, 20.0]))
    ref.assert_same_belief((x, P), expected, 5e-3)
    assert got == pytest.approx(nis, rel=0.01)


@pytest.mark.parametrize('v', [0.0, -8.0])
def test_usual_speed_says_nothing_of_a_train_that_stands_or_rolls_back(ref, rng, table, v):
    x, P = ref.state(rng, table, v=v), ref.covariance(rng)
    x_before, P_before = x.copy(), P.copy()
    assert line_updates.match_speed(x, P, 0.05, *ref.args(table), np.array([0.02, 20.0])) == 0.0
    np.testing.assert_array_equal(x, x_before)
    np.testing.assert_array_equal(P, P_before)


@pytest.mark.parametrize(('sigma', 'heard'), [(0.05, False), (0.3, True)])
def test_usual_speed_is_heard_where_the_train_may_be_faster_than_creeping(
    ref, rng, table, sigma, heard
):
    """At 0.3 m/s where 1 m/s is usual: told to 0.3 m/s it may move, told to 0.05 it creeps."""
    rows = table.rows.copy()
    rows[:, line_map.SPEED], rows[:, line_map.SPEED_SIGMA] = 1.0, 0.05
    x, P = ref.state(rng, table, v=0.3), ref.covariance(rng)
    x[29], before = 0.0, P.copy()
    P[1] *= sigma / np.sqrt(before[1, 1])
    P[:, 1] *= sigma / np.sqrt(before[1, 1])
    # As far as a train at 0.5 m/s comes: 20 m tell one speed.
    R = np.array([[(0.05**2 + 0.02**2) * 20.0 / (0.5 * 0.05)]])
    H = np.zeros((1, 18))
    H[0, 1], H[0, 17] = 1.0, -1.0
    expected = ref.textbook(x, P, np.array([0.7]), H, R) if heard else (x.copy(), P.copy())
    args = (rows, table.step_m, False)
    line_updates.match_speed(x, P, 0.05, *args, np.array([0.02, 20.0]))
    ref.assert_same_belief((x, P), expected, 5e-3)


def test_unknown_usual_speed_says_nothing(ref, rng, table):
    rows = table.rows.copy()
    rows[:, line_map.SPEED] = np.nan
    x, P = ref.state(rng, table), ref.covariance(rng)
    x_before, P_before = x.copy(), P.copy()
    assert (
        line_updates.match_speed(x, P, 0.05, rows, table.step_m, False, np.array([0.02, 20.0]))
        == 0.0
    )
    np.testing.assert_array_equal(x, x_before)
    np.testing.assert_array_equal(P, P_before)


def test_standstill_updates_are_textbook_updates(ref, rng, table):
    """Gravity in the sensor and its bias, the gyro's bias, and a speed of nothing."""
    x, P = ref.state(rng, table, v=0.1), ref.covariance(rng)

    def gravity(y):
        return y[2:11].reshape(3, 3).T @ [0.0, 0.0, G] + y[26:29]

    force = gravity(x) + 0.05 * rng.normal(size=3)
    H = ref.numeric_jacobian(gravity, x)
    expected = ref.textbook(x, P, force - gravity(x), H, 0.02**2 * np.eye(3))
    line_updates.level(x, P, force, 0.02)
    ref.assert_same_belief((x, P), expected)

    rate = np.array([0.012, -0.02, 0.004])
    H = ref.numeric_jacobian(lambda y: y[20:23], x)
    expected = ref.textbook(x, P, rate - x[20:23], H, 2e-3**2 * np.eye(3))
    line_updates.still_gyro(x, P, rate, 2e-3)
    ref.assert_same_belief((x, P), expected)

    expected = ref.textbook(x, P, -x[1:2], np.eye(18)[1:2], np.array([[1e-4]]))
    line_updates.hold(x, P, 0.01)
    ref.assert_same_belief((x, P), expected)

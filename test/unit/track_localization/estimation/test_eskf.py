"""The filter's mathematics: Jacobians by finite differences, consistency by simulated truth."""

import numpy as np
import pytest

from track_localization.estimation import eskf, so3

G = np.array([0.0, 0.0, -9.80665])


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def some_state(rng):
    sigmas = (np.ones(3), np.ones(3), np.full(3, 0.05), 0.05, 0.01, 0.02)
    return eskf.make_state(
        3.0,
        rng.normal(size=3) * 10,
        rng.normal(size=3) * 10,
        so3.exp(rng.normal(size=3)),
        G,
        sigmas,
        accel_bias=rng.normal(size=3) * 0.1,
        gyro_bias=rng.normal(size=3) * 0.01,
    )


def test_transition_is_the_derivative_of_the_prediction(rng):
    """F against central differences of the nominal prediction, over every error state."""
    state, dt = some_state(rng), 0.01
    f, w = rng.normal(size=3) * 15, rng.normal(size=3)
    q = np.zeros(4)

    def predicted(error):
        x = eskf.box_plus(state.x, error)
        return eskf.propagate(state._replace(x=x), f, w, dt, q).x

    reference = predicted(np.zeros(18))
    numeric = np.empty((18, 18))
    step = 1e-5
    for j in range(18):
        e = np.zeros(18)
        e[j] = step
        up = eskf.box_minus(predicted(e), reference)
        down = eskf.box_minus(predicted(-e), reference)
        numeric[:, j] = (up - down) / (2 * step)
    # dt^2 terms that the filter drops (attitude within the step) are of the order of 1e-3.
    np.testing.assert_allclose(eskf.transition(state, f, w, dt), numeric, atol=2e-3)


def test_covariance_prediction_is_f_p_f_plus_q(rng):
    state, dt = some_state(rng), 0.02
    f, w = rng.normal(size=3) * 15, rng.normal(size=3)
    q = np.array([0.3, 0.02, 0.01, 0.001])
    F = eskf.transition(state, f, w, dt)
    expected = F @ state.P @ F.T
    for i in range(3):
        expected[i, i] += q[0] * dt**2 / 3
        expected[i, 3 + i] += q[0] * dt / 2
        expected[3 + i, i] += q[0] * dt / 2
    expected[range(3, 15), range(3, 15)] += np.repeat(q, 3)
    np.testing.assert_allclose(eskf.propagate(state, f, w, dt, q).P, expected, atol=1e-12)


def test_box_minus_is_the_inverse_of_box_plus(rng):
    x, e = some_state(rng).x, rng.normal(size=18) * 0.5
    np.testing.assert_allclose(eskf.box_minus(eskf.box_plus(x, e), x), e, atol=1e-9)


def test_update_is_the_textbook_posterior(rng):
    """Against the information form: P^-1 = P0^-1 + H' R^-1 H, before the reset's small rotation."""
    state = some_state(rng)
    H = np.zeros((3, 18))
    H[:, 0:3] = np.eye(3)
    R = np.diag([0.01, 0.04, 0.09])
    nu = np.array([0.5, -0.3, 0.2])
    after = eskf.update(state, nu, H, R)
    information = np.linalg.inv(state.P) + H.T @ np.linalg.inv(R) @ H
    expected = np.linalg.inv(information)
    np.testing.assert_allclose(after.P, expected, atol=1e-9)
    gain = expected @ H.T @ np.linalg.inv(R)
    np.testing.assert_allclose(after.position, state.position + (gain @ nu)[:3], atol=1e-9)


def test_update_stays_symmetric_and_positive_with_almost_perfect_measurements(rng):
    state = some_state(rng)
    H = np.eye(18)[:6]
    for _ in range(50):
        state = eskf.update(state, rng.normal(size=6) * 1e-6, H, np.eye(6) * 1e-12)
    np.testing.assert_array_equal(state.P, state.P.T)
    assert np.linalg.eigvalsh(state.P)[0] > -1e-15


def test_filter_is_consistent_over_fifty_runs():
    """NEES of all 18 states over seeded runs lies in its chi-square interval (99.9 %)."""
    noise = eskf.ImuNoise(0.02, 0.002, 0.005, 0.0005)
    dt, steps, runs = 0.02, 400, 50
    total = 0.0
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        total += final_nees(rng, noise, dt, steps)
    # A sum of 50 chi-squares with 18 degrees: mean 900, std 42.4; 3.3 std either way.
    assert 900 - 140 < total < 900 + 140


def final_nees(rng, noise, dt, steps):
    sigmas = (np.full(3, 0.3), np.full(3, 0.1), np.full(3, 0.02), 0.05, 0.005, 0.01)
    truth = eskf.make_state(0.0, np.zeros(3), np.array([5.0, 0, 0]), np.eye(3), G, sigmas)
    start = eskf.box_plus(truth.x, -rng.normal(size=18) * np.sqrt(np.diag(truth.P)))
    state = truth._replace(x=start)
    x = truth.x
    H = np.zeros((3, 18))
    H[:, 0:3] = np.eye(3)
    R = np.eye(3) * 0.04
    for k in range(steps):
        t = k * dt
        w = np.array([0.3 * np.sin(t), 0.2, 0.4 * np.cos(0.7 * t)])
        f = np.array([2 * np.sin(0.5 * t), 1.0, 9.8 + 3 * np.cos(t)])
        walk = rng.normal(size=6) * np.sqrt(dt)
        x = x.copy()
        x[15:18] += walk[:3] * noise.accel_walk
        x[18:21] += walk[3:] * noise.gyro_walk
        f_m = f + x[15:18] + rng.normal(size=3) * noise.accel / np.sqrt(dt)
        w_m = w + x[18:21] + rng.normal(size=3) * noise.gyro / np.sqrt(dt)
        x = exact_motion(x, f, w, dt)
        q = eskf.process_noise(noise, f_m, w_m, dt, 0.0)
        state = eskf.propagate(state, f_m, w_m, dt, q)
        if k % 10 == 9:
            z = x[0:3] + rng.normal(size=3) * 0.2
            state = eskf.update(state, z - state.position, H, R)
    e = eskf.box_minus(x, state.x)
    return float(e @ np.linalg.solve(state.P, e))


def exact_motion(x, f, w, dt):
    """The true motion over a step, in small sub-steps of its own (not the filter's rule)."""
    x = x.copy()
    R = x[6:15].reshape(3, 3)
    h = dt / 10
    turn = np.cross(np.eye(3), w * h)  # the cross-product matrix of w h
    turn = np.eye(3) + turn + 0.5 * turn @ turn
    for _ in range(10):
        a = R @ f + x[21:24]
        x[0:3] += x[3:6] * h + 0.5 * a * h * h
        x[3:6] += a * h
        R = R @ turn
    x[6:15] = R.ravel()
    return x

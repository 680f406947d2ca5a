"""RTS against the batch posterior of a linear Gaussian model."""

import numpy as np

from track_localization.estimation.smoother import eliminated, gain, rts_smooth


def test_smoother_equals_the_batch_posterior():
    """Constant velocity, positions measured: smoothing must equal weighted least squares."""
    rng = np.random.default_rng(3)
    n, dt = 12, 0.5
    F = np.array([[1.0, dt], [0.0, 1.0]])
    Q = np.array([[0.02, 0.01], [0.01, 0.03]])
    H = np.array([[1.0, 0.0]])
    R = np.array([[0.25]])
    m0, P0 = np.array([1.0, 0.5]), np.diag([2.0, 1.0])
    z = rng.normal(size=n) * 2.0

    x, P, x_f, P_f = m0, P0, [], []
    for k in range(n):
        if k:
            x, P = F @ x, F @ P @ F.T + Q
        K = P @ H.T / (H @ P @ H.T + R)
        x = x + (K * (z[k] - H @ x)).ravel()
        P = P - K @ H @ P
        x_f.append(x)
        P_f.append(P)
    smoothed, P_s = rts_smooth(
        x_f,
        P_f,
        lambda k: (F @ x_f[k], F @ P_f[k] @ F.T + Q, F),
        lambda a, b: a - b,
        lambda a, e: a + e,
    )

    information = np.zeros((2 * n, 2 * n))
    vector = np.zeros(2 * n)
    information[:2, :2] += np.linalg.inv(P0)
    vector[:2] += np.linalg.inv(P0) @ m0
    for k in range(n):
        block = slice(2 * k, 2 * k + 2)
        information[block, block] += H.T @ H / R
        vector[block] += (H.T @ np.array([z[k]])) / R[0, 0]
        if k:
            D = np.hstack([-F, np.eye(2)])
            pair = slice(2 * k - 2, 2 * k + 2)
            information[pair, pair] += D.T @ np.linalg.inv(Q) @ D
    batch = np.linalg.solve(information, vector).reshape(n, 2)
    covariance = np.linalg.inv(information)
    np.testing.assert_allclose(smoothed, batch, atol=1e-8)
    for k in range(n):
        block = slice(2 * k, 2 * k + 2)
        np.testing.assert_allclose(P_s[k], covariance[block, block], atol=1e-8)


def test_elimination_solves_what_is_positive_definite():
    """Against the general solver, of 18 states as correlated as a filter's."""
    rng = np.random.default_rng(4)
    A = rng.normal(size=(18, 18))
    A, B = A @ A.T, rng.normal(size=(18, 7))
    d = 1.0 / np.sqrt(np.diag(A))
    A *= np.outer(d, d)
    solution = B.copy()
    assert eliminated(A.copy(), solution)
    np.testing.assert_allclose(A @ solution, B, atol=1e-9)


def test_gain_of_a_prediction_that_is_not_positive_definite_is_the_general_solvers():
    """Elimination gives up on it: P F' P_pred^-1 then comes from a solver with pivots."""
    rng = np.random.default_rng(5)
    F, P = np.eye(3) + 0.1 * rng.normal(size=(3, 3)), np.diag([1.0, 2.0, 3.0])
    P_pred = np.array([[1.0, 2.0, 0.1], [2.0, 1.0, 0.2], [0.1, 0.2, 1.0]])
    assert not eliminated(P_pred.copy(), np.eye(3))
    np.testing.assert_allclose(gain(P, P_pred, F), P @ F.T @ np.linalg.inv(P_pred), atol=1e-12)

"""RTS against the batch posterior of a linear Gaussian model."""

import numpy as np

from track_localization.estimation.smoother import rts_smooth


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

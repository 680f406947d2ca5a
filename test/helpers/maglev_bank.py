"""A bank of one hypothesis, and the dense Kalman update that it is held against."""

from __future__ import annotations

import numpy as np

from maglev_localization.line_kernels import SIZE, A, B, C, K, S, V

SHARE = 0.5
MEAN = np.array([500.0, 20.0, 0.0, -400.0, 0.0, 0.005])
SIGMA = np.array([0.03, 0.05, 0.1, 0.1, 1e-4, 2e-3])


def one(mean=MEAN, sigma=SIGMA, **changes):
    """Return a bank of one hypothesis, federated; ``v=3.0`` sets a mean."""
    names = {'c': C, 'v': V, 'a': A, 'b': B, 's': S, 'k': K}
    mean = mean.copy()
    for name, value in changes.items():
        mean[names[name]] = value
    x = np.tile(mean, (1, 2, 1))
    P = np.tile(np.diag(np.asarray(sigma) ** 2) / SHARE, (1, 2, 1, 1))
    return np.zeros(1), x, P


def joseph(x, P, H, nu, R):
    gain = P @ H / (H @ P @ H + R)
    part = np.eye(SIZE) - np.outer(gain, H)
    return x + gain * nu, part @ P @ part.T + R * np.outer(gain, gain)


def close(P, expected, share=1e-9):
    d = np.sqrt(np.diag(expected))
    return bool(np.abs((P - expected) / np.outer(d, d)).max() < share)

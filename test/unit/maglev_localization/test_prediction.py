"""An estimate carried on in time, against trains that are driven on."""

from __future__ import annotations

import numpy as np

from maglev_localization.estimate import Estimate
from maglev_localization.prediction import predicted


def estimate() -> Estimate:
    factor = np.array([[0.4, 0.0, 0.0], [0.1, 0.5, 0.0], [0.02, -0.05, 0.1]])
    return Estimate(12.5, np.array([300.0, 20.0, 0.7]), factor @ factor.T)


def test_a_prediction_is_that_of_trains_driven_on_by_white_jerk():
    """
    Mean and covariance after 1.5 s of 20,000 trains, integrated in steps of 5 ms.

    A covariance of so many draws is known to 1 %, 0.01 of the product of two sigmas; three of
    those, and the mean to 0.7 % of a sigma.
    """
    rng = np.random.default_rng(2)
    before, density, dt = estimate(), 0.8, 0.005
    x = rng.multivariate_normal(before.mean, before.covariance, 20_000)
    for _ in range(300):
        jerk = rng.normal(0.0, np.sqrt(density / dt), len(x))
        x[:, 0] += x[:, 1] * dt + x[:, 2] * dt**2 / 2.0 + jerk * dt**3 / 6.0
        x[:, 1] += x[:, 2] * dt + jerk * dt**2 / 2.0
        x[:, 2] += jerk * dt
    after = predicted(before, 14.0, density)
    assert after.time_s == 14.0
    sigma = np.sqrt(after.covariance.diagonal())
    np.testing.assert_allclose((x.mean(axis=0) - after.mean) / sigma, 0.0, atol=0.03)
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(np.cov(x.T) / scale, after.covariance / scale, atol=0.03)


def test_a_prediction_to_its_own_time_changes_nothing():
    before = estimate()
    after = predicted(before, before.time_s, 1.0)
    np.testing.assert_array_equal(after.mean, before.mean)
    np.testing.assert_array_equal(after.covariance, before.covariance)

"""Consistency figures on samples whose distribution is known."""

import numpy as np
import pytest

from track_localization.evaluation.consistency import (
    inside_sigma,
    mean_nees_bounds,
    position_nees,
)


def sample(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    A = rng.normal(size=(3, 3)) + 3.0 * np.eye(3)
    return rng.normal(size=(count, 3)) @ A.T, np.broadcast_to(A @ A.T, (count, 3, 3))


def test_nees_of_gaussian_errors_is_the_dimension():
    """Mean NEES / 3 of 4000 draws from the claimed covariance lies in its 99.9 % interval."""
    nees = position_nees(*sample(4000))
    low, high = mean_nees_bounds(3, 4000, 0.999)
    assert low < nees.mean() / 3.0 < high
    assert 0.94 < low < 1.0 < high < 1.06


def test_nees_shows_a_covariance_that_claims_too_little():
    error, covariance = sample(500)
    assert position_nees(error, covariance / 4.0).mean() / 3.0 == pytest.approx(4.0, rel=0.15)


def test_nees_by_hand_and_where_it_cannot_be():
    error = np.array([[1.0, 2.0, 3.0]] * 3)
    covariance = np.stack([np.diag([1.0, 4.0, 9.0]), np.zeros((3, 3)), np.full((3, 3), np.nan)])
    np.testing.assert_allclose(position_nees(error, covariance), [3.0, np.nan, np.nan])


def test_bounds_of_one_value_are_those_of_chi_square():
    """Chi-square with 3 degrees of freedom: 2.5 % below 0.2158, 2.5 % above 9.348 (tables)."""
    low, high = mean_nees_bounds(3, 1)
    assert low * 3.0 == pytest.approx(0.2158, abs=1e-4)
    assert high * 3.0 == pytest.approx(9.3484, abs=1e-4)


def test_coverage_by_hand_and_for_a_gaussian():
    assert inside_sigma(np.array([1.0, -3.0, np.nan, 1.0]), np.array([1, 1, 1, np.nan]), 2) == 0.5
    assert np.isnan(inside_sigma(np.array([1.0]), np.array([np.nan]), 2.0))
    error = np.random.default_rng(1).normal(size=20_000)
    assert inside_sigma(error, np.ones(20_000), 2.0) == pytest.approx(0.9545, abs=0.005)

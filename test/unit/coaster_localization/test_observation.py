"""Eq. (21) and the checks on a match."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coaster_localization.observation import MatchObservation, observation_covariance, problem


def test_covariance_has_the_lambdas_along_the_vehicle_axes():
    R = Rotation.from_euler('ZYX', [0.7, -0.4, 0.2]).as_matrix()
    V = observation_covariance(R, 10.0, 0.01, 0.02)
    np.testing.assert_allclose(V @ R[:, 0], 10.0 * R[:, 0], atol=1e-12)
    np.testing.assert_allclose(V @ R[:, 1], 0.01 * R[:, 1], atol=1e-12)
    np.testing.assert_allclose(V @ R[:, 2], 0.02 * R[:, 2], atol=1e-12)


def test_covariance_of_many_attitudes_at_once():
    R = Rotation.random(5, random_state=1).as_matrix()
    lambda_x = np.arange(1.0, 6.0)
    V = observation_covariance(R, lambda_x, 0.1, 0.1)
    assert V.shape == (5, 3, 3)
    for k in range(5):
        alone = observation_covariance(R[k], lambda_x[k], 0.1, 0.1)
        np.testing.assert_allclose(V[k], alone, atol=1e-14)


GOOD = MatchObservation(1.0, np.zeros(3), np.array([0.0, 0, 0, 1]), np.eye(3))


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({}, None),
        ({'time_s': float('nan')}, 'not_finite'),
        ({'position': np.array([0.0, np.inf, 0.0])}, 'not_finite'),
        ({'covariance': np.full((3, 3), np.nan)}, 'not_finite'),
        ({'covariance': np.zeros((3, 3))}, 'covariance_not_positive'),
        ({'covariance': -np.eye(3)}, 'covariance_not_positive'),
        ({'covariance': np.eye(3) + np.eye(3, k=1)}, 'covariance_not_symmetric'),
    ],
)
def test_problem_names_the_reason(changes, reason):
    assert problem(dataclasses.replace(GOOD, **changes)) == reason

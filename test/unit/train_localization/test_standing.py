"""A standing train by its IMU, and one that only seems to stand."""

from __future__ import annotations

import numpy as np
import pytest

from track_localization.estimation import so3
from train_localization.kernels import AUX, SIZE
from train_localization.standing import quiet

EARTH = 7.292115e-5 * np.array([0.0, np.cos(0.7), np.sin(0.7)])
GRAVITY = 9.80137
"""At 0.7 rad of latitude and sea level by the WGS 84 formula [m/s^2]."""
BIAS = np.array([1e-4, -2e-4, 3e-4, 0.02, -0.03, 0.01])


@pytest.fixture
def standing():
    """A train that leans and climbs: state, covariance, rate and force at rest."""
    R = so3.matrix_from_rpy(0.05, -0.02, 0.8)
    nav = np.concatenate([[0.7, 2.0, 0.0], np.zeros(3), so3.quat_from_matrix(R)])
    aux = np.zeros(AUX)
    aux[:6] = BIAS
    P = np.diag(np.full(SIZE, 1e-8))
    return nav, aux, P, R.T @ EARTH + BIAS[:3], R.T @ [0.0, 0.0, GRAVITY] + BIAS[3:]


def test_a_standing_train_is_quiet(standing, rng):
    """Engines shake it by 1 sigma of what is allowed; at 3 sigma one in 60 is refused."""
    nav, aux, P, rate, force = standing
    shaken = [
        quiet(
            nav,
            aux,
            P,
            rate + 4e-3 * rng.standard_normal(3),
            force + 0.06 * rng.standard_normal(3),
        )
        for _ in range(500)
    ]
    assert np.mean(shaken) > 0.96


@pytest.mark.parametrize('axis', [0, 1, 2])
@pytest.mark.parametrize(('turning', 'gain'), [(0.02, 0.0), (-0.02, 0.0), (0.0, 0.3), (0.0, -0.3)])
def test_a_train_that_starts_is_not(standing, axis, turning, gain):
    nav, aux, P, rate, force = standing
    rate[axis] += turning
    force[axis] += gain
    assert not quiet(nav, aux, P, rate, force)


def test_a_train_that_creeps_is_not(standing):
    """0.1 m/s, gained so gently that no sample told; where it is unknown, it may be none."""
    nav, aux, P, rate, force = standing
    nav[3] = 0.1
    assert not quiet(nav, aux, P, rate, force)
    P[3, 3] = 0.1**2
    assert quiet(nav, aux, P, rate, force)


def test_where_the_level_is_unknown_gravity_is_no_acceleration(standing):
    """A lean of 0.03 rad is 0.3 m/s^2 of the platform's axes: plausible while sigma is 0.03."""
    nav, aux, P, rate, _ = standing
    leaning = so3.matrix_from_quat(nav[6:10]) @ so3.exp(np.array([0.03, 0.0, 0.0]))
    force = leaning.T @ [0.0, 0.0, GRAVITY] + BIAS[3:]
    assert not quiet(nav, aux, P, rate, force)
    P[6, 6] = P[7, 7] = 0.03**2
    assert quiet(nav, aux, P, rate, force)

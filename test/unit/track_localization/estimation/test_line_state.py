"""The line filter's error state and its joint update, against scipy and the textbook."""

import numpy as np
import pytest

from track_localization.estimation import line_state


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_add_error_and_difference_follow_their_definition(ref, rng, table):
    x = ref.state(rng, table)
    e = rng.normal(size=18) * np.repeat([1.0, 0.3, 1.0], [2, 6, 10])
    moved = x.copy()
    line_state.add_error(moved, e)
    np.testing.assert_allclose(moved, ref.plus(x, e), atol=1e-12)
    np.testing.assert_allclose(line_state.difference(moved, x), e, atol=1e-12)
    back = moved.copy()
    line_state.add_error(back, line_state.difference(x, moved))
    np.testing.assert_allclose(back, x, atol=1e-12)


def test_correct_is_the_joint_update(ref, rng, table):
    """Part by part gives what the joint update with a matrix inverse gives."""
    x, P = ref.state(rng, table), ref.covariance(rng)
    H = rng.normal(size=(5, 18)) / ref.SCALES
    R = rng.uniform(0.5, 3.0, 5)
    nu = rng.normal(size=5) * 2.0
    expected = ref.textbook(x, P, nu, H, np.diag(R))
    line_state.correct(x, P, nu, H, R)
    ref.assert_same_belief((x, P), expected, 1e-4)
    np.testing.assert_allclose(P, P.T, atol=1e-18)


def test_large_correction_turns_the_covariance_with_the_attitude(ref, rng, table):
    """A correction of 0.2 rad: the reset is a rotation by half of it, to the second order."""
    scales = ref.SCALES.copy()
    scales[2:8] = 0.2
    x, P = ref.state(rng, table), ref.covariance(rng, scales)
    H = np.zeros((2, 18))
    H[0, 2], H[1, 6] = 1.0, 1.0
    R, nu = np.array([0.01, 0.02]), np.array([0.2, -0.15])
    expected = ref.textbook(x, P, nu, H, np.diag(R))
    line_state.correct(x, P, nu, H, R)
    # Second order: 0.2^2 / 24; without the reset parts are off by 0.1.
    ref.assert_same_belief((x, P), expected, 6e-3)


def test_repeated_exact_measurements_leave_a_covariance(ref, rng, table):
    x, P = ref.state(rng, table), ref.covariance(rng)
    for _ in range(50):
        line_state.correct(x, P, rng.normal(size=6) * 1e-6, np.eye(18)[2:8], np.full(6, 1e-14))
    np.testing.assert_allclose(P, P.T, atol=1e-18)
    d = 1.0 / ref.SCALES
    assert np.linalg.eigvalsh(P * np.outer(d, d))[0] > -1e-10

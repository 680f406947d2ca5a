"""Rotations against closed forms and against each other's definitions."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from track_localization.estimation import so3


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_exp_is_the_matrix_exponential_of_hat(rng):
    for theta in rng.normal(size=(20, 3)) * 2.0:
        np.testing.assert_allclose(so3.exp(theta), expm(so3.hat(theta)), atol=1e-12)
        np.testing.assert_allclose(so3.exp_one(theta), expm(so3.hat(theta)), atol=1e-12)


@pytest.mark.parametrize('size', [1e-9, 1e-7, 1e-5])
def test_exp_one_of_small_angles(size):
    theta = np.array([1.0, -2.0, 3.0]) * size
    np.testing.assert_allclose(so3.exp_one(theta), expm(so3.hat(theta)), atol=1e-15)


def test_hat_is_the_cross_product(rng):
    a, b = rng.normal(size=(2, 7, 3))
    np.testing.assert_allclose(np.einsum('nij,nj->ni', so3.hat(a), b), np.cross(a, b), atol=1e-14)


def test_log_takes_exp_back(rng):
    theta = rng.normal(size=(4, 5, 3))
    theta *= (rng.uniform(0.0, np.pi - 1e-3, size=(4, 5)) / np.linalg.norm(theta, axis=-1))[
        ..., None
    ]
    np.testing.assert_allclose(so3.log(so3.exp(theta)), theta, atol=1e-9)


def test_quaternion_of_a_quarter_turn_left():
    q = so3.quat_from_matrix(so3.matrix_from_rpy(0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(np.abs(q), [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)
    assert q[2] * q[3] > 0.0
    np.testing.assert_allclose(so3.matrix_from_quat(q) @ [1.0, 0.0, 0.0], [0, 1, 0], atol=1e-12)


def test_climb_has_negative_pitch_and_left_bank_negative_roll():
    climb = so3.matrix_from_rpy(0.0, -0.3, 0.0)
    assert (climb @ [1.0, 0.0, 0.0])[2] > 0.0
    bank = so3.matrix_from_rpy(-0.3, 0.0, 0.0)
    assert (bank @ [0.0, 1.0, 0.0])[2] < 0.0


def test_euler_angles_come_back(rng):
    for yaw, pitch, roll in rng.uniform(-1.4, 1.4, size=(20, 3)):
        found = so3.euler_zyx(so3.matrix_from_rpy(roll, pitch, yaw))
        np.testing.assert_allclose(found, (yaw, pitch, roll), atol=1e-12)


def test_normalised_one_restores_a_rotation(rng):
    R = so3.exp(rng.normal(size=3))
    near = so3.normalised_one(R + rng.normal(size=(3, 3)) * 1e-4)
    np.testing.assert_allclose(near @ near.T, np.eye(3), atol=1e-7)
    np.testing.assert_allclose(near, R, atol=1e-3)


def test_quat_one_is_scipys_quaternion(rng):
    """All four branches: random rotations, and half turns about each axis."""
    turns = list(Rotation.random(200, rng=rng)) + [
        Rotation.from_rotvec(np.pi * 0.999 * axis) for axis in np.eye(3)
    ]
    for turn in turns:
        q, expected = so3.quat_one(turn.as_matrix()), turn.as_quat()
        np.testing.assert_allclose(q * np.sign(q @ expected), expected, atol=1e-12)


def test_matrix_one_is_scipys_matrix(rng):
    for q in rng.normal(size=(20, 4)):
        np.testing.assert_allclose(so3.matrix_one(q), Rotation.from_quat(q).as_matrix(), atol=1e-14)


def test_small_products_are_the_matrix_products(rng):
    A, B, v = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)
    np.testing.assert_allclose(so3.product_one(A, B), A @ B, atol=1e-14)
    np.testing.assert_allclose(so3.turned_one(A, v), A @ v, atol=1e-14)

"""Quaternions as tuples against scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from track_localization.estimation import quaternion as quat

# Rotation vectors on both sides of the switch between series and sines, and none at all.
ANGLES = [0.0, 1e-9, 1e-4, 0.00999, 0.01001, 0.3, 2.0, 3.1, 5.0]


@pytest.mark.parametrize('angle', ANGLES)
def test_rotation_vector_and_matrix(angle, rng):
    axis = rng.normal(size=3)
    v = angle * axis / np.linalg.norm(axis)
    q = quat.from_rotation_vector(tuple(v))
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-14)
    expected = Rotation.from_rotvec(v)
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), expected.as_matrix(), atol=1e-14)
    found = np.empty((3, 3))
    quat.matrix(*q, found)
    np.testing.assert_allclose(found, expected.as_matrix(), atol=1e-14)


def test_product_and_rotation_of_vectors(rng):
    a, b = Rotation.random(2, rng=rng)
    qa, qb = tuple(a.as_quat()), tuple(b.as_quat())
    both = Rotation.from_quat(quat.product(qa, qb))
    np.testing.assert_allclose(both.as_matrix(), (a * b).as_matrix(), atol=1e-14)
    v = rng.normal(size=3)
    np.testing.assert_allclose(quat.rotate(qa, tuple(v)), a.apply(v), atol=1e-14)


def test_write_unit_takes_any_length(rng):
    q, out = rng.normal(size=4), np.empty(4)
    quat.write_unit(tuple(1e3 * q), out)
    np.testing.assert_allclose(out, q / np.linalg.norm(q), rtol=1e-14)

"""
Quaternions x, y, z, w and vectors as tuples of numbers: compiled code keeps them in registers.

For arrays of rotations see ``so3``.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@numba.njit(cache=True)
def vector(a: Array) -> Vector:
    """Return an array (3,) as a tuple."""
    return a[0], a[1], a[2]


@numba.njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the quaternion that turns by ``b`` first and then by ``a``."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@numba.njit(cache=True)
def from_rotation_vector(v: Vector) -> Quaternion:
    """Return the unit quaternion of a rotation vector [rad]."""
    angle2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if angle2 < 1e-4:
        # The first term that is left out is below 1e-15.
        c = 1.0 - angle2 / 8.0 * (1.0 - angle2 / 48.0)
        s = 0.5 - angle2 / 48.0 * (1.0 - angle2 / 80.0)
    else:
        angle = np.sqrt(angle2)
        c, s = np.cos(0.5 * angle), np.sin(0.5 * angle) / angle
    return s * v[0], s * v[1], s * v[2], c


@numba.njit(cache=True)
def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return ``v`` turned by a unit quaternion."""
    x, y, z = cross((q[0], q[1], q[2]), v)
    a, b, c = cross((q[0], q[1], q[2]), (x, y, z))
    return (
        v[0] + 2.0 * (q[3] * x + a),
        v[1] + 2.0 * (q[3] * y + b),
        v[2] + 2.0 * (q[3] * z + c),
    )


@numba.njit(cache=True)
def write_unit(q: Quaternion, out: Array) -> None:
    """Write ``q`` into ``out`` (4,), normalised."""
    scale = 1.0 / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        out[i] = scale * q[i]


@numba.njit(cache=True)
def matrix(x: float, y: float, z: float, w: float, out: Array) -> None:
    """Write the rotation matrix (3, 3) of a unit quaternion into ``out``."""
    out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    out[0, 1], out[1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    out[0, 2], out[2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    out[1, 2], out[2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)

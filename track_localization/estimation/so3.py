"""
Rotations: exponential and logarithm, quaternions, Euler angles.

Array functions take any leading shape and lean on scipy; the ``*_one`` kernels are compiled, for
use inside compiled loops.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def _apply(values: Array, tail: tuple[int, ...], function: str, maker: str) -> Array:
    """Run one scipy conversion over any leading shape."""
    lead = values.shape[: values.ndim - len(tail)]
    rotations = getattr(Rotation, maker)(values.reshape(-1, *tail))
    out: Array = getattr(rotations, function)()
    return out.reshape(lead + out.shape[1:])


def exp(theta: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    return _apply(np.asarray(theta, dtype=float), (3,), 'as_matrix', 'from_rotvec')


def log(R: Array) -> Array:
    """Return the rotation vectors (..., 3) [rad], length at most pi, of matrices (..., 3, 3)."""
    return _apply(np.asarray(R, dtype=float), (3, 3), 'as_rotvec', 'from_matrix')


def hat(v: Array) -> Array:
    """Return the matrices (..., 3, 3) for which ``hat(a) @ b`` is the cross product a x b."""
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def quat_from_matrix(R: Array) -> Array:
    """Return quaternions (..., 4), x y z w, of matrices (..., 3, 3)."""
    return _apply(np.asarray(R, dtype=float), (3, 3), 'as_quat', 'from_matrix')


def matrix_from_quat(q: Array) -> Array:
    """Return matrices (..., 3, 3) of quaternions (..., 4), x y z w, of any non-zero length."""
    return _apply(np.asarray(q, dtype=float), (4,), 'as_matrix', 'from_quat')


def matrix_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return ``Rz(yaw) Ry(pitch) Rx(roll)``, angles in rad."""
    R: Array = Rotation.from_euler('ZYX', [yaw, pitch, roll]).as_matrix()
    return R


def euler_zyx(R: Array) -> tuple[Array, Array, Array]:
    """
    Return yaw, pitch, roll [rad] of matrices (..., 3, 3), ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    Each angle is on its principal branch; at pitch = +-90 deg yaw and roll are not defined apart
    and what comes out is whatever arctan2 makes of rounding.
    """
    pitch = -np.arcsin(np.clip(R[..., 2, 0], -1.0, 1.0))
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    return yaw, pitch, roll


@numba.njit(cache=True)
def exp_one(theta: Array) -> Array:
    """Return the rotation matrix (3, 3) of one rotation vector (3,) (Rodrigues)."""
    x, y, z = theta[0], theta[1], theta[2]
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-12:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = np.sqrt(angle2)
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    out = np.empty((3, 3))
    out[0, 0] = 1.0 - b * (y * y + z * z)
    out[1, 1] = 1.0 - b * (x * x + z * z)
    out[2, 2] = 1.0 - b * (x * x + y * y)
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x
    return out


@numba.njit(cache=True)
def log_one(R: Array) -> Array:
    """Return the rotation vector (3,) of one rotation matrix, for angles below 3 rad."""
    out = np.empty(3)
    out[0] = 0.5 * (R[2, 1] - R[1, 2])
    out[1] = 0.5 * (R[0, 2] - R[2, 0])
    out[2] = 0.5 * (R[1, 0] - R[0, 1])
    sine = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    if sine > 1e-9:
        out *= np.arctan2(sine, cosine) / sine
    return out


@numba.njit(cache=True)
def product_one(A: Array, B: Array) -> Array:
    """Return ``A B`` of two matrices (3, 3); calling BLAS would cost more than the product."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return out


@numba.njit(cache=True)
def turned_one(R: Array, v: Array) -> Array:
    """Return ``R v`` of a matrix (3, 3) and a vector (3,)."""
    out = np.empty(3)
    for i in range(3):
        out[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]
    return out


@numba.njit(cache=True)
def normalised_one(R: Array) -> Array:
    """Return the rotation nearest to an almost orthonormal matrix (one Newton step)."""
    out = product_one(R, product_one(R.T, R))
    for i in range(3):
        for j in range(3):
            out[i, j] = 1.5 * R[i, j] - 0.5 * out[i, j]
    return out


@numba.njit(cache=True)
def matrix_one(q: Array) -> Array:
    """Return the matrix (3, 3) of one quaternion (4,), x y z w, of any non-zero length."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    s = 2.0 / (x * x + y * y + z * z + w * w)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)
    R[1, 0], R[1, 1], R[1, 2] = s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)
    R[2, 0], R[2, 1], R[2, 2] = s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)
    return R


@numba.njit(cache=True)
def quat_one(R: Array) -> Array:
    """Return the quaternion (4,), x y z w, of one matrix, its largest part positive (Shepperd)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    q = np.empty(4)
    i = 0
    for k in range(1, 3):
        if R[k, k] > R[i, i]:
            i = k
    if trace >= R[i, i]:
        q[0], q[1], q[2] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
        q[3] = 1.0 + trace
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = 1.0 - trace + 2.0 * R[i, i]
        q[j], q[k] = R[j, i] + R[i, j], R[k, i] + R[i, k]
        q[3] = R[k, j] - R[j, k]
    return q / np.sqrt(np.sum(q * q))

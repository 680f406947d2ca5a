"""References that tests of this folder share, none of them the project's own code."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from track_localization.track.centreline import Centreline
from track_localization.track.line_map import LineMap

SEMI_MAJOR, SEMI_MINOR = 6378137.0, 6356752.314245
FOCAL = np.sqrt(SEMI_MAJOR**2 - SEMI_MINOR**2)
GM, RATE = 3.986004418e14, 7.292115e-5


def _normal_gravity(lat: float, h: float) -> float:
    """
    Return normal gravity along the ellipsoid's normal [m/s^2] from the exact closed potential.

    In ellipsoidal-harmonic coordinates (NIMA TR8350.2, chapter 4); no series in height.
    """
    across = SEMI_MAJOR**2 / np.hypot(SEMI_MAJOR * np.cos(lat), SEMI_MINOR * np.sin(lat))
    p = (across + h) * np.cos(lat)
    z = (across * (SEMI_MINOR / SEMI_MAJOR) ** 2 + h) * np.sin(lat)
    d = p * p + z * z - FOCAL**2
    u = np.sqrt(0.5 * d * (1.0 + np.sqrt(1.0 + 4.0 * (FOCAL * z / d) ** 2)))
    long = np.hypot(u, FOCAL)
    beta = np.arctan2(z * long, u * p)
    s, c = np.sin(beta), np.cos(beta)
    w = np.sqrt((u * u + (FOCAL * s) ** 2) / (u * u + FOCAL**2))

    def q(x: float) -> float:
        return 0.5 * ((1.0 + 3.0 * (x / FOCAL) ** 2) * np.arctan(FOCAL / x) - 3.0 * x / FOCAL)

    slope = 3.0 * (1.0 + (u / FOCAL) ** 2) * (1.0 - u / FOCAL * np.arctan(FOCAL / u)) - 1.0
    swing = (RATE * SEMI_MAJOR) ** 2
    ratio = slope / q(SEMI_MINOR)
    pull = GM + swing * FOCAL * ratio * (0.5 * s * s - 1.0 / 6.0)
    outward = (-pull / long**2 + RATE**2 * u * c * c) / w
    northward = s * c * (swing * q(u) / (q(SEMI_MINOR) * long) - RATE**2 * long) / w
    # From the confocal ellipsoid's axes to the normal of the one that latitude belongs to.
    out_p, out_z = u * c / (long * w), s / w
    north_p, north_z = -out_z, out_p
    g_p = outward * out_p + northward * north_p
    g_z = outward * out_z + northward * north_z
    return float(-(g_p * np.cos(lat) + g_z * np.sin(lat)))


@pytest.fixture(scope='session')
def normal_gravity() -> Callable[[float, float], float]:
    """Normal gravity [m/s^2] of latitude [rad] and height [m], positive down."""
    return _normal_gravity


def climbing_bend(s):
    """Seat 1.1 m above a track whose pitch and yaw both change: position and attitude (N, 3, 3)."""
    yaw, pitch, roll = 3e-4 * s * s, -0.6 * np.sin(s / 40.0), 0.4 * np.sin(s / 25.0)
    R = Rotation.from_euler('ZYX', np.stack([yaw, pitch, roll], axis=1)).as_matrix()
    middle = 0.5 * (R[1:, :, 0] + R[:-1, :, 0])
    path = np.vstack([np.zeros(3), np.cumsum(middle * np.diff(s)[:, None], axis=0)])
    return path + 1.1 * R[:, :, 2], R


@pytest.fixture(scope='module')
def table():
    """Line that climbs and bends, with a usual speed."""
    s = np.arange(0.0, 200.01, 0.05)
    position, attitude = climbing_bend(s)
    made = LineMap(Centreline(s[::5], position[::5], attitude[::5], False, 200.0), 0.004, 0.1)
    speed = 14.0 + 4.0 * np.sin(made.chainage / 30.0)
    made.set_speed(speed, np.full(len(speed), 0.3), np.full(len(speed), 0.02))
    return made


def args(table):
    return table.rows, table.step_m, table.closed


def rotation(v):
    return Rotation.from_rotvec(v).as_matrix()


def rotvec(R):
    return Rotation.from_matrix(R).as_rotvec()


def plus(x, e):
    """Apply an error as ``line_state`` defines it, with scipy's rotations."""
    out = x.copy()
    out[0:2] += e[0:2]
    out[2:11] = (rotation(e[2:5]) @ x[2:11].reshape(3, 3)).ravel()
    out[11:20] = (rotation(e[5:8]) @ x[11:20].reshape(3, 3)).ravel()
    out[20:30] += e[8:18]
    return out


def minus(x, reference):
    """Error that takes ``reference`` to ``x``."""
    e = np.empty(18)
    e[0:2] = x[0:2] - reference[0:2]
    for first, k in ((2, 2), (11, 5)):
        A, B = (y[first : first + 9].reshape(3, 3) for y in (x, reference))
        e[k : k + 3] = rotvec(A @ B.T)
    e[8:18] = x[20:30] - reference[20:30]
    return e


def state(rng, table, s=73.02, v=15.0, off=0.01):
    """Vehicle on the line, its attitude ``off`` [rad] from the line's, the mount anyhow."""
    M = rotation(rng.normal(size=3))
    R = table.line.attitude(s) @ rotation(off * rng.normal(size=3))
    biases = [0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 0.1, 0.1, 0.1, 0.05] * rng.normal(size=10)
    return np.concatenate([[s, v], (R @ M).ravel(), M.ravel(), biases])


SCALES = np.repeat([0.1, 0.2, 0.01, 0.01, 0.002, 0.002, 0.05, 0.03], [1, 1, 3, 3, 3, 3, 3, 1])
"""Standard deviations of a filter that is on its way."""


def covariance(rng, scales=SCALES):
    A = rng.normal(size=(18, 18)) + 2.0 * np.eye(18)
    P = A @ A.T
    d = scales / np.sqrt(np.diag(P))
    return P * np.outer(d, d)


def numeric_jacobian(function, x, step=1e-6):
    columns = []
    for j in range(18):
        e = np.zeros(18)
        e[j] = step
        columns.append((function(plus(x, e)) - function(plus(x, -e))) / (2.0 * step))
    return np.stack(columns, axis=-1)


def textbook(x, P, nu, H, R):
    """Joint Kalman update by Joseph's form, errors then measured from the corrected attitudes."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    e = K @ nu
    left = np.eye(18) - K @ H
    new = left @ P @ left.T + K @ R @ K.T
    reset = np.eye(18)
    h = 1e-6
    for k in (2, 5):
        for j in range(3):
            d = np.zeros(3)
            d[j] = h
            up, down = (rotation(e[k : k + 3] + q) @ rotation(-e[k : k + 3]) for q in (d, -d))
            reset[k : k + 3, k + j] = (rotvec(up) - rotvec(down)) / (2.0 * h)
    return plus(x, e), reset @ new @ reset.T


def assert_same_belief(got, expected, atol=1e-3):
    """Compare states and covariances in units of the expected standard deviations."""
    (x, P), (x_expected, P_expected) = got, expected
    d = 1.0 / np.sqrt(np.diag(P_expected))
    np.testing.assert_allclose(minus(x, x_expected) * d, 0.0, atol=atol)
    scale = np.outer(d, d)
    np.testing.assert_allclose(P * scale, P_expected * scale, atol=atol)


@pytest.fixture(scope='session')
def ref():
    """What the tests of the line filter compare with, by name."""
    return SimpleNamespace(
        args=args,
        rotation=rotation,
        rotvec=rotvec,
        plus=plus,
        minus=minus,
        state=state,
        covariance=covariance,
        SCALES=SCALES,
        numeric_jacobian=numeric_jacobian,
        textbook=textbook,
        assert_same_belief=assert_same_belief,
    )

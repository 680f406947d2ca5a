"""
Strapdown inertial navigation on the rotating ellipsoid: the mechanisation, compiled, in place.

The navigation state ``nav`` (10,) is latitude, longitude [rad], height [m], velocity east, north,
up [m/s] and the quaternion x, y, z, w that turns the body to east-north-up. Rates and forces are
those of the body against inertial space, in the body, free of bias. How errors of ``nav`` grow is
in ``ins_errors``, the Earth in ``earth``; what a navigator needs of both can be had from here.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import quaternion as quat
from track_localization.estimation.earth import (
    EARTH_RATE,
    curvature_radii,
    earth_rate,
    gravity,
    transport_rate,
)
from track_localization.estimation.ins_errors import error_transition, process_noise, propagate
from track_localization.estimation.quaternion import Vector, cross

__all__ = [
    'attitude_matrix',
    'curvature_radii',
    'earth_rate',
    'error_transition',
    'gravity',
    'inject',
    'mechanise',
    'process_noise',
    'propagate',
    'transport_rate',
]

Array = NDArray[np.float64]


@numba.njit(cache=True)
def _body_increments(
    w: Vector, f: Vector, w_before: Vector, f_before: Vector, dt: float
) -> tuple[Vector, Vector]:
    """
    Return the rotation vector [rad] and the velocity increment [m/s] of a step, in the first body.

    Rate and force change linearly between the two samples. Coning and sculling are then exact to
    third order in dt; a steady rotation's effect on the velocity has one order more.
    """
    half, twelfth = 0.5 * dt, dt * dt / 12.0
    a = (half * (w_before[0] + w[0]), half * (w_before[1] + w[1]), half * (w_before[2] + w[2]))
    u = (half * (f_before[0] + f[0]), half * (f_before[1] + f[1]), half * (f_before[2] + f[2]))
    coning = cross(w_before, w)
    scull, back = cross(w_before, f), cross(f_before, w)
    turn = cross(a, u)
    twice = cross(a, turn)
    return (
        (
            a[0] + twelfth * coning[0],
            a[1] + twelfth * coning[1],
            a[2] + twelfth * coning[2],
        ),
        (
            u[0] + 0.5 * turn[0] + twice[0] / 6.0 + twelfth * (scull[0] + back[0]),
            u[1] + 0.5 * turn[1] + twice[1] / 6.0 + twelfth * (scull[1] + back[1]),
            u[2] + 0.5 * turn[2] + twice[2] / 6.0 + twelfth * (scull[2] + back[2]),
        ),
    )


@numba.njit(cache=True)
def _frame_rates(lat: float, h: float, v: Vector, M: float, N: float) -> tuple[Vector, Vector]:
    """Return Earth rate plus transport rate, and the same with the Earth's twice [rad/s]."""
    north, up = EARTH_RATE * np.cos(lat), EARTH_RATE * np.sin(lat)
    x, y = -v[1] / (M + h), v[0] / (N + h)
    z = y * np.tan(lat)
    return (x, north + y, up + z), (x, 2.0 * north + y, 2.0 * up + z)


@numba.njit(cache=True)
def mechanise(nav: Array, w: Array, f: Array, w_before: Array, f_before: Array, dt: float) -> None:
    """
    Advance ``nav`` by ``dt`` [s] from the sample before to this one.

    ``w``, ``f`` (3,): rate [rad/s] and specific force [m/s^2], free of bias, at the new time;
    ``w_before``, ``f_before`` at the old. Gravity, Coriolis and the frame's own rotation are taken
    at the middle of the step; everything is second order in ``dt`` at least.
    """
    q = (nav[6], nav[7], nav[8], nav[9])
    v = (nav[3], nav[4], nav[5])
    half = 0.5 * dt
    rotation, increment = _body_increments(
        quat.vector(w), quat.vector(f), quat.vector(w_before), quat.vector(f_before), dt
    )
    push = quat.rotate(q, increment)

    M, N = curvature_radii(nav[0])
    lat, h = nav[0] + half * v[1] / (M + nav[2]), nav[2] + half * v[2]
    g = gravity(lat, h)
    _, swing = _frame_rates(lat, h, v, M, N)
    c = cross(swing, v)
    middle = (
        v[0] + 0.5 * (push[0] - c[0] * dt),
        v[1] + 0.5 * (push[1] - c[1] * dt),
        v[2] + 0.5 * (push[2] - (g + c[2]) * dt),
    )
    turn, swing = _frame_rates(lat, h, middle, M, N)
    c, lean = cross(swing, middle), cross(turn, push)
    nav[3] = v[0] + push[0] - half * lean[0] - c[0] * dt
    nav[4] = v[1] + push[1] - half * lean[1] - c[1] * dt
    nav[5] = v[2] + push[2] - half * lean[2] - (g + c[2]) * dt

    nav[0] += half * (v[1] + nav[4]) / (M + h)
    nav[1] = _wrapped(nav[1] + half * (v[0] + nav[3]) / ((N + h) * np.cos(lat)))
    nav[2] += half * (v[2] + nav[5])
    level = quat.from_rotation_vector((-turn[0] * dt, -turn[1] * dt, -turn[2] * dt))
    quat.write_unit(
        quat.product(level, quat.product(q, quat.from_rotation_vector(rotation))), nav[6:10]
    )


@numba.njit(cache=True)
def _wrapped(angle: float) -> float:
    """Return an angle within pi of zero."""
    if angle > np.pi:
        return angle - 2.0 * np.pi
    return angle + 2.0 * np.pi if angle < -np.pi else angle


@numba.njit(cache=True)
def inject(nav: Array, dx: Array) -> None:
    """
    Add an error ``dx`` (15,) or longer to ``nav``: position [m], velocity, rotation in the body.

    Only the first nine are used; biases belong to the caller.
    """
    M, N = curvature_radii(nav[0])
    nav[1] = _wrapped(nav[1] + dx[0] / ((N + nav[2]) * np.cos(nav[0])))
    nav[0] += dx[1] / (M + nav[2])
    nav[2] += dx[2]
    for i in range(3):
        nav[3 + i] += dx[3 + i]
    turn = quat.from_rotation_vector((dx[6], dx[7], dx[8]))
    quat.write_unit(quat.product((nav[6], nav[7], nav[8], nav[9]), turn), nav[6:10])


@numba.njit(cache=True)
def attitude_matrix(nav: Array, out: Array) -> None:
    """Write R_nb (3, 3), body to east-north-up, into ``out``."""
    quat.matrix(nav[6], nav[7], nav[8], nav[9], out)

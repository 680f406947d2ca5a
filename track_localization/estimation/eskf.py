"""
Error-state Kalman filter of an inertial navigator: 18 states, any measurement.

The nominal state is one flat array of 24 numbers (see the slices), the error state has 18:
position, velocity, attitude, accelerometer bias, gyro bias, gravity (paper 1, eqs 15-27; the
kinematics are those of Sola, "Quaternion kinematics for the error-state Kalman filter", 2017).
The attitude error is a right perturbation in the body. States are values: every function returns
new arrays, so that a history of them can be kept and replayed.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import eskf_kernels as kernels

Array = NDArray[np.float64]

ERROR_STATES = 18
# Error state: where each part stands in x_err, P, F and H.
POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
ACCEL_BIAS, GYRO_BIAS, GRAVITY_STATE = slice(9, 12), slice(12, 15), slice(15, 18)
# Nominal state: position 0:3, velocity 3:6, R_nb row by row 6:15, biases 15:18, 18:21, g 21:24.
NOMINAL_STATES = 24


class State(NamedTuple):
    """
    Nominal state and the covariance of its error.

    Attributes:
        time_s: stamp [s].
        x: (24,) nominal state.
        P: (18, 18) error covariance.
    """

    time_s: float
    x: Array
    P: Array

    @property
    def position(self) -> Array:
        """Position (3,) in ``map`` [m]."""
        return self.x[0:3]

    @property
    def velocity(self) -> Array:
        """Velocity (3,) in ``map`` [m/s]."""
        return self.x[3:6]

    @property
    def R_nb(self) -> Array:
        """Attitude (3, 3)."""
        return self.x[6:15].reshape(3, 3)

    @property
    def accel_bias(self) -> Array:
        """Accelerometer bias (3,) [m/s^2]."""
        return self.x[15:18]

    @property
    def gyro_bias(self) -> Array:
        """Gyro bias (3,) [rad/s]."""
        return self.x[18:21]

    @property
    def gravity(self) -> Array:
        """Gravity (3,) in ``map`` [m/s^2]."""
        return self.x[21:24]


@dataclasses.dataclass(frozen=True)
class ImuNoise:
    """
    What an IMU adds to the motion, as densities.

    Attributes:
        accel: velocity random walk [m/s^2/sqrt(Hz)].
        gyro: angle random walk [rad/s/sqrt(Hz)].
        accel_walk: bias walk [m/s^2/sqrt(s)].
        gyro_walk: bias walk [rad/s/sqrt(s)].
        accel_scale: scale error, a fraction of the force.
        gyro_scale: scale error, a fraction of the rate.
        scale_time_s: how long a manoeuvre keeps its direction: a scale error acts as noise with
            this correlation time [s].
    """

    accel: float
    gyro: float
    accel_walk: float
    gyro_walk: float
    accel_scale: float = 0.0
    gyro_scale: float = 0.0
    scale_time_s: float = 1.0

    @functools.cached_property
    def densities(self) -> Array:
        """Per second (2, 4): variances at rest, and what a unit of force^2 or rate^2 adds."""
        scale = 2.0 * self.scale_time_s
        at_rest = (self.accel**2, self.gyro**2, self.accel_walk**2, self.gyro_walk**2)
        by_motion = (scale * self.accel_scale**2, scale * self.gyro_scale**2, 0.0, 0.0)
        return np.array([at_rest, by_motion])


def make_state(
    time_s: float,
    position: Array,
    velocity: Array,
    R_nb: Array,
    gravity: Array,
    sigmas: tuple[Array, Array, Array, float, float, float],
    accel_bias: Array | None = None,
    gyro_bias: Array | None = None,
) -> State:
    """
    Return a state with a diagonal covariance.

    ``sigmas``: standard deviations of position (3,), velocity (3,), attitude (3,) in the body, and
    of accelerometer bias, gyro bias and gravity (scalars).
    """
    zero = np.zeros(3)
    ab = zero if accel_bias is None else accel_bias
    wb = zero if gyro_bias is None else gyro_bias
    x = np.concatenate([position, velocity, R_nb.ravel(), ab, wb, gravity])
    std = np.concatenate([*sigmas[:3], *(np.full(3, s) for s in sigmas[3:])])
    return State(time_s, x, np.diag(std**2))


def process_noise(noise: ImuNoise, f: Array, w: Array, dt: float, extra_accel: float) -> Array:
    """
    Return the variances (4,) that one step adds to velocity, attitude and the two biases.

    As eq. (20), with the walks growing by dt and not dt^2; ``f``, ``w`` are the sample's force and
    rate, ``extra_accel`` [m/s^2/sqrt(Hz)] is what vibration adds.
    """
    q: Array = kernels.process_noise(noise.densities, f, w, dt, extra_accel)
    return q


def propagate(
    state: State, f: Array, w: Array, dt: float, q: Array, time_s: float | None = None
) -> State:
    """
    Predict over ``dt`` with mean measured force and rate (eqs 17-19).

    ``q`` (4,) as ``process_noise`` gives it; ``time_s`` is the new stamp where a sum of steps
    would be too coarse.
    """
    x, P, _ = kernels.predict(state.x, state.P, f, w, dt, q)
    return State(state.time_s + dt if time_s is None else time_s, x, P)


def predict(
    x: Array, P: Array, f: Array, w: Array, dt: float, q: Array
) -> tuple[Array, Array, Array]:
    """Return nominal state, covariance and transition F of one step: what a smoother needs."""
    out: tuple[Array, Array, Array] = kernels.predict(x, P, f, w, dt, q)
    return out


def pose_covariance(state: State) -> Array:
    """Return the covariance (6, 6) of position [m] and of rotation about the map's axes [rad]."""
    out: Array = kernels.pose_covariance(state.x, state.P)
    return out


def twist_covariance(state: State, rate_sigma: float) -> Array:
    """
    Return the covariance (6, 6) of the velocity [m/s] and angular rate [rad/s] in the body.

    ``rate_sigma``: standard deviation of a rate's noise [rad/s].
    """
    out: Array = kernels.twist_covariance(state.x, state.P, rate_sigma)
    return out


def nis(state: State, nu: Array, H: Array, R: Array) -> float:
    """Return the normalised innovation squared, nu' (H P H' + R)^-1 nu; arguments as ``update``."""
    return float(kernels.nis(state.P, nu, H, R))


def update(state: State, nu: Array, H: Array, R: Array) -> State:
    """
    Correct by a measurement: innovation ``nu`` (m,), Jacobian ``H`` (m, 18), noise ``R`` (m, m).

    Joseph form; the covariance is carried through the reset of the attitude error (eqs 23-27).
    """
    x, P = kernels.update(state.x, state.P, nu, H, R)
    return State(state.time_s, x, P)


def transition(state: State, f: Array, w: Array, dt: float) -> Array:
    """Return F (18, 18), the error transition that ``propagate`` uses from ``state``."""
    F: Array = kernels.transition(state.x, f, w, dt)
    return F


def box_plus(x: Array, error: Array) -> Array:
    """Return the nominal state (24,) with an error (18,) added."""
    out: Array = kernels.box_plus(x, error)
    return out


def box_minus(x: Array, reference: Array) -> Array:
    """Return the error (18,) that takes ``reference`` (24,) to ``x``: the inverse of box_plus."""
    out: Array = kernels.box_minus(x, reference)
    return out

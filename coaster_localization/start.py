"""The filter's first state: levelled at rest in the station, or taken from a match in mid-ride."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coaster_localization.config import EskfConfig
from coaster_localization.observation import MatchObservation
from track_localization import GRAVITY
from track_localization.estimation import eskf, so3
from track_localization.estimation.imu import ImuSample
from track_localization.estimation.imu_monitor import ImuStep
from track_localization.estimation.strapdown import (
    REST_FORCE_STD,
    REST_RATE_STD,
    gravity_vector,
    level,
)
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

GRAVITY_SIGMA = 0.01
"""How far local gravity is from standard gravity [m/s^2]; most of it is a matter of latitude."""


class Rest(NamedTuple):
    """
    What a standstill shows.

    Attributes:
        force: (3,) mean specific force [m/s^2].
        rate: (3,) mean angular rate [rad/s]: the gyro's bias.
        force_std: largest standard deviation of the force's axes [m/s^2].
        rate_std: the same of the rate [rad/s].
        samples: how many.
    """

    force: Array
    rate: Array
    force_std: float
    rate_std: float
    samples: int


USUAL_REST = (0.015, 0.0015)
"""Standard deviations of force and rate at rest where no rest was seen yet."""


def is_quiet(step: ImuStep, rest: Rest | None) -> bool:
    """
    Whether the sensor shakes as little as in ``rest``, the station's if known, under 1 g.

    A train that rolls at a walking pace shakes little more than one that stands.
    """
    force_std, rate_std = (rest.force_std, rest.rate_std) if rest is not None else USUAL_REST
    return (
        step.f_std < 1.5 * force_std + 0.005
        and step.w_std < 1.5 * rate_std + 0.0005
        and abs(float(np.linalg.norm(step.f_mean)) - GRAVITY) < 0.2
    )


REST_DRIFT = 0.05
"""From its first to its second half the mean force of a rest changes by less [m/s^2]."""


class StartPose(NamedTuple):
    """Position (3,) [m] with covariance (3, 3) and attitude (3, 3), whose heading counts."""

    position: Array
    covariance: Array
    R_nb: Array


def observe_rest(samples: Sequence[ImuSample]) -> Rest | None:
    """Return what a stretch of samples shows if the sensor stood still in it, else None."""
    forces = np.array([s.specific_force for s in samples])
    rates = np.array([s.angular_rate for s in samples])
    force, rate = forces.mean(axis=0), rates.mean(axis=0)
    force_std, rate_std = float(forces.std(axis=0).max()), float(rates.std(axis=0).max())
    if force_std > REST_FORCE_STD or rate_std > REST_RATE_STD:
        return None
    first, last = forces[: (len(forces) + 1) // 2], forces[len(forces) // 2 :]
    if np.abs(last.mean(axis=0) - first.mean(axis=0)).max() > REST_DRIFT:
        return None
    if abs(np.linalg.norm(force) - GRAVITY) > 0.5 or np.linalg.norm(rate) > 0.05:
        return None
    return Rest(force, rate, force_std, rate_std, len(samples))


def state_at_rest(time_s: float, rest: Rest, start: StartPose, config: EskfConfig) -> eskf.State:
    """
    Return the state of a train standing at ``start``, levelled by gravity.

    Heading comes from the start pose: the sensor's own heading in the vehicle is its uncertainty.
    """
    yaw = float(np.arctan2(start.R_nb[1, 0], start.R_nb[0, 0]))
    R = level(rest.force, yaw)
    tilt, heading = np.deg2rad(config.tilt_sigma_deg), np.deg2rad(config.yaw_sigma_deg)
    bias_sigma = float(np.hypot(3.0 * rest.rate_std / np.sqrt(rest.samples), 1e-4))
    nav = eskf.make_state(
        time_s,
        start.position,
        np.zeros(3),
        R,
        gravity_vector(),
        (
            np.ones(3),
            np.full(3, 0.02),
            np.ones(3),
            config.accel_bias_sigma,
            bias_sigma,
            GRAVITY_SIGMA,
        ),
        gyro_bias=rest.rate,
    )
    P = nav.P.copy()
    P[eskf.POSITION, eskf.POSITION] = start.covariance
    # Tilt is about the horizontal axes and heading about the vertical; the error is in the body.
    P[eskf.ATTITUDE, eskf.ATTITUDE] = R.T @ np.diag([tilt**2, tilt**2, heading**2]) @ R
    return nav._replace(P=P)


def state_from_match(
    match: MatchObservation, design: DesignRide, config: EskfConfig
) -> eskf.State | None:
    """
    Return a state in mid-ride: the design ride's speed and attitude where the match is.

    None where the design ride stands: there a match says nothing of the motion.
    """
    i = int(np.argmin(np.linalg.norm(design.position - match.position, axis=1)))
    speed = float(np.linalg.norm(design.velocity[i]))
    if speed < 1.0:
        return None
    angle = np.full(3, np.deg2rad(config.yaw_sigma_deg))
    nav = eskf.make_state(
        match.time_s,
        match.position,
        design.velocity[i],
        so3.matrix_from_quat(design.quaternion[i]),
        gravity_vector(),
        (
            np.ones(3),
            np.full(3, 0.1 * speed + 0.5),
            angle,
            config.accel_bias_sigma,
            config.gyro_bias_sigma,
            GRAVITY_SIGMA,
        ),
    )
    P = nav.P.copy()
    P[eskf.POSITION, eskf.POSITION] = match.covariance + np.eye(3) * config.start_sigma_m**2
    return nav._replace(P=P)

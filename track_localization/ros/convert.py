"""
Between ROS messages and the types of the core; every message is checked before it goes in.

A function that reads a message returns the core's type, or a ``str``: the reason why the message
cannot be used. Reasons, alike in every node:

- ``bad_stamp``: nanoseconds of a second or more, or a time before 1970;
- ``empty_frame``, ``wrong_frame``: ``header.frame_id`` is empty, or not the one expected. There is
  no guessing: without tf nothing can be transformed, and data of an unknown frame is not data;
- ``not_finite``, ``implausible``: NaN or infinite; finite, but no vehicle's (1e300);
- ``no_specific_force``: ``linear_acceleration_covariance[0] == -1``, the sender's "not measured";
- ``bad_quaternion``: its length is more than 1 % off 1;
- ``covariance_not_finite``, ``covariance_asymmetric``, ``covariance_not_positive``: of the position
  block; zero means "unknown" to some senders and "exact" to others, and neither can be fused;
- ``no_attitude_covariance``: a start that must tell how it is turned does not say how well.
- ``attitude_unknown``: it says that its attitude is not known to 1 rad: nothing to start from.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    TwistWithCovarianceStamped,
)
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from sensor_msgs.msg import Imu

from track_localization.estimation.imu import ImuSample

Array = NDArray[np.float64]

NANO = 10**9
MAX_SECONDS = 2**31 - 2
MAX_FORCE, MAX_RATE = 1e4, 1e3
"""Beyond any accelerometer [m/s^2] and gyro [rad/s]: garbage, not motion."""
MAX_POSITION, MAX_VARIANCE = 1e7, 1e14
"""Beyond any track [m] and any doubt about it [m^2]."""
LEAST_VARIANCE = 1e-8
"""Nothing is known better along a track: 0.1 mm [m^2]."""
MAX_TURN_VARIANCE = 1.0
"""An attitude known worse than to 1 rad is none to start from: no filter is linear so far."""
MAX_SPEED = 1e4
"""Beyond any vehicle on a track [m/s]."""
BALISE_FRAME = 'balise_'
"""What the frame of a balise begins with; its id follows."""


class PoseEstimate(Protocol):
    """What an estimate must tell to become an Odometry; covariances (6, 6)."""

    time_s: float
    position: Array
    quaternion: Array
    velocity_body: Array
    angular_rate: Array
    pose_covariance: Array
    twist_covariance: Array


def seconds(stamp: Time) -> float:
    """Return a stamp [s], rounded exactly as the bag reader rounds it."""
    return (stamp.sec * NANO + stamp.nanosec) / NANO


def set_stamp(stamp: Time, time_s: float) -> None:
    """Write ``time_s`` [s] into ``stamp``, to the nanosecond; ``seconds`` gives it back."""
    whole = math.floor(time_s)
    nanosec = round((time_s - whole) * NANO)
    if nanosec >= NANO:
        whole, nanosec = whole + 1, nanosec - NANO
    stamp.sec, stamp.nanosec = whole, nanosec


def header_problem(header: Any, frame: str) -> str | None:
    """Return the reason why a header cannot be used, or None; ``frame`` '' allows every one."""
    stamp = header.stamp
    if not (0 <= stamp.sec <= MAX_SECONDS and stamp.nanosec < NANO):
        return 'bad_stamp'
    if header.frame_id != frame:
        if not header.frame_id:
            return 'empty_frame'
        if frame:
            return 'wrong_frame'
    return None


def imu_sample(msg: Imu, frame: str, R_bm: Array | None = None) -> ImuSample | str:
    """
    Return the sample of an Imu message, or the reason why there is none.

    ``frame`` is the frame_id expected. ``R_bm`` (3, 3) turns the sensor's axes into the body's;
    None leaves them. The rate is NaN where the message says that it was not measured.
    """
    problem = header_problem(msg.header, frame)
    if problem is not None:
        return problem
    a, g = msg.linear_acceleration, msg.angular_velocity
    if msg.linear_acceleration_covariance[0] == -1.0:
        return 'no_specific_force'
    f, w = np.array((a.x, a.y, a.z)), np.array((g.x, g.y, g.z))
    if msg.angular_velocity_covariance[0] == -1.0:
        w = np.full(3, np.nan)
    elif not max(abs(g.x), abs(g.y), abs(g.z)) < MAX_RATE or math.isnan(g.x + g.y + g.z):
        return why_not((g.x, g.y, g.z))
    if not max(abs(a.x), abs(a.y), abs(a.z)) < MAX_FORCE or math.isnan(a.x + a.y + a.z):
        return why_not((a.x, a.y, a.z))
    if R_bm is not None:
        f, w = R_bm @ f, R_bm @ w
    return ImuSample(seconds(msg.header.stamp), f, w)


def pose(msg: PoseWithCovarianceStamped, frame: str) -> tuple[float, Array, Array, Array] | str:
    """
    Return stamp [s], position (3,), unit quaternion (4,) and position covariance (3, 3).

    Or the reason why the message cannot be used.
    """
    problem = header_problem(msg.header, frame)
    if problem is not None:
        return problem
    p, q = msg.pose.pose.position, msg.pose.pose.orientation
    position, quaternion = np.array((p.x, p.y, p.z)), np.array((q.x, q.y, q.z, q.w))
    if not np.abs(position).max() < MAX_POSITION:
        return why_not(position)
    if not np.isfinite(quaternion).all():
        return 'not_finite'
    norm = math.hypot(*quaternion)
    if not abs(norm - 1.0) < 0.01:
        return 'bad_quaternion'
    covariance = np.array(msg.pose.covariance, dtype=np.float64).reshape(6, 6)[:3, :3]
    return covariance_problem(covariance) or (
        seconds(msg.header.stamp),
        position,
        quaternion / norm,
        covariance,
    )


def full_pose(
    msg: PoseWithCovarianceStamped, frame: str
) -> tuple[float, Array, Array, Array] | str:
    """
    Return what ``pose`` does, the covariance (6, 6) with rotation about the axes of ``frame``.

    Or the reason why the message cannot be used.
    """
    read = pose(msg, frame)
    if isinstance(read, str):
        return read
    covariance = np.array(msg.pose.covariance, dtype=np.float64).reshape(6, 6)
    if not covariance[3:, 3:].any():
        return 'no_attitude_covariance'
    reason = covariance_problem(covariance)
    if reason is None and np.linalg.eigvalsh(covariance[3:, 3:])[-1] > MAX_TURN_VARIANCE:
        reason = 'attitude_unknown'
    return reason or (*read[:3], covariance)


def chainage(msg: PoseWithCovarianceStamped, frame: str = 'track') -> tuple[float, float] | str:
    """
    Return distance along the track [m] and its variance [m^2], or the reason why not.

    Less than LEAST_VARIANCE is not believed: turned into axes of ``map`` it would be lost in
    rounding.
    """
    problem = header_problem(msg.header, frame)
    if problem is not None:
        return problem
    s, variance = msg.pose.pose.position.x, float(msg.pose.covariance[0])
    if not abs(s) < MAX_POSITION:
        return why_not((s,))
    return variance_problem(variance) or (s, max(variance, LEAST_VARIANCE))


def balise(msg: PoseWithCovarianceStamped) -> tuple[str, float, float] | str:
    """
    Return the id of a balise, how far the antenna is ahead of it [m] and the variance [m^2].

    Or the reason why the message cannot be used; its frame is ``balise_<id>``.
    """
    frame = msg.header.frame_id
    name = frame.removeprefix(BALISE_FRAME) if frame.startswith(BALISE_FRAME) else ''
    read = chainage(msg, frame if name else f'{BALISE_FRAME}<id>')
    return read if isinstance(read, str) else (name, *read)


def speed(
    msg: TwistWithCovarianceStamped, frame: str, untold: bool = False
) -> tuple[float, float] | str:
    """
    Return the forward speed [m/s] and its variance [m^2/s^2], or the reason why not.

    With ``untold`` a variance of nought is one that the sender does not know, and no fault.
    """
    problem = header_problem(msg.header, frame)
    if problem is not None:
        return problem
    v, variance = msg.twist.twist.linear.x, float(msg.twist.covariance[0])
    if not abs(v) < MAX_SPEED:
        return why_not((v,))
    told = variance != 0.0 or not untold
    return (variance_problem(variance) if told else None) or (v, variance)


def variance_problem(variance: float) -> str | None:
    """Return the reason why a variance is none to fuse with, or None; see the reasons above."""
    if not math.isfinite(variance):
        return 'covariance_not_finite'
    if variance > MAX_VARIANCE:
        return 'implausible'
    return None if variance > 0.0 else 'covariance_not_positive'


def covariance_problem(P: Array) -> str | None:
    """Return the reason why ``P`` (n, n) is no covariance to fuse with, or None."""
    if not np.isfinite(P).all():
        return 'covariance_not_finite'
    scale = float(np.abs(P).max())
    if scale > MAX_VARIANCE:
        return 'implausible'
    if np.abs(P - P.T).max() > 1e-6 * scale:
        return 'covariance_asymmetric'
    if scale == 0.0 or np.linalg.eigvalsh(P / scale)[0] <= 1e-12:
        return 'covariance_not_positive'
    return None


def fill_odometry(msg: Odometry, estimate: PoseEstimate) -> None:
    """Write an estimate into ``msg``, pose in its frame, twist in the child's; frames stay."""
    set_stamp(msg.header.stamp, estimate.time_s)
    fill_pose(msg.pose.pose, estimate.position, estimate.quaternion)
    msg.pose.covariance = estimate.pose_covariance.ravel()
    twist = msg.twist.twist
    _fill_xyz(twist.linear, estimate.velocity_body)
    _fill_xyz(twist.angular, estimate.angular_rate)
    msg.twist.covariance = estimate.twist_covariance.ravel()


def fill_pose(target: Any, position: Array, quaternion: Array) -> None:
    """Write a position (3,) and a quaternion (4,) x, y, z, w into a geometry_msgs/Pose."""
    _fill_xyz(target.position, position)
    q = target.orientation
    q.x, q.y, q.z, q.w = quaternion.tolist()


def fill_position_covariance(msg: PoseWithCovarianceStamped, covariance: Array) -> None:
    """Write a position covariance (3, 3) [m^2] into the message; the rest is zero: unknown."""
    full = np.zeros((6, 6))
    full[:3, :3] = covariance
    msg.pose.covariance = full.ravel()


def fill_chainage(msg: PoseWithCovarianceStamped, time_s: float, s: float, sigma: float) -> None:
    """Write a distance along the track [m] and its standard deviation [m] into ``msg``."""
    set_stamp(msg.header.stamp, time_s)
    msg.pose.pose.position.x = float(s)
    msg.pose.covariance[0] = sigma * sigma


def path_pose(time_s: float, position: Array, quaternion: Array, frame: str) -> PoseStamped:
    """Return one pose of a Path."""
    msg = PoseStamped()
    msg.header.frame_id = frame
    set_stamp(msg.header.stamp, time_s)
    fill_pose(msg.pose, position, quaternion)
    return msg


def _fill_xyz(target: Any, values: Array) -> None:
    target.x, target.y, target.z = values.tolist()


def why_not(values: Any) -> str:
    """Return the reason why numbers out of range cannot be used."""
    return 'implausible' if all(map(math.isfinite, values)) else 'not_finite'

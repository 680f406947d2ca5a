"""
Between ROS 2 messages of a bag and arrays: stamps, Imu, Odometry, Pose and Twist.

The messages are those of rosbags' Jazzy type store; nothing here needs a ROS installation.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory

Array = NDArray[np.float64]

TYPESTORE = get_typestore(Stores.ROS2_JAZZY)
IMU = 'sensor_msgs/msg/Imu'
ODOMETRY = 'nav_msgs/msg/Odometry'
POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
TWIST = 'geometry_msgs/msg/TwistWithCovarianceStamped'

NANO = 10**9
ZERO = np.zeros(3)
LATEST_NS = 2**31 * NANO  # a Time message counts its seconds in 32 signed bits


def make(msgtype: str, **fields: Any) -> Any:
    """Return a message of a Jazzy type, e.g. ``make('std_msgs/msg/String', data='x')``."""
    return TYPESTORE.types[msgtype](**fields)


def stamp_ns(time_s: float) -> int:
    """Return a stamp [ns]; raise DataError for one that a Time message cannot hold."""
    if not 0.0 <= time_s < LATEST_NS / NANO:
        raise DataError(
            f'stamp {time_s} s cannot be written: stamps run from 0 to 2**31 s; shift the times'
        )
    return round(time_s * NANO)


def header_ns(message: Any) -> int:
    """Return a message's header stamp [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * NANO + int(stamp.nanosec)


def header(time_ns: int, frame_id: str) -> Any:
    """Return a std_msgs/Header with this stamp [ns]."""
    sec, nanosec = divmod(time_ns, NANO)
    stamp = make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame_id)


def imu_row(message: Any) -> tuple[float, ...]:
    """
    Return specific force [m/s^2] and angular rate [rad/s], six numbers.

    NaN for a quantity whose covariance starts with -1: sensor_msgs/Imu's way to say "not measured".
    """
    force, rate = message.linear_acceleration, message.angular_velocity
    f = (force.x, force.y, force.z)
    w = (rate.x, rate.y, rate.z)
    if message.linear_acceleration_covariance[0] == -1.0:
        f = (np.nan,) * 3
    if message.angular_velocity_covariance[0] == -1.0:
        w = (np.nan,) * 3
    return (*f, *w)


def imu_message(series: ImuSeries, i: int, frame_id: str) -> Any:
    """Return sample ``i`` as sensor_msgs/Imu, without orientation."""
    unknown = np.zeros(9)
    absent = np.array([-1.0, *[0.0] * 8])
    force, rate = series.specific_force[i], series.angular_rate[i]
    return make(
        IMU,
        header=header(stamp_ns(float(series.time_s[i])), frame_id),
        orientation=_quaternion(None),
        orientation_covariance=absent,
        angular_velocity=_vector(np.nan_to_num(rate)),
        angular_velocity_covariance=unknown if np.isfinite(rate).all() else absent,
        linear_acceleration=_vector(np.nan_to_num(force)),
        linear_acceleration_covariance=unknown if np.isfinite(force).all() else absent,
    )


def imu_cdrs(series: ImuSeries, frame_id: str) -> Iterator[tuple[int, bytes]]:
    """Yield (stamp [ns], sensor_msgs/Imu as CDR) of every sample, as ``imu_message`` builds it."""
    n = len(series)
    force, rate = series.specific_force, series.angular_rate
    numbers = np.zeros((n, 37))  # quaternion, its covariance; rate, covariance; force, covariance
    numbers[:, 3], numbers[:, 4] = 1.0, -1.0
    numbers[:, 13:16], numbers[:, 25:28] = np.nan_to_num(rate), np.nan_to_num(force)
    numbers[:, 16] = np.where(np.isfinite(rate).all(axis=1), 0.0, -1.0)
    numbers[:, 28] = np.where(np.isfinite(force).all(axis=1), 0.0, -1.0)
    if n:
        template = imu_message(series, 0, frame_id)
        yield from _filled(IMU, template, series.time_s, numbers)


def odometry_cdrs(trajectory: Trajectory, frame_id: str, child: str) -> Iterator[tuple[int, bytes]]:
    """
    Yield (stamp [ns], nav_msgs/Odometry as CDR) of every epoch; the twist is in the body's axes.

    Without a quaternion the body's axes are those of ``map``. Unknown covariances are zero.
    """
    n = len(trajectory)
    if not n:
        return
    numbers = np.zeros((n, 85))  # pose 7, its covariance 36, twist 6, its covariance 36
    numbers[:, :43] = _pose_numbers(
        trajectory.position, trajectory.quaternion, trajectory.covariance
    )
    velocity = trajectory.velocity
    if velocity is not None and trajectory.quaternion is not None:
        velocity = Rotation.from_quat(trajectory.quaternion).apply(velocity, inverse=True)
    if velocity is not None:
        numbers[:, 43:46] = velocity
    if trajectory.sigma_speed is not None:
        numbers[:, 49] = trajectory.sigma_speed**2
    template = make(
        ODOMETRY,
        header=header(0, frame_id),
        child_frame_id=child,
        pose=_blank_pose(),
        twist=_blank_twist(),
    )
    yield from _filled(ODOMETRY, template, trajectory.time_s, numbers)


def pose_cdrs(
    time_s: Array,
    position: Array,
    covariance: Array | None,
    quaternion: Array | None,
    frame_id: str,
) -> Iterator[tuple[int, bytes]]:
    """Yield (stamp [ns], PoseWithCovarianceStamped as CDR); ``covariance`` (N, 3, 3) or None."""
    template = make(POSE, header=header(0, frame_id), pose=_blank_pose())
    numbers = _pose_numbers(position, quaternion, covariance)
    yield from _filled(POSE, template, time_s, numbers)


def twist_cdrs(
    time_s: Array, speed: Array, variance: Array, frame_id: str
) -> Iterator[tuple[int, bytes]]:
    """Yield (stamp [ns], TwistWithCovarianceStamped as CDR) of forward speeds (N,) [m/s]."""
    template = make(TWIST, header=header(0, frame_id), twist=_blank_twist())
    numbers = np.zeros((len(time_s), 42))  # linear and angular velocity, covariance
    numbers[:, 0], numbers[:, 6] = speed, variance
    yield from _filled(TWIST, template, time_s, numbers)


def odometry_row(message: Any) -> tuple[float, ...]:
    """
    Return position (3), quaternion (4), body-frame velocity (3), position covariance (9), var(vx).

    Twenty numbers in the message's own frames, to be taken apart by ``trajectory_from_rows``.
    """
    pose, twist = message.pose.pose, message.twist.twist
    p, q, v = pose.position, pose.orientation, twist.linear
    block = message.pose.covariance.reshape(6, 6)[:3, :3]
    return (
        *(p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z),
        *block.ravel(),
        float(message.twist.covariance[0]),
    )


def trajectory_from_rows(time_s: Array, rows: Array) -> tuple[Trajectory, dict[str, int]]:
    """
    Return the trajectory of (N, 20) ``odometry_row`` rows, and what was rejected, by reason.

    Orientation and velocity in ``map`` are None where every quaternion is zero ("not known");
    covariances that are all zero mean "not known" too. Otherwise rows with a zero quaternion are
    dropped (``zero_quaternion``), as are those with a NaN (``not_finite``) and those not later
    than the row before (``repeated_time``, ``backward_time``).
    """
    finite = np.isfinite(time_s) & np.isfinite(rows[:, :10]).all(axis=1)
    norm = np.linalg.norm(rows[:, 3:7], axis=1)
    oriented = norm > 0.5
    use = finite & oriented if oriented.any() else finite
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], np.where(use, time_s, -np.inf)]))[:-1]
    repeated, backward = use & (time_s == latest), use & (time_s < latest)
    counts = {
        'not_finite': int((~finite).sum()),
        'zero_quaternion': int((finite & ~use).sum()),
        'repeated_time': int(repeated.sum()),
        'backward_time': int(backward.sum()),
    }
    keep = use & ~repeated & ~backward
    time_s, rows, norm = time_s[keep], rows[keep], norm[keep]
    quaternion = velocity = None
    if oriented.any() and len(rows):
        quaternion = rows[:, 3:7] / norm[:, None]
        velocity = Rotation.from_quat(quaternion).apply(rows[:, 7:10])
    covariance = rows[:, 10:19].reshape(-1, 3, 3)
    trajectory = Trajectory(
        time_s,
        position=rows[:, :3],
        quaternion=quaternion,
        velocity=velocity,
        speed=np.linalg.norm(rows[:, 7:10], axis=1),
        covariance=covariance if (covariance != 0.0).any() else None,
        sigma_speed=np.sqrt(np.maximum(rows[:, 19], 0.0)) if (rows[:, 19] > 0.0).any() else None,
    )
    return trajectory, {k: n for k, n in counts.items() if n}


def _vector(values: Array) -> Any:
    x, y, z = (float(v) for v in values)
    return make('geometry_msgs/msg/Vector3', x=x, y=y, z=z)


def _quaternion(xyzw: Array | None) -> Any:
    x, y, z, w = (0.0, 0.0, 0.0, 1.0) if xyzw is None else (float(v) for v in xyzw)
    return make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)


def _blank_pose() -> Any:
    pose = make(
        'geometry_msgs/msg/Pose',
        position=make('geometry_msgs/msg/Point', x=0.0, y=0.0, z=0.0),
        orientation=_quaternion(None),
    )
    return make('geometry_msgs/msg/PoseWithCovariance', pose=pose, covariance=np.zeros(36))


def _blank_twist() -> Any:
    twist = make('geometry_msgs/msg/Twist', linear=_vector(ZERO), angular=_vector(ZERO))
    return make('geometry_msgs/msg/TwistWithCovariance', twist=twist, covariance=np.zeros(36))


def _pose_numbers(position: Array, quaternion: Array | None, covariance: Array | None) -> Array:
    """Return a PoseWithCovariance's numbers (N, 43) in the order of the message."""
    numbers = np.zeros((len(position), 43))
    numbers[:, :3] = position
    numbers[:, 3:7] = [0.0, 0.0, 0.0, 1.0] if quaternion is None else quaternion
    if covariance is not None:
        full = np.zeros((len(position), 6, 6))
        full[:, :3, :3] = covariance
        numbers[:, 7:] = full.reshape(-1, 36)
    return numbers


def _filled(
    msgtype: str, template: Any, time_s: Array, numbers: Array
) -> Iterator[tuple[int, bytes]]:
    """
    Yield copies of a message with other stamps and numbers, many times as fast as one by one.

    In CDR the stamp follows the four bytes of encapsulation, and in these messages the numbers
    (N, K) stand at the end, after all text.
    """
    cdr = bytearray(TYPESTORE.serialize_cdr(template, msgtype))
    rows = np.ascontiguousarray(numbers, dtype='<f8')
    for time, row in zip(time_s.tolist(), rows, strict=True):
        ns = stamp_ns(time)
        struct.pack_into('<iI', cdr, 4, *divmod(ns, NANO))
        cdr[-row.nbytes :] = row.tobytes()
        yield ns, bytes(cdr)

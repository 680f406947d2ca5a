"""Finding the attitude before the filter can start: level from gravity, yaw from the course."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.estimation import so3
from track_localization.estimation.earth import EARTH_RATE
from track_localization.estimation.imu import ImuSample
from track_localization.geodesy import Datum, enu_from_geodetic
from train_localization.config import AlignmentConfig
from train_localization.kernels import moved
from train_localization.measurements import GnssFix, WheelSpeed

Array = NDArray[np.float64]

LEVEL_OVER_S = 1.0
"""Gravity is averaged over so long under way [s]."""
STILL_RATE, STILL_FORCE = 0.01, 0.1
"""A train whose IMU varies less stands, 1 sigma over the rest [rad/s], [m/s^2]."""
STANDS_FOR_S, STANDS_WITHIN_M = 5.0, 1.5
"""Fixes of so long tell of a rest where no odometer does, if no further apart [s], [m]."""
HEARD_S = 1.5
"""What was heard longer ago tells nothing of now [s]."""
LEAST_MPS = 0.1
"""Between fixes that tell a course, a train is no slower than this [m/s]."""
YAW_LEAST_DEG = 0.3
FIX_WHITE_M = 0.5
LONGEST_S = 10.0
"""A course is told by fixes no further apart [s]."""
FEW = 3
"""Fixes that make a course."""
AGREE_M, AGREE_MPS, AGREE_SHARE = 2.0, 2.0, 0.05
"""Fixes that tell a course agree so well with a straight way at constant speed."""
GREATEST_MPS2 = 3.0
"""Wheels that gain more begin or cease to slip; what they seem to gain may half be that."""
SPEED_SIGMA_MPS, CLIMB_SIGMA_MPS = 0.5, 1.0


class Start(NamedTuple):
    """
    Where a filter starts.

    Attributes:
        time_s: stamp [s].
        geodetic: (3,) latitude, longitude [rad], height [m].
        velocity: (3,) east, north, up [m/s].
        quaternion: (4,) body to east, north, up.
        covariance: (9, 9) of position, velocity, attitude in the body.
        gyro_bias: (3,) seen while the train stood, without the Earth's rate [rad/s].
        rested: whether it did.
    """

    time_s: float
    geodetic: Array
    velocity: Array
    quaternion: Array
    covariance: Array
    gyro_bias: Array
    rested: bool


def start_at(
    time_s: float,
    geodetic: Array,
    R_nb: Array,
    covariance: Array,
    speed: float,
    speed_sigma: float,
) -> Start:
    """
    Return the start of a train at a known place and attitude.

    Args:
        time_s: stamp [s].
        geodetic: (3,) latitude, longitude [rad], height [m].
        R_nb: (3, 3) body to east, north, up.
        covariance: (6, 6) of position and of the rotation about east, north, up.
        speed: along the body's x axis [m/s].
        speed_sigma: of it [m/s].
    """
    P, v = np.zeros((9, 9)), np.array([speed, 0.0, 0.0])
    turned = R_nb.T @ covariance[3:, 3:] @ R_nb
    P[:3, :3], P[6:, 6:] = covariance[:3, :3], turned
    to_v = -R_nb @ so3.hat(v)
    P[3:6, 3:6] = to_v @ turned @ to_v.T + np.eye(3) * speed_sigma**2
    P[3:6, 6:], P[6:, 3:6] = to_v @ turned, turned @ to_v.T
    quaternion = so3.quat_from_matrix(R_nb)
    return Start(time_s, geodetic, R_nb @ v, quaternion, P, np.zeros(3), False)


class Alignment:
    """Listens until the attitude is known; then ``start`` is set."""

    def __init__(self, config: AlignmentConfig, lever: Array | None = None) -> None:
        """Make it; ``lever`` (3,) is the antenna as seen from the IMU, ahead, left, up [m]."""
        self._config = config
        self._lever = np.zeros(3) if lever is None else lever
        self._samples: deque[ImuSample] = deque()
        self._resting: list[ImuSample] = []
        self._rest_rate, self._rest_force, self._rests = np.zeros(3), np.zeros(3), 0
        self._rest_yaw, self._rested = 0.0, False
        self._fixes: deque[GnssFix] = deque()
        self._yaw, self._place = 0.0, np.zeros(2)
        self._path: deque[tuple[float, float, float, float]] = deque()
        self._speed: WheelSpeed | None = None
        self._gain = 0.0
        self.start: Start | None = None

    def imu(self, sample: ImuSample) -> None:
        """Take an IMU sample."""
        before = self._samples[-1] if self._samples else sample
        elapsed = max(sample.time_s - before.time_s, 0.0)
        self._yaw += float(sample.angular_rate[2] - self._rest_rate[2]) * elapsed
        speed = 1.0 if self._speed is None else max(abs(self._speed.speed), LEAST_MPS)
        self._place = self._place + speed * elapsed * np.array(
            [math.cos(self._yaw), math.sin(self._yaw)]
        )
        self._samples.append(sample)
        self._path.append((sample.time_s, self._yaw, *self._place))
        while self._samples[0].time_s < sample.time_s - LEVEL_OVER_S:
            self._samples.popleft()
        while self._path[0][0] < sample.time_s - LONGEST_S:
            self._path.popleft()
        self._rest(sample)

    def wheel(self, speed: WheelSpeed) -> None:
        """Take an odometer's speed."""
        if self._speed is not None and speed.time_s > self._speed.time_s:
            gain = (speed.speed - self._speed.speed) / (speed.time_s - self._speed.time_s)
            share = 1.0 if self._gain == 0.0 else min(speed.time_s - self._speed.time_s, 1.0)
            self._gain += share * (gain - self._gain)
        self._speed = speed

    def gnss(self, fix: GnssFix) -> None:
        """Take a fix; set ``start`` when it tells the course."""
        self._fixes.append(fix)
        while self._fixes[0].time_s < fix.time_s - LONGEST_S:
            self._fixes.popleft()
        while len(self._fixes) > FEW and self._far(self._fixes[-FEW], fix):
            self._fixes.popleft()
        if len(self._samples) < 3 or self._samples[-1].time_s < fix.time_s - 1.0:
            return
        first = self._fixes[0]
        datum = Datum(first.latitude, first.longitude, first.height)
        places = np.array([[f.latitude, f.longitude, f.height] for f in self._fixes])
        way = enu_from_geodetic(places[:, 0], places[:, 1], places[:, 2], datum)
        distance = float(np.hypot(*way[-1, :2]))
        if distance < self._config.course_m or len(way) < 3 or not self._smooth(way):
            return
        self.start = self._make(fix, way, distance)

    def _far(self, one: GnssFix, other: GnssFix) -> bool:
        """Whether two fixes are far enough from each other to tell a course."""
        datum = Datum(one.latitude, one.longitude, one.height)
        way = enu_from_geodetic(other.latitude, other.longitude, other.height, datum)[0]
        return bool(np.hypot(*way[:2]) > self._config.course_m)

    def _smooth(self, way: Array) -> bool:
        """Whether all fixes agree with a straight way at constant speed, and the odometer's."""
        times = np.array([f.time_s for f in self._fixes])
        elapsed = times[-1] - times[0]
        claimed = math.sqrt(float(np.trace(self._fixes[-1].covariance[:2, :2])))
        distance = float(np.hypot(*way[-1, :2]))
        straight = np.outer((times - times[0]) / elapsed, way[-1])
        apart = np.hypot(*(way - straight)[:, :2].T).max()
        if apart > AGREE_M + claimed + AGREE_SHARE * distance:
            return False
        if self._speed is None or abs(times[-1] - self._speed.time_s) > HEARD_S:
            return True
        if abs(self._gain) > GREATEST_MPS2:
            return False
        slack = AGREE_MPS + claimed / elapsed + abs(self._gain) * elapsed / 2
        return abs(distance / elapsed - self._speed.speed) < slack

    def _rest(self, sample: ImuSample) -> None:
        """Learn the gyros' biases while the train stands."""
        self._resting.append(sample)
        if sample.time_s - self._resting[0].time_s < self._config.rest_s:
            return
        rates = np.array([s.angular_rate for s in self._resting])
        forces = np.array([s.specific_force for s in self._resting])
        if (
            self._stands(sample.time_s)
            and rates.std(axis=0).max() < STILL_RATE
            and forces.std(axis=0).max() < STILL_FORCE
        ):
            self._have_rested(rates.mean(axis=0), forces.mean(axis=0))
        else:
            self._rests = 0
        self._resting = [sample]

    def _stands(self, now: float) -> bool:
        """Whether the odometer says so, or the fixes of late where there is none."""
        if self._speed is not None and now - self._speed.time_s < HEARD_S:
            return abs(self._speed.speed) < 0.05
        late = [fix for fix in self._fixes if fix.time_s > now - LONGEST_S]
        if len(late) < FEW or now - late[-1].time_s > HEARD_S:
            return False
        if late[-1].time_s - late[0].time_s < STANDS_FOR_S:
            return False
        claimed = math.sqrt(float(np.trace(late[-1].covariance[:2, :2])))
        datum = Datum(late[0].latitude, late[0].longitude, late[0].height)
        places = np.array([[f.latitude, f.longitude, f.height] for f in late])
        way = enu_from_geodetic(places[:, 0], places[:, 1], places[:, 2], datum)
        return bool(np.hypot(*way[:, :2].T).max() < max(claimed, STANDS_WITHIN_M))

    def _have_rested(self, rate: Array, force: Array) -> None:
        """Take means over a rest; those of rests that follow one another are one longer rest."""
        if np.abs(rate).max() >= STILL_RATE:
            return
        self._rests += 1
        if self._rests == 1:
            self._rest_rate, self._rest_force = np.zeros(3), np.zeros(3)
        self._rest_rate = self._rest_rate + (rate - self._rest_rate) / self._rests
        self._rest_force = self._rest_force + (force - self._rest_force) / self._rests
        self._rest_yaw, self._rested = self._yaw, True

    def _gyro_bias(self, latitude: float, course: float) -> Array:
        """Return what the gyros showed at rest but for the Earth, ``course`` being that of now."""
        if not self._rested:
            return np.zeros(3)
        roll, pitch = _level(self._rest_force)
        R = so3.matrix_from_rpy(roll, pitch, course - self._yaw + self._rest_yaw)
        earth = EARTH_RATE * np.array([0.0, math.cos(latitude), math.sin(latitude)])
        bias: Array = self._rest_rate - R.T @ earth
        return bias

    def _course(self, way: Array) -> float:
        """Return the course at the last fix: of the way told by odometer and gyro, turned."""
        path = np.array(self._path)
        times = np.array([self._fixes[0].time_s, self._fixes[-1].time_s])
        yaw, x, y = (np.interp(times, path[:, 0], path[:, k]) for k in (1, 2, 3))
        run = math.atan2(y[1] - y[0], x[1] - x[0])
        return float(yaw[1]) - run + math.atan2(way[-1, 1], way[-1, 0])

    def _make(self, fix: GnssFix, way: Array, distance: float) -> Start:
        times = np.array([f.time_s for f in self._fixes])
        course = self._course(way)
        elapsed = times[-1] - times[0]
        speed = distance / elapsed
        if self._speed is not None and fix.time_s - self._speed.time_s < HEARD_S:
            speed = self._speed.speed
        forces = np.mean([s.specific_force for s in self._samples], axis=0)
        rates = np.mean([s.angular_rate for s in self._samples], axis=0) - self._rest_rate
        level = forces - np.array([self._gain, speed * rates[2], -speed * rates[1]])
        roll, pitch = _level(level)
        R = so3.matrix_from_rpy(roll, pitch, course)
        climb = float(way[-1, 2]) / elapsed if abs(way[-1, 2]) < 0.1 * distance else 0.0
        velocity = np.array([speed * math.cos(course), speed * math.sin(course), climb])
        yaw_sigma = math.sqrt(2.0) * FIX_WHITE_M / distance + math.radians(YAW_LEAST_DEG)
        tilt = math.radians(self._config.moving_sigma_deg)
        pitching = math.hypot(tilt, 0.5 * self._gain / GRAVITY)
        across = speed * yaw_sigma
        sigma = np.array(
            [
                *np.sqrt(np.diag(fix.covariance)),
                *(math.hypot(SPEED_SIGMA_MPS, across),) * 2,
                CLIMB_SIGMA_MPS,
                *(tilt, pitching, yaw_sigma),
            ]
        )
        antenna = np.array([fix.latitude, fix.longitude, fix.height])
        return Start(
            fix.time_s,
            moved(antenna, -R @ self._lever),
            velocity,
            so3.quat_from_matrix(R),
            np.diag(sigma**2),
            self._gyro_bias(fix.latitude, course),
            self._rested,
        )


def _level(force: Array) -> tuple[float, float]:
    """Return roll and pitch [rad] at which gravity alone would be felt like ``force`` (3,)."""
    return (
        math.atan2(force[1], force[2]),
        math.atan2(-force[0], math.hypot(force[1], force[2])),
    )

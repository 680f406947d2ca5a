"""Finding the attitude before the filter can start: level from gravity, yaw from the course."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from track_localization.geodesy import Datum, enu_from_geodetic
from train_localization.config import AlignmentConfig
from train_localization.measurements import GnssFix, WheelSpeed

Array = NDArray[np.float64]

LEVEL_OVER_S = 1.0
"""Gravity is averaged over so long under way [s]."""
STILL_RATE, STILL_FORCE = 0.01, 0.1
"""A train whose IMU varies less stands, 1 sigma over the rest [rad/s], [m/s^2]."""
YAW_LEAST_DEG = 0.3
FIX_WHITE_M = 0.5
LONGEST_S = 10.0
"""A course is told by fixes no further apart [s]."""
FEW = 3
"""Fixes that make a course."""
AGREE_M, AGREE_MPS, AGREE_SHARE = 2.0, 2.0, 0.05
"""Fixes that tell a course agree so well with a straight way at constant speed."""
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
        gyro_bias: (3,) seen while the train stood [rad/s].
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

    def __init__(self, config: AlignmentConfig) -> None:
        self._config = config
        self._samples: deque[ImuSample] = deque()
        self._resting: list[ImuSample] = []
        self._gyro_bias, self._rested = np.zeros(3), False
        self._fixes: deque[tuple[GnssFix, float]] = deque()
        self._yaw = 0.0
        self._yaws: deque[tuple[float, float]] = deque()
        self._speed: WheelSpeed | None = None
        self._gain = 0.0
        self.start: Start | None = None

    def imu(self, sample: ImuSample) -> None:
        """Take an IMU sample."""
        before = self._samples[-1] if self._samples else sample
        self._yaw += float(sample.angular_rate[2]) * max(sample.time_s - before.time_s, 0.0)
        self._samples.append(sample)
        self._yaws.append((sample.time_s, self._yaw))
        while self._samples[0].time_s < sample.time_s - LEVEL_OVER_S:
            self._samples.popleft()
        while self._yaws[0][0] < sample.time_s - LONGEST_S:
            self._yaws.popleft()
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
        self._fixes.append((fix, self._yaw))
        while self._fixes[0][0].time_s < fix.time_s - LONGEST_S:
            self._fixes.popleft()
        while len(self._fixes) > FEW and self._far(self._fixes[-FEW][0], fix):
            self._fixes.popleft()
        if len(self._samples) < 3 or self._samples[-1].time_s < fix.time_s - 1.0:
            return
        first = self._fixes[0][0]
        datum = Datum(first.latitude, first.longitude, first.height)
        places = np.array([[f.latitude, f.longitude, f.height] for f, _ in self._fixes])
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
        times = np.array([f.time_s for f, _ in self._fixes])
        elapsed = times[-1] - times[0]
        claimed = math.sqrt(float(np.trace(self._fixes[-1][0].covariance[:2, :2])))
        distance = float(np.hypot(*way[-1, :2]))
        straight = np.outer((times - times[0]) / elapsed, way[-1])
        apart = np.hypot(*(way - straight)[:, :2].T).max()
        if apart > AGREE_M + claimed + AGREE_SHARE * distance:
            return False
        if self._speed is None or abs(times[-1] - self._speed.time_s) > 1.5:
            return True
        slack = AGREE_MPS + claimed / elapsed + abs(self._gain) * elapsed
        return abs(distance / elapsed - self._speed.speed) < slack

    def _rest(self, sample: ImuSample) -> None:
        """Learn the gyros' biases while the train stands."""
        self._resting.append(sample)
        if sample.time_s - self._resting[0].time_s < self._config.rest_s:
            return
        rates = np.array([s.angular_rate for s in self._resting])
        forces = np.array([s.specific_force for s in self._resting])
        standing = self._speed is None or abs(self._speed.speed) < 0.05
        if (
            standing
            and rates.std(axis=0).max() < STILL_RATE
            and forces.std(axis=0).max() < STILL_FORCE
        ):
            mean = rates.mean(axis=0)
            if np.abs(mean).max() < STILL_RATE:
                self._gyro_bias, self._rested = mean, True
        self._resting = [sample]

    def _make(self, fix: GnssFix, way: Array, distance: float) -> Start:
        times = np.array([f.time_s for f, _ in self._fixes])
        yaws = np.interp(
            np.linspace(times[0], times[-1], 50),
            [t for t, _ in self._yaws],
            [yaw for _, yaw in self._yaws],
        )
        course = math.atan2(way[-1, 1], way[-1, 0]) + float(yaws[-1] - yaws.mean())
        elapsed = times[-1] - times[0]
        speed = distance / elapsed
        if self._speed is not None and fix.time_s - self._speed.time_s < 1.5:
            speed = self._speed.speed
        forces = np.mean([s.specific_force for s in self._samples], axis=0)
        rates = np.mean([s.angular_rate for s in self._samples], axis=0) - self._gyro_bias
        level = forces - np.array([self._gain, speed * rates[2], -speed * rates[1]])
        roll = math.atan2(level[1], level[2])
        pitch = math.atan2(-level[0], math.hypot(level[1], level[2]))
        R = so3.matrix_from_rpy(roll, pitch, course)
        climb = float(way[-1, 2]) / elapsed if abs(way[-1, 2]) < 0.1 * distance else 0.0
        velocity = np.array([speed * math.cos(course), speed * math.sin(course), climb])
        yaw_sigma = math.sqrt(2.0) * FIX_WHITE_M / distance + math.radians(YAW_LEAST_DEG)
        tilt = math.radians(self._config.moving_sigma_deg)
        across = speed * yaw_sigma
        sigma = np.array(
            [
                *np.sqrt(np.diag(fix.covariance)),
                *(math.hypot(SPEED_SIGMA_MPS, across),) * 2,
                CLIMB_SIGMA_MPS,
                *(tilt, tilt, yaw_sigma),
            ]
        )
        geodetic = np.array([fix.latitude, fix.longitude, fix.height])
        return Start(
            fix.time_s,
            geodetic,
            velocity,
            so3.quat_from_matrix(R),
            np.diag(sigma**2),
            self._gyro_bias.copy(),
            self._rested,
        )

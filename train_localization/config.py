"""Every setting of the train's estimators: the only home of their defaults."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from track_localization.settings import setting

METHODS = ('robust', 'robust_map', 'paper', 'ins')


BY_GRADE = 0.0

GRADES = {
    'navigation': (0.003, 0.01, 0.012, 0.06, 4e-4, 0.0016),
    'tactical': (0.05, 0.03, 0.6, 0.35, 0.025, 0.004),
    'industrial': (0.2, 0.06, 5.5, 1.1, 0.163, 0.008),
    'mems': (0.5, 0.15, 51.0, 3.1, 0.82, 0.025),
}
"""Grades of IMUs: the settings of ``ImuConfig`` in their order."""


@dataclasses.dataclass(frozen=True)
class ImuConfig:
    """What the IMU is worth; what is 0 is as usual for its grade."""

    grade: str = setting('industrial', '', 'what it costs', choices=tuple(GRADES))
    gyro_noise: float = setting(BY_GRADE, 'deg/sqrt(h)', 'angle random walk', 0.0, 100.0)
    accel_noise: float = setting(BY_GRADE, 'm/s/sqrt(h)', 'velocity random walk', 0.0, 100.0)
    gyro_bias_sigma: float = setting(BY_GRADE, 'deg/h', 'gyro biases at start', 0.0, 1e5)
    accel_bias_sigma: float = setting(BY_GRADE, 'mg', 'accelerometer biases at start', 0.0, 1e3)
    gyro_bias_walk: float = setting(BY_GRADE, 'deg/h/sqrt(s)', 'their walk', 0.0, 1e4)
    accel_bias_walk: float = setting(BY_GRADE, 'mg/sqrt(s)', 'their walk', 0.0, 1e3)

    def of_grade(self) -> ImuConfig:
        """Return the settings with those of the grade where none is given."""
        names = [field.name for field in dataclasses.fields(self)][1:]
        usual: dict[str, Any] = dict(zip(names, GRADES[self.grade], strict=True))
        given = {name: getattr(self, name) for name in names}
        return dataclasses.replace(
            self, **usual | {name: value for name, value in given.items() if value != BY_GRADE}
        )


@dataclasses.dataclass(frozen=True)
class AlignmentConfig:
    """How the attitude is found at the start."""

    rest_s: float = setting(2.0, 's', 'of standing that level the platform', 0.2, 600.0)
    level_sigma_deg: float = setting(0.3, 'deg', 'of roll and pitch then', 1e-3, 20.0)
    moving_sigma_deg: float = setting(1.0, 'deg', 'of roll and pitch found under way', 1e-3, 20.0)
    course_m: float = setting(20.0, 'm', 'of way between fixes that tell the course', 1.0, 1000.0)


@dataclasses.dataclass(frozen=True)
class GnssConfig:
    """Satellite fixes: a slow error of their own and a white one."""

    slow_sigma_m: float = setting(0.8, 'm', 'slow horizontal error', 0.0, 100.0)
    slow_sigma_up_m: float = setting(1.5, 'm', 'slow vertical error', 0.0, 100.0)
    slow_s: float = setting(400.0, 's', 'its correlation time', 1.0, 1e5)
    white_share: float = setting(0.4, '', 'of the claimed sigma that is white', 0.05, 10.0)
    least_sigma_m: float = setting(0.3, 'm', 'least white sigma that is believed', 1e-3, 100.0)
    hdop_limit: float = setting(5.0, '', 'fixes above it are not used', 0.5, 1e3)
    huber: float = setting(6.6, '', 'NIS above which a fix weighs less', 1.0, 1e3)
    gate: float = setting(25.0, '', 'NIS above which it is refused', 1.0, 1e6)
    recover_after: int = setting(8, '', 'refused in a row: the filter is wrong', 1, 10000)
    untold_sigma_m: float = setting(1.5, 'm', 'of a fix without covariance, at HDOP 1', 0.01, 1e4)
    ahead_m: float = setting(0.0, 'm', 'antenna ahead of the IMU', -100.0, 100.0)
    left_m: float = setting(0.0, 'm', 'antenna to the left of the IMU', -100.0, 100.0)
    up_m: float = setting(0.0, 'm', 'antenna above the IMU', -100.0, 100.0)

    @property
    def lever(self) -> NDArray[np.float64]:
        """The antenna as seen from the IMU, (3,) ahead, left, up [m]."""
        return np.array([self.ahead_m, self.left_m, self.up_m])


@dataclasses.dataclass(frozen=True)
class WheelConfig:
    """The odometer, and what rails forbid."""

    sigma_mps: float = setting(0.1, 'm/s', 'of a speed', 1e-3, 10.0)
    side_sigma_mps: float = setting(0.04, 'm/s', 'of motion across the rails', 1e-3, 10.0)
    scale_sigma: float = setting(0.005, '', 'of its scale, minus 1', 0.0, 0.5)
    mounting_sigma_deg: float = setting(0.5, 'deg', 'of the IMU in the car, yaw and pitch', 0.0, 45)
    delay_s: float = setting(0.05, 's', 'how old a speed is at its stamp', -5.0, 5.0)
    lever_m: float = setting(0.0, 'm', 'IMU ahead of where the car heads its way', -30.0, 30.0)
    gate: float = setting(16.0, '', 'NIS above which a speed is slip', 1.0, 1e6)
    recover_after: int = setting(300, '', 'refused in a row: the filter is wrong', 1, 10000)
    nonholonomic: bool = setting(True, '', 'the train does not move across its rails')
    constraint_rate_hz: float = setting(10.0, 'Hz', 'how often rails forbid', 0.1, 200.0)


@dataclasses.dataclass(frozen=True)
class StraightConfig:
    """What is known of a railway's shape: it is straight, or it turns by a curve's radius."""

    used: bool = setting(True, '', 'on a straight the course does not change')
    mark_m: float = setting(25.0, 'm', 'chords whose directions are compared', 5.0, 1000.0)
    greatest_radius_m: float = setting(40e3, 'm', 'what turns by less is straight', 1e3, 1e7)
    course_sigma_deg: float = setting(0.006, 'deg', 'of a chord of a straight', 1e-4, 5.0)

    @property
    def course_sigma_rad(self) -> float:
        """Sigma of the course [rad]."""
        return math.radians(self.course_sigma_deg)


@dataclasses.dataclass(frozen=True)
class MapConfig:
    """The surveyed line, and its own error."""

    offset_sigma_m: float = setting(2.0, 'm', 'of a constant offset of the map, aside', 0.0, 100.0)
    offset_sigma_up_m: float = setting(2.0, 'm', 'of one of its heights', 0.0, 100.0)
    right_sigma_m: float = setting(0.05, 'm', 'of it aside, where the map is right', 1e-3, 10.0)
    right_share: float = setting(0.95, '', 'of maps that are right, before fixes tell', 0.0, 1.0)
    local_sigma_m: float = setting(0.3, 'm', 'of its wander, across', 0.01, 100.0)
    height_sigma_m: float = setting(0.15, 'm', 'of its wander, upward', 0.01, 100.0)
    wander_m: float = setting(200.0, 'm', 'length over which it wanders', 0.0, 1e5)
    course_sigma_deg: float = setting(0.2, 'deg', 'of its direction', 1e-3, 45.0)
    rate_hz: float = setting(1.0, 'Hz', 'how often it is used', 0.01, 100.0)


@dataclasses.dataclass(frozen=True)
class PaperConfig:
    """
    The paper's SINS/DR filter.

    The paper says neither how the odometer's scale and the car's heading come to be known before
    an outage, nor what becomes of bad fixes: ``compares``, ``way_sigma_m``, ``gyro_times``,
    ``height`` and ``gate`` are this package's answer. With ``compares`` off, ``height`` on,
    ``gyro_times`` 1 and a great gate nothing is added.
    """

    fading: bool = setting(True, '', 'its adaptive fading factor, eq. (6)')
    fading_limit: float = setting(1.05, '', 'greatest factor at once', 1.0, 1e6)
    dr_sigma_m: float = setting(1.0, 'm', 'of p_SINS - p_DR', 1e-4, 100.0)
    gnss_sigma_m: float = setting(1.5, 'm', 'least sigma of a fix', 1e-3, 100.0)
    scale_sigma: float = setting(0.002, '', "of the odometer's scale", 0.0, 0.5)
    compares: bool = setting(True, '', 'p_SINS with p_DR from fix to fix, too, not in outages only')
    way_sigma_m: float = setting(0.2, 'm', 'of p_SINS - p_DR from fix to fix', 1e-4, 100.0)
    gyro_times: float = setting(3.0, '', 'of its noise and walk: so much a gyro counts', 0.1, 100.0)
    height: bool = setting(False, '', 'p_SINS with p_DR in height, too, not in the plane only')
    gate: float = setting(16.0, '', 'NIS above which a fix, or a way from it, is refused', 1.0, 1e9)
    recover_after: int = setting(8, '', 'fixes refused in a row: the filter is wrong', 1, 10000)


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """All of it."""

    method: str = setting('robust', '', 'how the sensors are fused', choices=METHODS)
    epoch_s: float = setting(0.1, 's', 'of IMU samples that one filter step takes', 0.002, 2.0)
    horizon_s: float = setting(2.0, 's', 'how late a message may come', 0.0, 60.0)
    imu: ImuConfig = ImuConfig()
    alignment: AlignmentConfig = AlignmentConfig()
    gnss: GnssConfig = GnssConfig()
    wheel: WheelConfig = WheelConfig()
    straight: StraightConfig = StraightConfig()
    map: MapConfig = MapConfig()
    paper: PaperConfig = PaperConfig()

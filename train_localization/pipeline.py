"""The train's estimator as a plain object: measurements in as they arrive, estimates out."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation import so3
from track_localization.estimation.gating import Rejections
from track_localization.estimation.history import History, TooLateError
from track_localization.estimation.imu import ImuSample
from track_localization.estimation.stamps import Stamps
from track_localization.geodesy import Datum
from track_localization.track.centreline import Centreline
from train_localization import gaps, kernels
from train_localization.alignment import Alignment, Start, start_at
from train_localization.config import TrainConfig
from train_localization.estimate import Estimate
from train_localization.gathering import Gathering
from train_localization.measurements import (
    GNSS,
    IMU,
    WHEEL,
    GnssFix,
    GnssQuality,
    Measurement,
    WheelSpeed,
    sensor_of,
)
from train_localization.paper_filter import PaperFilter
from train_localization.placing import Placing
from train_localization.plausible import problem
from train_localization.robust_filter import LOST_AFTER_S, RobustFilter
from train_localization.state import Fix, Fused, Stretch

Array = NDArray[np.float64]

ALIGNING = 'aligning'
START_WITHIN_S, START_SHARE, START_SIGMA_MPS = 2.0, 0.05, 0.5
"""A given pose waits so long for an odometer speed [s]; of the way until then and of that speed so
much is unsure, and at least so much of the speed [m/s]."""
RESTART_S = 2.0
"""When all stamps have been too late for so long, time began anew [s]."""
SILENT_S = 1.5
"""A sensor not heard for so long is missing [s]."""


class TrainPipeline:
    """
    The method that ``config`` names, driven by stamps only.

    Nothing that is pushed can raise: what cannot be used is counted with the reason.

    Attributes:
        mode: what the position rests on.
    """

    def __init__(
        self,
        config: TrainConfig,
        track: Centreline | None = None,
        datum: Datum | None = None,
    ) -> None:
        """
        Make it.

        Args:
            config: every setting.
            track: the surveyed line in ``map``, which only ``robust_map`` uses in its filter; with
                any method it gives the chainage. It needs a datum.
            datum: origin of ``map``; without one it is the first fix.
        """
        self._config, self._track = config, track
        self._placing = None if datum is None else Placing(datum)
        self.reset()

    def reset(self) -> None:
        """Forget everything but where ``map`` is; the next measurements align anew."""
        self._rejections = Rejections()
        self._stamps = Stamps(self._config.horizon_s, ordered=(IMU,), restart_s=RESTART_S)
        self._align()
        self._nis: dict[str, float] = {}
        self._heard_s: dict[str, float] = {}
        self._given: tuple[float, Array, Array, Array] | None = None
        self._chainage = math.nan
        self._late = 0
        self.mode = ALIGNING
        self._latest: Estimate | None = None

    def _align(self) -> None:
        """Begin to look for the attitude."""
        self._alignment = Alignment(self._config.alignment, self._config.gnss.lever)
        ahead_s = max(-self._config.wheel.delay_s, 0.0)
        self._gathering = Gathering(self._config.gnss, self._config.epoch_s, ahead_s)
        self._history: History[Any, Any] | None = None
        self._filter: Any = None
        self._told: Fused | None = None

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """Refused measurements: sensor -> reason -> count."""
        return self._rejections.as_dict()

    @property
    def datum(self) -> Datum | None:
        """Origin of ``map``; None before the first fix."""
        return None if self._placing is None else self._placing.datum

    def set_start(
        self, time_s: float, position: Array, quaternion: Array, covariance: Array
    ) -> str | None:
        """
        Start from a known pose in ``map``; the odometer tells the speed.

        Args:
            time_s: when the train was there [s].
            position: (3,) [m].
            quaternion: (4,) body to ``map``.
            covariance: (6, 6) of position and of the rotation about the axes of ``map``.

        Returns:
            Why that is impossible, or None.
        """
        if self._placing is None:
            return 'no_datum'
        if not all(np.isfinite(x).all() for x in (position, quaternion, covariance)):
            return 'not_finite'
        self._align()
        self._given = (time_s, self._placing.geodetic(position), quaternion, covariance)
        return None

    def push(self, measurement: Measurement) -> list[Estimate]:
        """Take a measurement; return the estimates that it makes possible."""
        sensor = sensor_of(measurement)
        reason = problem(measurement) or self._stamps.refuse(sensor, measurement.time_s)
        if reason is not None:
            self._rejections.add(sensor, reason)
            return []
        before_s = self._heard_s.get(sensor, measurement.time_s)
        self._heard_s[sensor] = measurement.time_s
        gone = sensor == IMU and measurement.time_s - before_s > gaps.AGAIN_S
        if gone:
            self._rejections.add(IMU, 'long_gap')
        if gone or self._stamps.gap_s > 0.0 or self._stamps.restarted:
            self._align()
            self.mode = ALIGNING
        if isinstance(measurement, GnssFix) and self._placing is None:
            self._placing = Placing(
                Datum(measurement.latitude, measurement.longitude, measurement.height)
            )
        self._gather(measurement)
        estimates: list[Estimate] = []
        for heard in self._gathering.due():
            estimates += self._take(heard)
        return estimates

    def _gather(self, measurement: Measurement) -> None:
        if isinstance(measurement, ImuSample):
            self._gathering.imu(measurement)
        elif isinstance(measurement, GnssQuality):
            self._gathering.quality(measurement)
            if self._gathering.axes(measurement) == 0:
                self._rejections.add(
                    GNSS, 'few_satellites' if measurement.satellites < 3 else 'hdop'
                )
        else:
            self._gathering.wait(measurement)

    def _take(self, heard: Stretch | Fix | WheelSpeed) -> list[Estimate]:
        if self._history is None:
            return self._begin(heard)
        newest = self._history.newest_s
        sensor = IMU if isinstance(heard, Stretch) else GNSS if isinstance(heard, Fix) else WHEEL
        try:
            replayed = self._history.add(heard.time_s, heard, 0 if sensor == IMU else 1)
        except TooLateError:
            self._rejections.add(sensor, 'too_late')
            return []
        state = self._history.state
        if replayed:
            self._late += 1
        else:
            self._note(sensor, state)
        if sensor != IMU or heard.time_s < newest:
            return []
        told = self._filter.told(state)
        estimate = self.estimate(told)
        if not sane(estimate):
            self._rejections.add('filter', 'diverged')
            self._align()
            self.mode = ALIGNING
            return []
        self._latest, self.mode, self._told = estimate, estimate.mode, told
        return [estimate]

    def _begin(self, heard: Stretch | Fix | WheelSpeed) -> list[Estimate]:
        """Look for a start; make the filter when there is one."""
        if isinstance(heard, Stretch):
            for stamp, rate, force in zip(heard.stamps, heard.rates, heard.forces, strict=True):
                self._alignment.imu(ImuSample(float(stamp), force, rate))
        elif isinstance(heard, Fix):
            if heard.axes == 3:
                self._alignment.gnss(heard.gnss)
        else:
            self._alignment.wheel(heard)
        start = self._alignment.start
        if self._given is not None:
            start = self._given_start(heard)
        if start is None or self._placing is None:
            return []
        self._filter = self._make_filter()
        state = self._filter.start(start)
        self._history = History(self._filter.apply, state, start.time_s, self._config.horizon_s)
        return []

    def _given_start(self, heard: Stretch | Fix | WheelSpeed) -> Start | None:
        """Return the start that was given, as soon as the odometer tells the speed."""
        assert self._given is not None
        assert self._placing is not None
        time_s, geodetic, quaternion, covariance = self._given
        elapsed = heard.time_s - time_s
        if not isinstance(heard, WheelSpeed):
            if elapsed > START_WITHIN_S:
                self._given = None  # by now it has turned: own alignment tells better
            return None
        if abs(elapsed) > START_WITHIN_S:
            return None
        self._given = None
        nav = np.concatenate([geodetic, np.zeros(3), quaternion])
        R_nb = self._placing.rotation(nav).T @ so3.matrix_from_quat(quaternion)
        way = R_nb[:, 0] * heard.speed * elapsed
        covariance = covariance + np.diag([*(np.abs(way) * START_SHARE) ** 2, 0.0, 0.0, 0.0])
        moved = kernels.moved(geodetic, way)
        sigma = math.hypot(START_SIGMA_MPS, START_SHARE * heard.speed)
        return start_at(heard.time_s, moved, R_nb, covariance, heard.speed, sigma)

    def _make_filter(self) -> Any:
        method, placing = self._config.method, self._placing
        if method == 'paper':
            return PaperFilter(self._config)
        track = self._track if method == 'robust_map' else None
        return RobustFilter(self._config, track, placing, aided=method != 'ins')

    def _note(self, sensor: str, state: Any) -> None:
        """Count what became of the newest measurement."""
        if state.reason:
            self._rejections.add('map' if state.reason == 'off_the_map' else sensor, state.reason)
        if math.isfinite(state.nis):
            name = 'map' if sensor == IMU else sensor
            before = self._nis.get(name, state.nis)
            self._nis[name] = before + 0.05 * (state.nis - before)

    def estimate(self, state: Fused) -> Estimate:
        """Return the estimate that a state of the filter is, in ``map``."""
        assert self._placing is not None
        position, quaternion, velocity, covariance = self._placing.place(state.nav, state.P)
        chainage = sigma = None
        if self._track is not None:
            near = None if math.isnan(self._chainage) else self._chainage
            s = float(self._track.nearest(position, near, None if near is None else 100.0))
            tangent = self._track.tangent(s)
            self._chainage, chainage = s, s
            sigma = float(np.sqrt(tangent @ covariance[:3, :3] @ tangent))
        return Estimate(
            time_s=state.time_s,
            geodetic=state.nav[:3].copy(),
            position=position,
            quaternion=quaternion,
            velocity=velocity,
            angular_rate=state.w_mean,
            covariance=covariance,
            mode=self._mode(state),
            chainage=chainage,
            sigma_along=sigma,
        )

    def _mode(self, state: Fused) -> str:
        now = state.time_s
        if state.axes and now - state.fixed_s < LOST_AFTER_S:
            return 'BDS/SINS' if state.axes == 3 else 'height-aided'
        uses_wheel = self._config.method != 'ins'
        return 'SINS/DR' if uses_wheel and now - state.wheel_s < SILENT_S else 'SINS'

    def entries(self) -> Iterator[tuple[float, Any, Fused]]:
        """Yield (stamp, measurement, state after it) of the filter's history, in time order."""
        if self._history is not None:
            yield from self._history.entries()

    @property
    def filter(self) -> Any:
        """The filter that runs; None before the start."""
        return self._filter

    def diagnostics(self) -> dict[str, float | str]:
        """Return what a user wants to see of the filter's state."""
        out: dict[str, float | str] = {
            'method': self._config.method,
            'mode': self.mode,
            'status': '' if self._history is not None else 'aligning: waits for fixes under way',
        }
        if self._latest is not None:
            sigma = np.sqrt(np.diag(self._latest.covariance))
            out |= {
                'speed_mps': round(self._latest.speed, 3),
                'sigma_east_m': round(float(sigma[0]), 3),
                'sigma_north_m': round(float(sigma[1]), 3),
                'sigma_up_m': round(float(sigma[2]), 3),
            }
            newest = self._latest.time_s
            for sensor, heard_s in self._heard_s.items():
                out[f'health.{sensor}'] = 'ok' if newest - heard_s < SILENT_S else 'silent'
        if self._told is not None:
            if math.isfinite(self._told.marks.way_m):
                out['on_straight'] = 'yes' if self._told.marks.anchored else 'no'
            if math.isfinite(self._told.map_right):
                out['map_right'] = round(self._told.map_right, 3)
        out |= {f'nis.{sensor}': round(nis, 3) for sensor, nis in self._nis.items()}
        out['late'] = self._late
        return out


def sane(estimate: Estimate) -> bool:
    """Whether an estimate is one: finite, of positive variances."""
    variances = np.diag(estimate.covariance)
    return bool(np.isfinite(estimate.position).all() and (variances > 0.0).all())


def with_method(config: TrainConfig, method: str) -> TrainConfig:
    """Return the settings with another method."""
    return dataclasses.replace(config, method=method)

"""
The track filter: where a coaster train is on its line, live, from one IMU.

The vehicle is on a known line, so its position is one number. See
``track_localization.estimation.line_filter`` for the method; here is what a coaster adds: the
start in the station, standstill, a usual speed, gaps and clocks.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coaster_localization.sensed import shortest_turn
from coaster_localization.start import Rest, observe_rest
from coaster_localization.track_config import TrackFilterConfig
from track_localization.estimation import line_filter as kernel
from track_localization.estimation.gating import Rejections
from track_localization.estimation.imu import ImuSample
from track_localization.estimation.imu_monitor import ClockGuard, ImuMonitor, ImuStep
from track_localization.track.line_map import LineMap

Array = NDArray[np.float64]

GAP_S = 0.1
"""A step longer than this was not measured: what the train did in it is unknown."""
GAP_ACCEL, GAP_RATE = 15.0, 1.5
"""How a train may accelerate [m/s^2] and turn [rad/s] unseen."""
LEVEL_INTERVAL_S = 0.5
STILL_ACCEL = 0.1
"""A train that stands is not pulled along its line by more than this [m/s^2]."""
REFERENCE_HZ = 100.0
"""Rate at which noise per sample is stated."""


class Epoch(NamedTuple):
    """
    One comparison with the line, as a smoother needs it.

    Attributes:
        time_s: stamp [s].
        x_before, P_before: the prediction.
        F: transition from the epoch before.
        x, P: after all updates.
    """

    time_s: float
    x_before: Array
    P_before: Array
    F: Array
    x: Array
    P: Array


class TrackState(NamedTuple):
    """
    Where the vehicle is at one stamp.

    Attributes:
        time_s: [s].
        x: (30,) nominal state, see ``line_filter``.
        P: (18, 18) of the latest epoch.
        lost: probability that the vehicle is somewhere else altogether.
    """

    time_s: float
    x: Array
    P: Array
    lost: float = 0.0


class CoasterTrackFilter:
    """
    Follow one ride on a line.

    ``push`` takes IMU samples in the order they come and returns a state for each, once the start
    is known. ``on_epoch`` is called with every comparison with the line: what smoothing needs.
    """

    def __init__(
        self,
        line: LineMap,
        start_m: float,
        config: TrackFilterConfig,
        on_epoch: Callable[[Epoch], None] | None = None,
    ) -> None:
        """Prepare to start at chainage ``start_m`` of ``line``."""
        self.line, self.config = line, config
        self._start_m, self._start_sigma = start_m, config.start_sigma_m
        self._on_epoch = on_epoch
        c = config
        self._settings = np.array(
            [c.attitude_correlation_m, c.soft_gate, c.spread_m, c.reach_m], dtype=float
        )
        self._speed = np.array([c.speed_noise, c.speed_noise_m])
        self._table = (line.rows, line.step_m, line.closed)
        self.reset()

    def reset(self) -> None:
        """Forget the ride and wait for a start again."""
        self._rejections = Rejections()
        self._clock = ClockGuard()
        self._restart()

    def _restart(self) -> None:
        self._monitor = ImuMonitor()
        self._waiting: deque[ImuSample] = deque()
        self._rest: Rest | None = None
        self._running = False
        self.accepted = {'imu': 0}
        self.nis = np.zeros(3)

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """Refused measurements: sensor -> reason -> count."""
        return self._rejections.as_dict()

    def push(self, sample: ImuSample) -> list[TrackState]:
        """Take one sample; return the states that it makes possible."""
        if not math.isfinite(sample.specific_force.sum() + sample.angular_rate.sum()):
            self._rejections.add('imu', 'not_finite')
            return []
        verdict = self._clock.check(sample.time_s)
        if verdict == 'restart':
            self._restart()
        if verdict is not None:
            self._rejections.add('imu', verdict)
        if verdict not in (None, 'restart'):
            return []
        self.accepted['imu'] += 1
        return [self._follow(sample)] if self._running else self._wait(sample)

    def _wait(self, sample: ImuSample) -> list[TrackState]:
        """Keep samples until they show a standstill long enough to level by."""
        waiting = self._waiting
        waiting.append(sample)
        if sample.time_s - waiting[0].time_s < self.config.rest_s:
            return []
        rest = observe_rest(waiting)
        if rest is None:
            while sample.time_s - waiting[0].time_s >= self.config.rest_s:
                waiting.popleft()
            return []
        self._rest = rest
        self._begin_at_rest(waiting[0].time_s, rest)
        out = []
        while waiting:
            out.append(self._follow(waiting.popleft()))
        return out

    def _begin_at_rest(self, time_s: float, rest: Rest) -> None:
        """Take the attitude from the line at the start and the mount's tilt from gravity."""
        R = kernel.attitude_at(*self._table, self._start_m)
        M = shortest_turn(rest.force, R[2])
        x = np.zeros(kernel.NOMINAL)
        x[0] = self._start_m
        x[2:11], x[11:20] = (R @ M).ravel(), M.ravel()
        x[20:23] = rest.rate
        bias_sigma = math.hypot(3.0 * rest.rate_std / math.sqrt(rest.samples), 1e-4)
        self._begin(time_s, x, self._start_covariance(R, bias_sigma))
        kernel.level(self.x, self.P, rest.force, 0.02)
        self._time_leveled = time_s

    def _start_covariance(self, R: Array, gyro_bias_sigma: float) -> Array:
        """Return P (18, 18) of a train that stands where the line has the attitude ``R``."""
        c = self.config
        P = np.zeros((kernel.ERRORS, kernel.ERRORS))
        P[0, 0], P[1, 1] = self._start_sigma**2, 0.05**2
        mount, tilt = slice(kernel.MOUNT, kernel.MOUNT + 3), slice(kernel.TILT, kernel.TILT + 3)
        # The body has the line's attitude: what the mount is off, the sensor is off as well.
        free = np.deg2rad(c.mount_sigma_deg) ** 2
        P[mount, mount] = free * np.eye(3)
        P[tilt, tilt] = (free + c.attitude_sigma**2) * np.eye(3)
        P[tilt, mount], P[mount, tilt] = free * R, free * R.T
        P[8:11, 8:11] = gyro_bias_sigma**2 * np.eye(3)
        P[11:14, 11:14] = c.gyro_scale_sigma**2 * np.eye(3)
        P[14:17, 14:17] = c.accel_bias_sigma**2 * np.eye(3)
        P[17, 17] = c.speed_sigma**2
        return P

    def _begin(self, time_s: float, x: Array, P: Array) -> None:
        self.x, self.P, self._sums = x, P, np.zeros(kernel.SUMS)
        self._running = self._first = True
        self._driven = np.zeros(1)
        self._epoch_s = time_s
        self._time_leveled = time_s

    def _follow(self, sample: ImuSample) -> TrackState:
        step = self._monitor.push(sample)
        if step.dt > 0.0:
            kernel.advance(self.x, self._sums, step.f, step.w, step.dt, *self._table)
        if step.time_s - self._epoch_s >= self.config.epoch_s - 1e-6 or step.dt > GAP_S:
            self._close_epoch(step)
        return TrackState(step.time_s, self.x.copy(), self.P)

    def _close_epoch(self, step: ImuStep) -> None:
        x, config = self.x, self.config
        T = step.time_s - self._epoch_s
        self._epoch_s = step.time_s
        P = self.P.copy()
        force = self._sums[kernel.SUM_FORCE : kernel.SUM_FORCE + 3] / max(T, 1e-6) - x[26:29]
        F = kernel.predict(x, P, self._sums, self._noise(step), *self._table)
        still = self._still(step)
        if still:
            self._driven[0] = 0.0
            driven = True
        else:
            body = x[11:20].reshape(3, 3) @ force
            shake = math.sqrt(float(step.shake[0:3].max()))
            driven = kernel.follow_drive(x, P, F, T, *self._table, self._driven, body, shake)
        before = (x.copy(), P.copy()) if self._on_epoch is not None else None
        if still:
            kernel.hold(x, P, config.zupt_sigma)
            if step.time_s - self._time_leveled >= LEVEL_INTERVAL_S:
                self._time_leveled = step.time_s
                kernel.level(x, P, step.f_mean, 0.02)
                kernel.still_gyro(x, P, step.w_mean, max(0.3 * step.w_std, 2e-4))
        else:
            kernel.match_attitude(x, P, T, *self._table, self._settings, self.nis)
        if not driven:
            kernel.match_speed(x, P, T, *self._table, self._speed)
        self.P = P
        if before is not None and self._on_epoch is not None:
            if self._first:
                # Nothing that comes after a start tells of what was before it.
                F[:] = 0.0
            self._first = False
            self._on_epoch(Epoch(step.time_s, *before, F, x.copy(), P))

    def _noise(self, step: ImuStep) -> Array:
        """Return the process noise (6,) of ``line_filter.predict``."""
        c = self.config
        forward = self.x[11:14]
        shake = float(forward**2 @ step.shake[0:3])
        accel = max(c.accel_noise**2, c.vibration_gain**2 * shake) / REFERENCE_HZ
        rate = c.gyro_vibration_gain**2 * float(step.shake[3:6].mean()) / REFERENCE_HZ
        rate += c.gyro_noise**2
        if step.dt > GAP_S:
            accel += GAP_ACCEL**2 * step.dt
            rate += GAP_RATE**2 * step.dt
        return np.array(
            [
                accel,
                rate,
                c.gyro_bias_walk**2,
                c.accel_bias_walk**2,
                c.mount_walk**2,
                c.speed_sigma,
            ]
        )

    def _still(self, step: ImuStep) -> bool:
        """
        Whether the train stands: shaken as little as in the station, not braking, not fast.

        A quiet chain lift looks like standstill to the IMU, and so does a train that comes slowly
        to rest: the filter's own speed and the force along the line must agree.
        """
        rest = self._rest
        if rest is None:
            return False
        if step.f_std > 1.5 * rest.force_std + 0.005 or step.w_std > 1.5 * rest.rate_std + 0.0005:
            return False
        if abs(self.x[1]) > 0.3 + 2.0 * math.sqrt(self.P[1, 1]):
            return False
        body = self.x[11:20].reshape(3, 3) @ (step.f_mean - self.x[26:29])
        pull = kernel.acceleration(*self._table, self.x[0], 0.0, *body)
        return abs(pull) < STILL_ACCEL

"""
What a filter needs to know of its IMU stream: mean motion per step, vibration, standstill, stamps.

Everything here looks at raw samples only, so it is the same however often a filter is rewound.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.imu import ImuSample

Array = NDArray[np.float64]

HIGH_PASS_HZ = 4.0
"""Force above this frequency counts as vibration: a ride's own motion is slower."""
AVERAGE_S = 0.5
"""Time constant of the running means and variances [s]."""


class ImuStep(NamedTuple):
    """
    One prediction step: from the previous sample to this one.

    Attributes:
        time_s: stamp of this sample [s].
        dt: since the previous sample [s].
        f: (3,) mean specific force over the step [m/s^2].
        w: (3,) mean angular rate over the step [rad/s].
        vibration: rms of the force above 4 Hz, per axis, running [m/s^2].
        f_mean: (3,) running mean of the force [m/s^2].
        w_mean: (3,) running mean of the rate [rad/s].
        f_std: largest running standard deviation of the force's axes [m/s^2].
        w_std: the same of the rate [rad/s].
        shake: (6,) running variance above 4 Hz of force and rate, per axis.
        mean: (6,) ``f_mean`` and ``w_mean``.
    """

    time_s: float
    dt: float
    f: Array
    w: Array
    vibration: float
    f_mean: Array
    w_mean: Array
    f_std: float
    w_std: float
    shake: Array
    mean: Array


class ImuMonitor:
    """Turn samples, in order of time, into prediction steps."""

    def __init__(self) -> None:
        self._last: ImuSample | None = None
        # rows: low-passed f, running mean f, mean w, variance f, variance w, high-passed square f,
        # low-passed w, high-passed square w
        self._m = np.zeros((8, 3))

    def push(self, sample: ImuSample) -> ImuStep:
        """Return the step that ends at ``sample``; of the first sample, one of no length."""
        last = self._last
        if last is None:
            last = sample
            self._m[0] = self._m[1] = sample.specific_force
            self._m[2] = self._m[6] = sample.angular_rate
        self._last = sample
        dt = sample.time_s - last.time_s
        # One array of all results: handing out many costs more than computing them.
        out, vibration, f_std, w_std = _advance(
            self._m,
            last.specific_force,
            last.angular_rate,
            sample.specific_force,
            sample.angular_rate,
            dt,
        )
        f, w, f_mean, w_mean = out[0:3], out[3:6], out[6:9], out[9:12]
        return ImuStep(
            sample.time_s, dt, f, w, vibration, f_mean, w_mean, f_std, w_std, out[12:18], out[6:12]
        )


@numba.njit(cache=True)
def _advance(
    m: Array, f_last: Array, w_last: Array, f: Array, w: Array, dt: float
) -> tuple[Array, float, float, float]:
    """
    Take a sample into the running figures ``m`` (8, 3).

    Return the step's force and rate, their means and the shake (18,), and the rest of the step.
    """
    fast = dt / (dt + 1.0 / (2.0 * np.pi * HIGH_PASS_HZ))
    slow = dt / (dt + AVERAGE_S)
    out = np.empty(18)
    for i in range(3):
        m[0, i] += fast * (f[i] - m[0, i])
        high = f[i] - m[0, i]
        df, dw = f[i] - m[1, i], w[i] - m[2, i]
        m[1, i] += slow * df
        m[2, i] += slow * dw
        m[3, i] += slow * (df * df - m[3, i])
        m[4, i] += slow * (dw * dw - m[4, i])
        m[5, i] += slow * (high * high - m[5, i])
        m[6, i] += fast * (w[i] - m[6, i])
        high = w[i] - m[6, i]
        m[7, i] += slow * (high * high - m[7, i])
        out[i], out[3 + i] = 0.5 * (f_last[i] + f[i]), 0.5 * (w_last[i] + w[i])
        out[6 + i], out[9 + i] = m[1, i], m[2, i]
        out[12 + i], out[15 + i] = m[5, i], m[7, i]
    vibration = np.sqrt((m[5, 0] + m[5, 1] + m[5, 2]) / 3.0)
    return out, vibration, np.sqrt(m[3].max()), np.sqrt(m[4].max())


class ClockGuard:
    """
    Decide what to make of a stamp: take it, refuse it, or begin anew.

    A stamp that repeats, goes backward or leaps ahead is refused. When the stamps stay there (a
    recording that starts over, a clock that was set), the guard says ``restart``.
    """

    def __init__(self, max_gap_s: float = 5.0, patience: int = 50) -> None:
        self.max_gap_s = max_gap_s
        self.patience = patience
        self.latest_s: float | None = None
        self._candidate_s: float | None = None
        self._run = 0

    def check(self, time_s: float) -> str | None:
        """Return None to accept, 'restart' to accept after a reset, else why it is refused."""
        if not math.isfinite(time_s):
            return 'not_finite'
        if self.latest_s is None or 0.0 < time_s - self.latest_s <= self.max_gap_s:
            self.latest_s, self._candidate_s, self._run = time_s, None, 0
            return None
        if time_s == self.latest_s:
            return 'repeated_time'
        reason = 'backward_time' if time_s < self.latest_s else 'time_jump'
        before = self._candidate_s
        follows = before is not None and 0.0 < time_s - before <= self.max_gap_s
        self._run = self._run + 1 if follows else 1
        self._candidate_s = time_s
        if self._run < self.patience:
            return reason
        self.latest_s, self._candidate_s, self._run = time_s, None, 0
        return 'restart'

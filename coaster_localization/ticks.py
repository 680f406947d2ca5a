"""
IMU samples of any rate turned into rows at a fixed one, causally, with bounded work and memory.

A row holds means over one tick, so fast sensors are averaged and slow ones interpolated. The same
means of the design ride compare with them without delay.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt_zi

from track_localization.estimation.so3 import exp_one, normalised_one

Array = NDArray[np.float64]

FORCE, RATE, VERTICAL, SHAKE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 11)
WIDTH = 11


class Ticker:
    """
    Means over ticks: force, rate, the vertical, and how much the sensor shakes.

    A row is (11,): force [m/s^2] and rate [rad/s] in the sensor's axes, the map's vertical in the
    body's, mean squared change from sample to sample of force and rate.

    Attributes:
        R_bm: (3, 3) sensor to body.
        gyro_bias: (3,) in the sensor's axes [rad/s].
        R_nb: (3, 3) attitude at the latest sample.
    """

    def __init__(self, rate_hz: float, longest_gap_s: float) -> None:
        """Make rows at ``rate_hz``; no two samples may be further apart than ``longest_gap_s``."""
        self._step = 1.0 / rate_hz
        self._out = np.empty((int(longest_gap_s * rate_hz) + 3, WIDTH))
        self.R_bm, self.gyro_bias, self.R_nb = np.eye(3), np.zeros(3), np.eye(3)
        self.restart()

    def restart(self) -> None:
        """Forget the latest sample; the next one begins a tick."""
        self._clock = np.full(2, np.nan)
        self._last, self._sums = np.zeros(WIDTH), np.zeros(WIDTH)

    def in_body(self, row: Array) -> Array:
        """Return the row (11,) with force and rate, bias-free, in body axes."""
        turned = row.copy()
        turned[FORCE] = self.R_bm @ row[FORCE]
        turned[RATE] = self.R_bm @ (row[RATE] - self.gyro_bias)
        return turned

    def push(self, time_s: float, force: Array, rate: Array) -> list[tuple[float, Array]]:
        """Return (middle [s], row) of each tick that this sample completes."""
        begin = self._clock[1]
        count = _push(
            time_s,
            force,
            rate,
            self.R_bm,
            self.gyro_bias,
            self.R_nb,
            self._clock,
            self._last,
            self._sums,
            self._step,
            self._out,
        )
        return [(begin + (k + 0.5) * self._step, self._out[k].copy()) for k in range(count)]


@numba.njit(cache=True)
def _push(
    time: float,
    force: Array,
    rate: Array,
    R_bm: Array,
    bias: Array,
    R_nb: Array,
    clock: Array,
    last: Array,
    sums: Array,
    step: float,
    out: Array,
) -> int:
    """Integrate from the last sample to this one; ``clock`` is (last stamp, tick's begin)."""
    now = np.empty(WIDTH)
    now[0:3] = force
    now[3:6] = rate
    if np.isnan(clock[0]):
        clock[0], clock[1] = time, time
        now[6:9], now[9:11] = R_nb[2], 0.0
        last[:], sums[:] = now, 0.0
        return 0
    dt = time - clock[0]
    turn = R_bm @ (0.5 * (last[3:6] + now[3:6]) - bias)
    R_nb[:] = normalised_one(R_nb @ exp_one(dt * turn))
    now[6:9] = R_nb[2]
    now[9] = ((now[0:3] - last[0:3]) ** 2).sum()
    now[10] = ((now[3:6] - last[3:6]) ** 2).sum()
    last[9:11] = now[9:11]
    count, at = 0, clock[0]
    while clock[1] + step <= time and count < len(out):
        end = clock[1] + step
        middle = (0.5 * (at + end) - clock[0]) / dt
        sums += (end - at) * (last + middle * (now - last))
        out[count] = sums / step
        sums[:] = 0.0
        count += 1
        at = end
        clock[1] = end
    middle = (0.5 * (at + time) - clock[0]) / dt
    sums += (time - at) * (last + middle * (now - last))
    last[:] = now
    clock[0] = time
    return count


class LowPass:
    """A causal low-pass with its state; rows (C,) or series (N, C)."""

    def __init__(self, rate_hz: float, cut_hz: float) -> None:
        """Make a second-order Butterworth filter; above 0.45 of the rate it passes all."""
        self._sos = butter(2, cut_hz, fs=rate_hz, output='sos') if cut_hz < 0.45 * rate_hz else None
        self._state: Array | None = None

    def reset(self) -> None:
        """Begin anew, as if the first row had been there for ever."""
        self._state = None

    def __call__(self, rows: Array) -> Array:
        """Return the rows (N, C) filtered, going on from the last call."""
        if self._sos is None:
            return rows
        if self._state is None:
            self._state = sosfilt_zi(self._sos)[0, :, None] * rows[0]
        out: Array = _filter(self._sos[0], rows, self._state)
        return out


@numba.njit(cache=True)
def _filter(sos: Array, rows: Array, state: Array) -> Array:
    """Filter rows (N, C) by one section; ``state`` (2, C) goes on. scipy costs 0.1 ms a call."""
    out = np.empty_like(rows)
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            value = sos[0] * rows[i, j] + state[0, j]
            state[0, j] = sos[1] * rows[i, j] - sos[4] * value + state[1, j]
            state[1, j] = sos[2] * rows[i, j] - sos[5] * value
            out[i, j] = value
    return out

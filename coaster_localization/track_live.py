"""The track filter as a live system: samples in, estimates, smoothed estimates and laps out."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_estimate import TrackEstimate
from coaster_localization.track_filter import CoasterTrackFilter
from coaster_localization.track_map import line_map
from coaster_localization.track_smoothing import FixedLag
from coaster_localization.track_states import Epoch, TrackState
from track_localization.estimation import line_state
from track_localization.estimation.imu import ImuSample
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

MOST_RECENT = 60_000
"""Samples kept for the states that come late: a minute at 1 kHz."""
OFF_TRACK_M = 5.0
"""A start further off the line than this and five of its own sigmas is not on this track."""
NO_RATE = np.zeros(3)
LAP_SIGMAS, LAP_SLACK_M = 3.0, 1.0
"""A start so near before the line's end may as well be behind it."""


class LapCounter:
    """
    Count the laps of a closed line: its end passed forward, counted from the start.

    Steps are taken the short way round, so that a place told or found anew on another lap than
    the filter's own is no lap.

    Attributes:
        completed: laps since the start.
    """

    def __init__(self, length: float) -> None:
        """Count on a line of this ``length`` [m]."""
        self._length = length
        self.reset()

    def reset(self) -> None:
        """Begin anew at the next chainage."""
        self.completed = 0
        self.begin()

    def begin(self) -> None:
        """Go on from the next chainage, wherever it is; the laps so far are kept."""
        self._s = math.nan

    def push(self, s: float, sigma: float) -> bool:
        """Take the chainage and its standard deviation [m]; return whether a lap is completed."""
        if math.isnan(self._s):
            self._s = s % self._length
            slack = min(LAP_SIGMAS * sigma + LAP_SLACK_M, 0.25 * self._length)
            self._end = self._length * (math.floor((self._s + slack) / self._length) + 1)
            return False
        step = s - self._s
        self._s += step - self._length * round(step / self._length)
        if self._s < self._end:
            return False
        self._end += self._length
        self.completed += 1
        return True


class LiveTrackFilter:
    """
    The track filter, the fixed-lag smoother behind it, and laps.

    ``push`` takes samples in the body (apply the mount before) and returns an estimate for each;
    ``smoothed`` returns what became old enough since it was called last. Nothing is lost when it
    is called later: live estimates can go out first.

    Attributes:
        lag_s: age of what ``smoothed`` returned last, against the newest sample [s].
    """

    def __init__(self, design: DesignRide, config: TrackFilterConfig) -> None:
        """Follow the ride ``design`` from where it begins."""
        self.config = config
        self.line = line_map(design, config)
        self._keep_s = max(config.rest_s, config.seek_after_s) + 1.0
        self._epochs: list[Epoch] = []
        start_m = float(design.chainage[0])
        self.filter = CoasterTrackFilter(self.line, start_m, config, self._epochs.append)
        self._laps = LapCounter(self.line.length) if self.line.closed else None
        self._forget()

    def _forget(self) -> None:
        self._epochs.clear()
        self._rated = 0
        self._recent: deque[ImuSample] = deque(maxlen=MOST_RECENT)
        self._lag = FixedLag(self.config.lag_s)
        self._epoch_rates: deque[tuple[float, Array]] = deque()
        self._newest_s = self.lag_s = math.nan
        if self._laps is not None:
            self._laps.reset()

    def reset(self) -> None:
        """Forget the ride and wait for a start again; a start that was set is kept."""
        self.filter.reset()
        self._forget()

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """Refused measurements: sensor -> reason -> count."""
        return self.filter.rejected

    @property
    def laps(self) -> int:
        """Laps completed since the start."""
        return self._laps.completed if self._laps is not None else 0

    def diagnostics(self) -> dict[str, float | str]:
        """Return figures for a health report."""
        figures = self.filter.diagnostics()
        if 'chainage_m' in figures and self.line.closed:
            figures['chainage_m'] = float(figures['chainage_m']) % self.line.length
        return figures | {'laps': float(self.laps), 'lag_latency_s': self.lag_s}

    def set_start_chainage(self, s: float, variance: float) -> str | None:
        """
        Say where the train is, by chainage [m] and its variance [m^2]; return why not.

        Before the ride it is where the train will start.
        """
        sigma, length = math.sqrt(variance), self.line.length
        beyond = OFF_TRACK_M + 5.0 * sigma
        if self.line.closed:
            s %= length
        elif not -beyond <= s <= length + beyond:
            return 'off_track'
        else:
            s = min(max(s, 0.0), length)
        self.filter.set_start(s, sigma)
        if self._laps is not None:
            self._laps.begin()
        return None

    def set_start_position(self, position: Array, covariance: Array) -> str | None:
        """
        Say where the train is, by a place in ``map``: the nearest on the line; return why not.

        ``position`` (3,) [m], ``covariance`` (3, 3) [m^2].
        """
        s = float(self.line.line.nearest(position))
        off = float(np.linalg.norm(self.line.line.position(s) - position))
        if off > OFF_TRACK_M + 5.0 * math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])):
            return 'off_track'
        slope = self.line.line.slope(s)
        along = float(slope @ covariance @ slope) / float(slope @ slope) ** 2
        return self.set_start_chainage(s, along)

    def push(self, sample: ImuSample) -> list[TrackEstimate]:
        """Take one sample; return the estimates that it makes possible."""
        recent = self._recent
        recent.append(sample)
        while abs(sample.time_s - recent[0].time_s) > self._keep_s:
            recent.popleft()
        states = self.filter.push(sample)
        if not states:
            return []
        rates = {sample.time_s: sample.angular_rate}
        if len(states) > 1 or len(self._epochs) > 1:
            # A start was found: what had waited for it comes now.
            rates = {waited.time_s: waited.angular_rate for waited in recent}
        for epoch in self._epochs[self._rated :]:
            self._epoch_rates.append((epoch.time_s, rates.get(epoch.time_s, NO_RATE)))
        self._rated = len(self._epochs)
        self._newest_s = states[-1].time_s
        return [self._estimate(s, rates.get(s.time_s, NO_RATE)) for s in states]

    def smoothed(self) -> list[TrackEstimate]:
        """Return the smoothed estimates that became due, each with the stamp of its epoch."""
        out = []
        for epoch in self._epochs:
            for time_s, x, P in self._lag.push(epoch):
                state = TrackState(time_s, x, P, widened=self.filter.widened)
                out.append(self._estimate(state, self._epoch_rate(time_s)))
        self._epochs.clear()
        self._rated = 0
        if out:
            self.lag_s = self._newest_s - out[-1].time_s
        return out

    def lap_completed(self, estimate: TrackEstimate) -> bool:
        """Take an estimate that ``push`` returned; return whether it completes a lap."""
        if self._laps is None:
            return False
        return self._laps.push(float(estimate.x[0]), math.sqrt(float(estimate.P[0, 0])))

    def _epoch_rate(self, time_s: float) -> Array:
        rates = self._epoch_rates
        while rates:
            stamp, rate = rates.popleft()
            if stamp == time_s:
                return rate
        return NO_RATE

    def _estimate(self, state: TrackState, rate: Array) -> TrackEstimate:
        """Return the estimate of a state whose sensor turned at ``rate`` (3,) [rad/s]."""
        x = state.x
        scale, bias = line_state.X_GYRO_SCALE, line_state.X_GYRO_BIAS
        turning = (1.0 - x[scale : scale + 3]) * rate - x[bias : bias + 3]
        body = x[line_state.X_MOUNT : line_state.X_MOUNT + 9].reshape(3, 3) @ turning
        line_sigma = self.config.line_sigma_m * math.sqrt(state.widened)
        P = state.P * state.widened
        return TrackEstimate(state.time_s, x, P, self.line, body, line_sigma, state.lost)

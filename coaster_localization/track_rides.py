"""The track filter over a recording: live, with a fixed lag, and smoothed over the whole ride."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_estimate import to_trajectory
from coaster_localization.track_filter import CoasterTrackFilter, Epoch, TrackState
from coaster_localization.track_smoothing import FixedLag, smooth_epochs
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.line_map import LineMap

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class FilteredRide:
    """
    A recording that the track filter has been through.

    Attributes:
        line: the line.
        config: the filter's settings.
        states: one for every sample since the start was known.
        epochs: one for every comparison with the line.
        rejected: refused measurements, sensor -> reason -> count.
        runtime_s: seconds spent.
    """

    line: LineMap
    config: TrackFilterConfig
    states: list[TrackState]
    epochs: list[Epoch]
    rejected: dict[str, dict[str, int]]
    runtime_s: float

    def live(self) -> Trajectory:
        """Return what the filter knew at every sample."""
        times = np.array([state.time_s for state in self.states])
        x = np.array([state.x for state in self.states])
        P = np.array([state.P[0:2, 0:2] for state in self.states])
        return to_trajectory(times, x, P, self.line, self.config.line_sigma_m)

    def smoothed(self) -> Trajectory:
        """Return what the whole ride tells of every sample."""
        x, P = smooth_epochs(self.epochs)
        return self._between(np.array([e.time_s for e in self.epochs]), x, P[:, 0:2, 0:2])

    def lagged(self) -> Trajectory:
        """Return what was known of every sample ``lag_s`` later."""
        lag, out = FixedLag(self.config.lag_s), []
        for epoch in self.epochs:
            out += lag.push(epoch)
        out += lag.flush()
        times = np.array([time_s for time_s, _, _ in out])
        x = np.array([x for _, x, _ in out])
        return self._between(times, x, np.array([P[0:2, 0:2] for _, _, P in out]))

    def _between(self, times: Array, x: Array, P: Array) -> Trajectory:
        """Give every sample its place between the epochs: the filter's own, corrected."""
        t = np.array([state.time_s for state in self.states])
        states = np.array([state.x for state in self.states])
        after = np.array([e.x[0:2] for e in self.epochs])
        before = np.array([e.x_before[0:2] for e in self.epochs])
        last = len(times) - 1
        k = np.clip(np.searchsorted(times, t, side='right') - 1, 0, last)
        then = np.minimum(k + 1, last)
        span = np.where(then > k, times[then] - times[k], np.inf)
        share = np.clip((t - times[k]) / span, 0.0, 1.0)[:, None]
        # Between two epochs the filter's own motion is kept, bent to meet both ends.
        start, end = (x[:, 0:2] - after)[k], (x[:, 0:2] - before)[then]
        states[:, 0:2] += (1.0 - share) * start + share * end
        nearest = np.where(share[:, 0] > 0.5, then, k)
        states[:, 2:] = x[nearest, 2:]
        return to_trajectory(t, states, P[nearest], self.line, self.config.line_sigma_m)


def filter_ride(
    imu: ImuSeries, line: LineMap, start_m: float, config: TrackFilterConfig
) -> FilteredRide:
    """Run the filter over a recording; raise DataError where it never finds a start."""
    begin = time.perf_counter()
    epochs: list[Epoch] = []
    filter_ = CoasterTrackFilter(line, start_m, config, epochs.append)
    states: list[TrackState] = []
    for i in range(len(imu)):
        states += filter_.push(imu.sample(i))
    if len(epochs) < 2:
        raise DataError(
            'track filter: the recording is too short to find the train on its track; record '
            'the ride from the rest in the station on'
        )
    seconds = time.perf_counter() - begin
    return FilteredRide(line, config, states, epochs, filter_.rejected, seconds)

"""The track filter over a recording: live, with a fixed lag, and smoothed over the whole ride."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
from numpy.typing import NDArray

from coaster_localization.start import Rest, observe_rest
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_estimate import to_trajectory
from coaster_localization.track_filter import CoasterTrackFilter
from coaster_localization.track_smoothing import FixedLag, smooth_epochs
from coaster_localization.track_start import is_firm
from coaster_localization.track_states import Doubt, Epoch, TrackState
from track_localization.errors import DataError
from track_localization.estimation import line_state
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.line_map import LineMap

Array = NDArray[np.float64]

WARM_UP_S = 10.0
"""How long the running means take that a stretch is gone through again with [s]."""


@dataclasses.dataclass(frozen=True)
class FilteredRide:
    """
    A recording that the track filter has been through.

    Attributes:
        line: the line.
        config: the filter's settings.
        states: what was known at every sample since the start, live.
        settled: the same, where there was doubt, of the hypothesis that proved right.
        epochs: one for every comparison with the line, of ``settled``.
        doubts: the stretches with several hypotheses.
        rejected: refused measurements, sensor -> reason -> count.
        mount: sensor-to-body rotation (3, 3) at the end, and its standard deviation [rad].
        runtime_s: seconds spent.
    """

    line: LineMap
    config: TrackFilterConfig
    states: list[TrackState]
    settled: list[TrackState]
    epochs: list[Epoch]
    doubts: list[Doubt]
    rejected: dict[str, dict[str, int]]
    mount: tuple[Array, float]
    runtime_s: float

    def live(self) -> Trajectory:
        """Return what the filter knew at every sample."""
        times = np.array([state.time_s for state in self.states])
        x = np.array([state.x for state in self.states])
        P = np.array([state.P[0:2, 0:2] for state in self.states])
        return self._out(times, x, P, np.array([state.widened for state in self.states]))

    def smoothed(self) -> Trajectory:
        """Return what the whole ride tells of every sample."""
        x, P = smooth_epochs(self.epochs)
        widened = np.full(len(self.settled), self.settled[-1].widened)
        times = np.array([e.time_s for e in self.epochs])
        return self._between(times, x, P[:, 0:2, 0:2], widened)

    def lagged(self) -> Trajectory:
        """Return what was known of every sample ``lag_s`` later."""
        lag, out = FixedLag(self.config.lag_s), []
        for epoch in self.epochs:
            out += lag.push(epoch)
        out += lag.flush()
        times = np.array([time_s for time_s, _, _ in out])
        x = np.array([x for _, x, _ in out])
        widened = np.array([state.widened for state in self.settled])
        known = self._between(times, x, np.array([P[0:2, 0:2] for _, _, P in out]), widened)
        live = self.live()
        unknown = np.zeros(len(live), dtype=bool)
        for origin, until_s in self.doubts:
            latest = until_s - self.config.lag_s
            unknown |= (live.time_s >= origin.time_s) & (live.time_s < latest)
        return _either(live, known, unknown)

    def _out(self, time_s: Array, x: Array, P: Array, widened: Array) -> Trajectory:
        """Return states (N, 30) as a trajectory, variances widened by a factor (N,)."""
        sigma = self.config.line_sigma_m * np.sqrt(widened)
        return to_trajectory(time_s, x, P * widened[:, None, None], self.line, sigma)

    def _between(self, times: Array, x: Array, P: Array, widened: Array) -> Trajectory:
        """Give every sample its place between the epochs: the filter's own, corrected."""
        t = np.array([state.time_s for state in self.settled])
        states = np.array([state.x for state in self.settled])
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
        # The attitude likewise: both ends' corrections are small and nearly the same.
        C = states[:, 2:11].reshape(-1, 3, 3)
        after = np.array([e.x[2:11] for e in self.epochs]).reshape(-1, 3, 3)
        turn = x[:, 2:11].reshape(-1, 3, 3) @ np.swapaxes(after, 1, 2)
        states[:, 2:11] = (turn[k] @ C).reshape(-1, 9)
        states[:, 11:] = x[nearest, 11:]
        return self._out(t, states, P[nearest], widened)


def filter_ride(
    imu: ImuSeries, line: LineMap, start_m: float, config: TrackFilterConfig
) -> FilteredRide:
    """Run the filter over a recording; raise DataError where it never finds a start."""
    begin = time.perf_counter()
    epochs: list[Epoch] = []
    filter_ = CoasterTrackFilter(line, start_m, config, epochs.append, rest_after(imu, config))
    states: list[TrackState] = []
    for i in range(len(imu)):
        states += filter_.push(imu.sample(i))
    settled = states
    for doubt in filter_.doubts:
        settled, epochs = _settle(imu, filter_, doubt, settled, epochs)
    if len(epochs) < 2:
        raise DataError(
            'track filter: the train is not found on its track; record the ride from the rest in '
            'the station on, and check that the design ride is of this track'
        )
    mount = slice(line_state.MOUNT, line_state.MOUNT + 3)
    sigma = float(np.sqrt(np.trace(epochs[-1].P[mount, mount]) / 3.0))
    return FilteredRide(
        line,
        config,
        states,
        settled,
        epochs,
        filter_.doubts,
        filter_.rejected,
        (epochs[-1].x[11:20].reshape(3, 3), sigma),
        time.perf_counter() - begin,
    )


def rest_after(imu: ImuSeries, config: TrackFilterConfig) -> Rest | None:
    """Return the rest at the recording's end, for one that shows none at its begin."""
    latest = np.flatnonzero(imu.time_s > imu.time_s[-1] - config.rest_s)
    rest = observe_rest([imu.sample(int(i)) for i in latest])
    return rest if rest is not None and is_firm(rest) else None


def _settle(
    imu: ImuSeries,
    filter_: CoasterTrackFilter,
    doubt: Doubt,
    states: list[TrackState],
    epochs: list[Epoch],
) -> tuple[list[TrackState], list[Epoch]]:
    """Put what the right hypothesis went through in the place of the doubt."""
    origin, until_s = doubt
    again: list[Epoch] = []
    one = CoasterTrackFilter(filter_.line, 0.0, filter_.config, again.append, origin.rest, origin)
    found: list[TrackState] = []
    first, last = np.searchsorted(imu.time_s, (origin.time_s - WARM_UP_S, until_s + 0.5))
    for i in range(int(first), int(last)):
        found += one.push(imu.sample(i))
    inside = [s for s in found if s.time_s <= until_s]
    known = {s.time_s: s for s in inside}
    states = [known.get(s.time_s, s) for s in states]
    earlier = [e for e in epochs if e.time_s < origin.time_s]
    later = [e for e in epochs if e.time_s > until_s]
    bridge = [e for e in again if later and abs(e.time_s - later[0].time_s) < 1e-6]
    if bridge:
        later[0] = later[0]._replace(F=bridge[0].F)
    return states, [*earlier, *(e for e in again if e.time_s <= until_s), *later]


def _either(first: Trajectory, second: Trajectory, which: NDArray[np.bool_]) -> Trajectory:
    """Return ``first`` where ``which`` (N,), else ``second``, of the same stamps."""
    parts = {}
    for field in dataclasses.fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        parts[field.name] = np.where(which.reshape(-1, *[1] * (a.ndim - 1)), a, b)
    return Trajectory(**parts)

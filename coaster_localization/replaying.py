"""
Many IMU steps at once: what a late match makes the filter repeat, in compiled code.

The same arithmetic as one step after the other, without going back to Python in between.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from coaster_localization.estimate import FusedState, Prediction
from coaster_localization.observation import MatchObservation
from track_localization.estimation.eskf import State
from track_localization.estimation.eskf_kernels import predict_into
from track_localization.track.line_table import LineTable, project_one

Array = NDArray[np.float64]


ZUPT_INTERVAL_S = 0.2
"""A standstill is used once in so long [s]: its errors persist."""
SAME_S = 1e-9
"""Two spans of time that differ by less are the same [s]."""


def plain_steps(
    state: FusedState, measurements: Sequence[Prediction | MatchObservation], first: int
) -> list[Prediction]:
    """
    Return the steps from ``measurements[first]`` on, up to one that needs more than predicting.

    More is a match, a standstill update that is due, or a step that does not begin where
    ``state`` is, or where the step before it ended, and so needs its noise anew.
    """
    steps: list[Prediction] = []
    time_s = state.nav.time_s
    for k in range(first, len(measurements)):
        measurement = measurements[k]
        if isinstance(measurement, MatchObservation):
            break
        step = measurement.step
        if measurement.quiet and step.time_s - state.last_zupt_s >= ZUPT_INTERVAL_S:
            break
        dt = step.time_s - time_s
        if dt <= 0.0 or abs(dt - step.dt) >= SAME_S:
            break
        steps.append(measurement)
        time_s = step.time_s
    return steps


class RepeatedStates:
    """States after one step after the other, kept as arrays; each is made when asked for."""

    def __init__(
        self, before: FusedState, time_s: list[float], x: Array, P: Array, chainage: Array
    ) -> None:
        """``time_s`` and rows: stamp, nominal state, covariance and chainage after each step."""
        self._unchanged = before[2:]
        self._time_s, self._x, self._P, self._chainage = time_s, x, P, chainage

    def __len__(self) -> int:
        return len(self._time_s)

    def __getitem__(self, k: int, /) -> FusedState:
        nav = State(self._time_s[k], self._x[k], self._P[k])
        return FusedState(nav, float(self._chainage[k]), *self._unchanged)


def repeat_steps(
    state: FusedState, predictions: Sequence[Prediction], line: LineTable
) -> RepeatedStates:
    """
    Return the states after each of ``predictions``, in order of time, from ``state`` on.

    They are such as ``plain_steps`` returns, at least one.
    """
    steps = [p.step for p in predictions]
    time_s = [s.time_s for s in steps]
    x, P, chainage = _repeat(
        state.nav.x,
        state.nav.P,
        state.chainage,
        np.array([s.f for s in steps]),
        np.array([s.w for s in steps]),
        np.diff([state.nav.time_s, *time_s]),
        np.array([p.q for p in predictions]),
        line.position,
        line.axes,
        line.stretch,
        line.step_m,
        line.length,
        line.closed,
    )
    return RepeatedStates(state, time_s, x, P, chainage)


@numba.njit(cache=True)
def _repeat(
    x: Array,
    P: Array,
    s: float,
    f: Array,
    w: Array,
    dt: Array,
    q: Array,
    position: Array,
    axes: Array,
    stretch: Array,
    step_m: float,
    length: float,
    closed: bool,
) -> tuple[Array, Array, Array]:
    count = len(dt)
    xs, Ps, chainage = np.empty((count, len(x))), np.empty((count, *P.shape)), np.empty(count)
    F, work = np.eye(len(P)), np.empty_like(P)
    for k in range(count):
        predict_into(x, P, f[k], w[k], dt[k], q[k], F, work, xs[k], Ps[k])
        x, P = xs[k], Ps[k]
        s = project_one(position, axes, stretch, step_m, length, closed, x[0:3], s)
        chainage[k] = s
    return xs, Ps, chainage

"""Smoothed estimates of a whole recording: a filter's history, then Rauch-Tung-Striebel."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization.estimation import so3
from track_localization.estimation.smoother import rts_smooth
from train_localization import kernels
from train_localization.estimate import Estimate
from train_localization.pipeline import TrainPipeline
from train_localization.robust_filter import RobustFilter
from train_localization.state import Fused, Stretch

Array = NDArray[np.float64]

NAV = 10
"""Numbers of the navigation state; those of ``aux`` follow."""


class Ride:
    """
    What a pipeline's filter knew after every step of a recording, kept as the history forgets it.

    ``note`` it whenever the pipeline has given estimates. What is older than ``horizon_s`` is
    final; a filter that starts anew begins another part.

    Attributes:
        parts: each the steps of one filter, (stretch, state after all updates at its end), and
            that filter; the first step of each is the start, without a stretch.
    """

    def __init__(self, horizon_s: float) -> None:
        self._horizon_s = horizon_s
        self._filter: RobustFilter | None = None
        self._tail: list[tuple[Stretch | None, Fused]] = []
        self.parts: list[tuple[RobustFilter, list[tuple[Stretch | None, Fused]]]] = []

    def note(self, pipeline: TrainPipeline) -> None:
        """Keep what the pipeline's history has."""
        if pipeline.filter is not self._filter:
            self.finish()
            self._filter = pipeline.filter
            self.parts.append((pipeline.filter, []))
        steps, kept = list(_steps(pipeline)), self.parts[-1][1]
        if (kept or self._tail) and steps and steps[0][0] is None:
            del steps[0]  # its stretch is forgotten, and was noted before
        if not steps:
            return
        forgotten = [step for step in self._tail if step[1].time_s < steps[0][1].time_s]
        final_s = steps[-1][1].time_s - self._horizon_s
        kept += forgotten
        last_s = kept[-1][1].time_s if kept else -math.inf
        kept += [step for step in steps if last_s < step[1].time_s < final_s]
        last_s = kept[-1][1].time_s if kept else -math.inf
        self._tail = [step for step in steps if step[1].time_s > last_s]

    def finish(self) -> None:
        """Keep the rest too: nothing more comes."""
        if self.parts:
            self.parts[-1][1].extend(self._tail)
        self._tail = []


def _steps(pipeline: TrainPipeline) -> Iterator[tuple[Stretch | None, Fused]]:
    """Yield each stretch of the history with the state after all that was heard at its end."""
    step: tuple[Stretch | None, Fused] | None = None
    for _, measurement, state in pipeline.entries():
        if isinstance(measurement, Stretch) or step is None:
            if step is not None:
                yield step
            step = (measurement if isinstance(measurement, Stretch) else None, state)
        else:
            step = (step[0], state)
    if step is not None:
        yield step


def smoothed(ride: Ride, pipeline: TrainPipeline) -> list[Estimate]:
    """Return the smoothed estimates of a ride, in order of time; ``pipeline`` places them."""
    estimates: list[Estimate] = []
    for filter_, steps in ride.parts:
        if len(steps) < 2:
            continue
        x, P = _smooth(filter_, steps)
        for (stretch, state), x_k, P_k in zip(steps, x, P, strict=True):
            if stretch is not None:
                better = state._replace(nav=x_k[:NAV], aux=x_k[NAV:], P=P_k)
                estimates.append(pipeline.estimate(filter_.told(better)))
    return estimates


def _smooth(
    filter_: RobustFilter, steps: list[tuple[Stretch | None, Fused]]
) -> tuple[list[Array], list[Array]]:
    """Return smoothed states (28,) and covariances (27, 27) of every step."""
    states = [state for _, state in steps]

    def predict(k: int) -> tuple[Array, Array, Array]:
        stretch = steps[k + 1][0]
        assert stretch is not None
        after, Phi = filter_.predict(states[k], stretch)
        return _stacked(after), after.P, Phi

    return rts_smooth(
        [_stacked(s) for s in states], [s.P for s in states], predict, box_minus, box_plus
    )


def _stacked(state: Fused) -> Array:
    return np.concatenate([state.nav, state.aux])


@njit(cache=True)
def box_minus(a: Array, b: Array) -> Array:
    """Return the error (27,) of ``b`` against ``a``, states (28,): what makes a of b."""
    error = np.empty(len(a) - 1)
    error[:3] = kernels.apart(b[:NAV], a[0], a[1], a[2])
    error[3:6] = a[3:6] - b[3:6]
    turn = np.ascontiguousarray(kernels.rotation(b[:NAV]).T) @ kernels.rotation(a[:NAV])
    error[6:9] = so3.log_one(turn)
    error[9:] = a[NAV:] - b[NAV:]
    return error


@njit(cache=True)
def box_plus(x: Array, dx: Array) -> Array:
    """Return a state (28,) corrected by an error (27,)."""
    out = x.copy()
    kernels.give(out[:NAV], out[NAV:], dx.copy())
    return out

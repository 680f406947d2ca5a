"""Smoothing of the track filter: over a whole ride, or the last seconds of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_states import Epoch
from track_localization.estimation import line_state
from track_localization.estimation.smoother import gain

Array = NDArray[np.float64]


def smooth_epochs(epochs: Sequence[Epoch]) -> tuple[Array, Array]:
    """
    Return smoothed nominal states (N, 30) and covariances (N, 18, 18) of successive epochs.

    Rauch-Tung-Striebel, from the last epoch's own estimate back.
    """
    n = len(epochs)
    x = np.array([e.x for e in epochs]).reshape(n, line_state.NOMINAL)
    P = np.array([e.P for e in epochs]).reshape(n, line_state.ERRORS, line_state.ERRORS)
    for k in range(n - 2, -1, -1):
        after = epochs[k + 1]
        _backward(x[k], P[k], after.x_before, after.P_before, after.F, x[k + 1], P[k + 1])
    return x, P


@numba.njit(cache=True)
def _backward(
    x: Array, P: Array, x_before: Array, P_before: Array, F: Array, x_next: Array, P_next: Array
) -> None:
    """
    Smooth one epoch in place: ``x``, ``P`` are the filter's, ``*_next`` the smoothed.

    Where one hypothesis took another's place the next epoch is not all that this one led to, and
    what is left of a variance may be less than nothing: the filter's own then stands.
    """
    G = gain(P, P_before, F)
    new = P + G @ (P_next - P_before) @ np.ascontiguousarray(G.T)
    if np.diag(new).min() > 0.0:
        P[:, :] = 0.5 * (new + new.T)
    line_state.add_error(x, G @ line_state.difference(x_next, x_before))


class FixedLag:
    """
    Smoothed epochs a fixed time behind the newest, as live use wants them.

    Work per call is bounded: every ``BATCH`` epochs the window is smoothed once.
    """

    BATCH = 5

    def __init__(self, lag_s: float) -> None:
        """Give out epochs that are ``lag_s`` old."""
        self._lag_s = lag_s
        self._window: deque[Epoch] = deque()
        self._since = 0

    def push(self, epoch: Epoch) -> list[tuple[float, Array, Array]]:
        """Take an epoch; return (stamp, state, covariance) of those that are old enough."""
        window = self._window
        out = self.flush() if window and epoch.time_s <= window[-1].time_s else []
        window.append(epoch)
        self._since += 1
        if self._since < self.BATCH or epoch.time_s - window[0].time_s < self._lag_s:
            return out
        self._since = 0
        return out + self._release(epoch.time_s - self._lag_s)

    def flush(self) -> list[tuple[float, Array, Array]]:
        """Return what is left at the end of a ride."""
        return self._release(float('inf'))

    def _release(self, until_s: float) -> list[tuple[float, Array, Array]]:
        window = self._window
        if not window:
            return []
        x, P = smooth_epochs(window)
        out = []
        for k in range(len(x)):
            if not window or window[0].time_s > until_s:
                break
            out.append((window.popleft().time_s, x[k], P[k]))
        return out

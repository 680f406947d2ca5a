"""
The place on the design ride as a hidden Markov chain, followed sample by sample.

An open-end time warping whose paths are summed instead of the best being kept: a state is a row of
the design and a pace, and each measured row moves on by none, one or two rows. So the answer comes
with its own probability, and looking back by a fixed lag needs no path. Only the rows that have
any probability are visited: few when the place is known, all when it is sought.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

PACES = np.array([0.6, 0.8, 0.9, 0.96, 1.0, 1.04, 1.1, 1.2, 1.4])
"""Rows of the design that a measured row advances by, on average."""
NEGLIGIBLE = 1e-9


class Tracker:
    """
    Distribution over rows and paces, now and ``lag`` measured rows ago.

    Holds ``lag + 1`` rows of it; work per row is bounded by the design's length.
    """

    def __init__(self, design: Array, lag: int, noise: float, wander: float, jump: float) -> None:
        """
        Prepare for ``design`` (n, C) features.

        ``noise`` is the variance of a feature row's distance, ``wander`` the probability per row
        of changing to either neighbouring pace, ``jump`` that of staying or skipping a row more
        than the pace says.
        """
        self.design = np.ascontiguousarray(design)
        self.noise = noise
        self._wander = wander
        self._steps = _steps(jump)
        self._lag = lag
        n = len(design)
        self._forward = np.zeros((lag + 1, len(PACES), n))
        self._likely = np.zeros((lag + 1, n))
        self._held = np.zeros(lag + 1, dtype=bool)
        self._range = np.zeros((lag + 1, 2), dtype=np.int64)
        self._now = 0
        self.rows = 0
        self.fit = 0.0

    def start(self, first: int, stop: int) -> None:
        """Forget everything; the place is anywhere in design rows ``first..stop - 1``."""
        self._forward[:] = 0.0
        self.rows, self._now = 0, 0
        prior = np.exp(-0.5 * ((PACES - 1.0) / 0.1) ** 2)
        self._forward[0, :, first:stop] = (prior / prior.sum() / (stop - first))[:, None]
        self._range[0] = first, stop

    def advance(self, row: Array, held: bool) -> None:
        """Take one measured feature row (C,); ``held``: the train stands still."""
        last = self._now
        now = (last + 1) % (self._lag + 1)
        self.fit = _forward_step(
            self._forward[last],
            self._forward[now],
            self._likely[now],
            self._range[last],
            self._range[now],
            self.design,
            row,
            held,
            self._steps,
            self._wander,
            self.noise,
        )
        self._held[now] = held
        self._now = now
        self.rows += 1

    @property
    def width(self) -> int:
        """Design rows that have any probability."""
        return int(self._range[self._now, 1] - self._range[self._now, 0])

    def look_back(self, lag: int) -> tuple[Array, int]:
        """
        Return the probabilities (K,) of rows ``first..`` of the design and ``first``.

        They are those of ``lag`` measured rows ago (at most those kept), given all rows since.
        """
        lag = min(lag, self._lag, self.rows)
        return _look_back(
            self._forward,
            self._likely,
            self._held,
            self._range,
            self._now,
            lag,
            self._steps,
            self._wander,
        )


def _steps(jump: float) -> Array:
    """Return (P, 3): probability of advancing 0, 1, 2 rows at each pace."""
    stay, skip = np.maximum(1.0 - PACES, 0.0) + jump, np.maximum(PACES - 1.0, 0.0) + jump
    return np.stack([stay, 1.0 - stay - skip, skip], axis=-1)


HELD = np.array([0.999, 0.001, 0.0])
"""The same where the train stands."""


@numba.njit(cache=True)
def _change_pace(row: Array, wander: float) -> None:
    """Let each pace pass to its neighbours, in place (P,); symmetric, so also backward."""
    before = row[0]
    for p in range(len(row)):
        here = row[p]
        up = row[p + 1] if p + 1 < len(row) else here
        down = before if p > 0 else here
        row[p] = here + wander * (up - here) + wander * (down - here)
        before = here


@numba.njit(cache=True)
def _forward_step(
    old: Array,
    new: Array,
    likely: Array,
    old_range: IntArray,
    new_range: IntArray,
    design: Array,
    row: Array,
    held: bool,
    steps: Array,
    wander: float,
    noise: float,
) -> float:
    """Fill ``new`` (P, n) from ``old``; return the expected distance of row and design."""
    P, n = new.shape
    first, stop = old_range[0], min(old_range[1] + 2, n)
    least = np.inf
    for j in range(first, stop):
        h = 0.0
        for c in range(len(row)):
            e = row[c] - design[j, c]
            h += e * e
        likely[j] = h
        least = min(least, h)
    total = fit = 0.0
    mixed = np.zeros((3, P))
    for j in range(first, stop):
        mixed[0] = mixed[1]
        mixed[1] = mixed[2]
        if j < old_range[1]:
            mixed[2] = old[:, j]
            _change_pace(mixed[2], wander)
        else:
            mixed[2] = 0.0
        h = likely[j]
        likely[j] = np.exp(-0.5 * (h - least) / noise) + 1e-12
        for p in range(P):
            s = HELD if held else steps[p]
            value = s[0] * mixed[2, p] + s[1] * mixed[1, p] + s[2] * mixed[0, p]
            if j == n - 1:
                value += (1.0 - s[0]) * mixed[2, p] + s[2] * mixed[1, p]
            new[p, j] = value * likely[j]
            total += new[p, j]
            fit += new[p, j] * h
    low, high = stop, first
    for j in range(first, stop):
        here = 0.0
        for p in range(P):
            new[p, j] /= total
            here += new[p, j]
        if here > NEGLIGIBLE:
            low, high = min(low, j), j + 1
    new_range[0], new_range[1] = low, high
    return fit / total


@numba.njit(cache=True)
def _look_back(
    forward: Array,
    likely: Array,
    held: NDArray[np.bool_],
    ranges: IntArray,
    now: int,
    lag: int,
    steps: Array,
    wander: float,
) -> tuple[Array, int]:
    size, P, n = forward.shape
    later_first, later_stop = ranges[now, 0], ranges[now, 1]
    later = np.ones((later_stop - later_first, P))
    slot = now
    for _ in range(lag):
        earlier_slot = (slot - 1) % size
        first, stop = ranges[earlier_slot, 0], ranges[earlier_slot, 1]
        earlier = np.zeros((stop - first, P))
        largest = 0.0
        for j in range(first, stop):
            for p in range(P):
                s = HELD if held[slot] else steps[p]
                value = 0.0
                for k in range(3):
                    q = min(j + k, n - 1)
                    if later_first <= q < later_stop:
                        value += s[k] * likely[slot, q] * later[q - later_first, p]
                earlier[j - first, p] = value
            _change_pace(earlier[j - first], wander)
            largest = max(largest, earlier[j - first].max())
        earlier /= max(largest, 1e-300)
        later, later_first, later_stop, slot = earlier, first, stop, earlier_slot
    out = np.empty(later_stop - later_first)
    for j in range(len(out)):
        out[j] = 0.0
        for p in range(P):
            out[j] += forward[slot, p, later_first + j] * later[j, p]
    return out / max(out.sum(), 1e-300), later_first

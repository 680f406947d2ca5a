"""
The place on the design ride as a hidden Markov chain, followed sample by sample.

An open-end time warping whose paths are summed instead of the best being kept: a state is a row of
the design and a pace, and each measured row moves on by none, one or two rows. So the answer comes
with its own probability, and looking back by a fixed lag needs no path. Only the rows that have
any probability are visited: few when the place is known, all when it is sought.

A pace is a speed against the design's, and a train that is faster is pressed harder into its
curves: what a row is expected to feel like depends on the pace as well.
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
UNLIKELIEST = 1e-12
"""Least likelihood of a row against the likeliest: nothing is impossible."""
RESCALED_AFTER = 8
"""Steps back in time before chances are scaled again: ``UNLIKELIEST`` to this power is a number."""


class Tracker:
    """
    Distribution over rows and paces, now and ``lag`` measured rows ago.

    Holds ``lag + 1`` rows of it; work per row is bounded by the design's length.
    """

    def __init__(self, design: Array, lag: int, noise: float, wander: float, jump: float) -> None:
        """
        Prepare for ``design`` (P, n, C): the features expected of its rows at each of ``PACES``.

        ``noise`` is the variance of a feature row's distance, ``wander`` the probability per row
        of changing to either neighbouring pace, ``jump`` that of staying or skipping a row more
        than the pace says.
        """
        self.design = np.ascontiguousarray(design)
        self.noise = noise
        self._wander = wander
        self._steps = _steps(jump)
        self._lag = lag
        n = design.shape[1]
        self._forward = np.zeros((lag + 1, len(PACES), n))
        self._likely = np.zeros((lag + 1, len(PACES), n))
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
def _change_pace(paces: Array, wander: float, out: Array) -> None:
    """Let each pace of (P, n) pass to its neighbours; symmetric, so also backward."""
    P, n = paces.shape
    for p in range(P):
        up, down = min(p + 1, P - 1), max(p - 1, 0)
        for j in range(n):
            here = paces[p, j]
            out[p, j] = here + wander * (paces[up, j] + paces[down, j] - 2.0 * here)


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
    first, last = old_range[0], old_range[1]
    stop = min(last + 2, n)
    width = stop - first
    # Views of the rows in reach: indices from nought are what the compiler makes fast.
    design, likely, new = design[:, first:stop], likely[:, first:stop], new[:, first:stop]
    distance = np.empty((P, width))
    for p in range(P):
        for j in range(width):
            h = 0.0
            for c in range(len(row)):
                e = row[c] - design[p, j, c]
                h += e * e
            distance[p, j] = h
    least = distance.min()
    for p in range(P):
        for j in range(width):
            likely[p, j] = np.exp(-0.5 * (distance[p, j] - least) / noise) + UNLIKELIEST
    # Two rows of nothing on either side: what is behind the first row and beyond the last.
    mixed = np.zeros((P, width + 2))
    _change_pace(old[:, first:last], wander, mixed[:, 2 : last - first + 2])
    total, fit = np.zeros(width), 0.0
    for p in range(P):
        stay, go, skip = HELD if held else steps[p]
        for j in range(width):
            new[p, j] = stay * mixed[p, j + 2] + go * mixed[p, j + 1] + skip * mixed[p, j]
        if stop == n:
            # Nothing goes beyond the design's end.
            new[p, width - 1] += (1.0 - stay) * mixed[p, width + 1] + skip * mixed[p, width]
        for j in range(width):
            new[p, j] *= likely[p, j]
            total[j] += new[p, j]
            fit += new[p, j] * distance[p, j]
    whole = total.sum()
    share = 1.0 / whole
    for p in range(P):
        for j in range(width):
            new[p, j] *= share
    low, high = width, 0
    for j in range(width):
        if total[j] > NEGLIGIBLE * whole:
            low, high = min(low, j), j + 1
    new_range[0], new_range[1] = first + low, first + high
    return fit / whole


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
    first, stop = ranges[now, 0], ranges[now, 1]
    later = np.ones((P, stop - first))
    slot = now
    for step in range(lag):
        before = (slot - 1) % size
        later_first, later_stop = first, stop
        first, stop = ranges[before, 0], ranges[before, 1]
        # Rows first..stop + 1 of what comes later, the last row of the design standing for all
        # beyond it.
        reached = np.zeros((P, stop - first + 2))
        low, high = max(first, later_first), max(min(stop + 2, later_stop), first)
        there = reached[:, low - first : high - first]
        come = later[:, low - later_first : high - later_first]
        chance = likely[slot, :, low:high]
        earlier = np.empty((P, stop - first))
        for p in range(P):
            for j in range(high - low):
                there[p, j] = chance[p, j] * come[p, j]
            for j in range(n, stop + 2):
                reached[p, j - first] = reached[p, n - 1 - first]
            stay, go, skip = HELD if held[slot] else steps[p]
            for j in range(stop - first):
                earlier[p, j] = (
                    stay * reached[p, j] + go * reached[p, j + 1] + skip * reached[p, j + 2]
                )
        later = np.empty((P, stop - first))
        _change_pace(earlier, wander, later)
        if step % RESCALED_AFTER == 0:
            later /= max(later.max(), 1e-300)
        slot = before
    out = np.zeros(stop - first)
    for p in range(P):
        for j in range(stop - first):
            out[j] += forward[slot, p, first + j] * later[p, j]
    return out / max(out.sum(), 1e-300), first

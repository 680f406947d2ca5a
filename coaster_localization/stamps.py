"""Which stamps of a stream may be believed."""

from __future__ import annotations

import math

GOOD, GAP, RESTART = 'good', 'gap', 'restart'
BELIEVED_AFTER = 5
"""Samples in a row that agree with each other before a jump of the clock is believed."""


class StampCheck:
    """
    Tells good stamps from stray ones, and gaps and restarts of the stream from both.

    A stamp that repeats, goes back or leaps ahead is refused; when the next few go on from it, the
    stream itself has leapt: ahead is a gap, back a restart (a recording played again).
    """

    def __init__(self, longest_step_s: float) -> None:
        """Take steps up to ``longest_step_s`` for granted."""
        self._longest = longest_step_s
        self.reset()

    def reset(self) -> None:
        """Forget the stream."""
        self._last = float('nan')
        self._stray = float('nan')
        self._strays = 0

    def __call__(self, time_s: float) -> str:
        """Return GOOD, GAP or RESTART for a stamp to use, else the reason for its refusal."""
        if not math.isfinite(time_s):
            return 'not_finite'
        if math.isnan(self._last) or 0.0 < time_s - self._last <= self._longest:
            self._last, self._strays = time_s, 0
            return GOOD
        if time_s == self._last:
            return 'repeated_time'
        goes_on = self._strays > 0 and 0.0 < time_s - self._stray <= self._longest
        self._strays = self._strays + 1 if goes_on else 1
        self._stray = time_s
        ahead = time_s > self._last
        if self._strays < BELIEVED_AFTER:
            return 'time_leap' if ahead else 'backward_time'
        self._last, self._strays = time_s, 0
        return GAP if ahead else RESTART

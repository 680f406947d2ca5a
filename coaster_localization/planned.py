"""The design ride as rows of features, and the recipe that makes features of rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coaster_localization.channels import UNITS
from coaster_localization.config import MatcherConfig
from coaster_localization.sensed import design_motion
from coaster_localization.ticks import FORCE, RATE, VERTICAL, LowPass
from coaster_localization.tracker import PACES
from track_localization import GRAVITY
from track_localization.estimation import so3
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

MULTI = (2, 1, 0, 6, 7, 8, 4, 5)
"""Columns of a row in ``multi``: forces z, y, x; the vertical; rates y, z."""
SETS = {'multi': (0, 1, 2, 3, 4, 5, 6, 7), 'no_vertical': (0, 1, 2, 6, 7), 'z': (0,)}
"""Of those, what is used: all, all without a known attitude, or the paper's z alone."""
WIDENED = np.array([1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0])
"""Live, the force along the track counts less: brakes and drives differ most between rides."""
PIECES = 8


class Features:
    """Causal channels of ticks: low-passed, their derivatives, whether the train stands."""

    def __init__(self, which: str, config: MatcherConfig) -> None:
        """Make features of the channels ``which``, a name of SETS."""
        used = list(SETS[which])
        self._columns = [MULTI[k] for k in used]
        self._units = (UNITS['multi'] * WIDENED)[used]
        self._low_pass = LowPass(config.online_rate_hz, config.online_low_pass_hz)
        self._gain = np.sqrt(config.derivative_weight) * config.online_rate_hz
        self._standing = config.standing_weight
        self._last: Array | None = None

    def __call__(self, rows: Array, standing: NDArray[np.bool_]) -> Array:
        """Return features (N, F) of ticks (N, 9+), going on from the last call."""
        smooth = self._low_pass(rows[:, self._columns] / self._units)
        n, channels = smooth.shape
        out = np.empty((n, 2 * channels + 1))
        out[:, :channels] = smooth
        out[0, channels:-1] = smooth[0] - (smooth[0] if self._last is None else self._last)
        out[1:, channels:-1] = smooth[1:] - smooth[:-1]
        out[:, channels:-1] *= self._gain
        out[:, -1] = self._standing * standing
        self._last = smooth[-1]
        return out


def _at_paces(rows: Array, standing: NDArray[np.bool_], which: str, config: MatcherConfig) -> Array:
    """
    Return the features (P, n, F) of design rows (n, 9) ridden at each pace.

    Rates grow with the speed, the force that turns the train with its square; what carries and
    what slows the train is taken to be the design's. A derivative has one power more.
    """
    turning = np.zeros_like(rows)
    turning[:, 1:3] = rows[:, 1:3] - GRAVITY * rows[:, 7:9]
    rates = np.zeros_like(rows)
    rates[:, RATE] = rows[:, RATE]
    fixed = Features(which, config)(rows - turning - rates, standing)
    nowhere = np.zeros_like(standing)
    turning, rates = (Features(which, config)(part, nowhere) for part in (turning, rates))
    derivative = np.zeros(fixed.shape[1])
    derivative[len(derivative) // 2 : -1] = 1.0
    paces = PACES[:, None, None]
    features: Array = paces**derivative * (fixed + paces * rates + paces**2 * turning)
    return features


class PlannedRows:
    """
    The design ride in ticks, from the rest before it to the rest after.

    Attributes:
        time_s: (n,) middle of each tick, design clock [s].
        chainage: (n,) [m].
        features: (P, n, F), expected at each of the tracker's paces.
        departure, arrival: the last row before the ride and the first after it.
    """

    def __init__(self, design: DesignRide, which: str, config: MatcherConfig) -> None:
        """Cut ``design`` into ticks and take the features ``which``."""
        motion = design_motion(design)
        step, rest = 1.0 / config.online_rate_hz, config.rest_s
        count = int(np.ceil((motion.end_s - motion.start_s + 2.0 * rest) / step))
        begin = motion.start_s - rest
        at = design.at(np.asarray(begin + (np.arange(count * PIECES) + 0.5) * (step / PIECES)))
        rows = np.empty((len(at), 9))
        rows[:, FORCE], rows[:, RATE] = at.specific_force, at.angular_rate
        rows[:, VERTICAL] = so3.matrix_from_quat(at.quaternion)[:, 2, :]
        self._fine = at
        rows = rows.reshape(count, PIECES, 9).mean(axis=1)
        self.time_s = begin + (np.arange(count) + 0.5) * step
        self.chainage = np.interp(self.time_s, design.time_s, design.chainage)
        standing = (self.time_s < motion.start_s) | (self.time_s > motion.end_s)
        self.features = _at_paces(rows, standing, which, config)
        self.departure = max(int(np.searchsorted(self.time_s, motion.start_s)) - 1, 0)
        self.arrival = min(int(np.searchsorted(self.time_s, motion.end_s)), count - 1)

    def place(self, time_s: float) -> tuple[Array, Array, float]:
        """Return position (3,), quaternion (4,) and chainage at a time of the design's clock."""
        fine = self._fine
        x = (time_s - fine.time_s[0]) / (fine.time_s[1] - fine.time_s[0])
        k = min(max(int(x), 0), len(fine) - 2)
        share = min(max(x - k, 0.0), 1.0)
        p, q, s = fine.position, fine.quaternion, fine.chainage
        sign = 1.0 if q[k] @ q[k + 1] >= 0.0 else -1.0
        between = (1.0 - share) * q[k] + share * sign * q[k + 1]
        return (
            p[k] + share * (p[k + 1] - p[k]),
            between / np.linalg.norm(between),
            float(s[k] + share * (s[k + 1] - s[k])),
        )

"""A line as a filter on chainage needs it: attitude, turning and gravity's share by chainage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.estimation import so3
from track_localization.track.centreline import Centreline

Array = NDArray[np.float64]

ATTITUDE, TURNING, TANGENT = slice(0, 9), slice(9, 12), slice(12, 15)
STRETCH, LEVER, CLIMB, SPEED, SPEED_SIGMA, SIGMA, RENEWAL = 15, 16, 17, 18, 19, 20, 21
BACK, BACK_SIGMA = 22, 23
WIDTH = 24
"""Columns of a row; see LineMap."""


class LineMap:
    """
    Rows of a line every ``step_m`` metres of chainage, for compiled filters.

    The vehicle's reference point draws the path p(s), its body keeps the attitude R(s). A row is:
    R (9, row by row), its turning rate (3, body axes) [rad/m], the path's tangent (3, body axes),
    |p'| (metres of path for a metre of chainage), p'' along the tangent [1/m], gravity along the
    tangent [m/s^2], the usual speed |ds/dt| and its standard deviation [m/s] (NaN: not known), the
    standard deviation of the attitude [rad], how fast a vehicle's deviation from the usual speed is
    renewed [1/m], and the usual speed of one that runs backward (negative) with its deviation.

    Attributes:
        rows: (M, 24).
        position: (M, 3) in ``map`` [m].
        step_m: between rows [m].
        length: of the line [m].
        closed: whether it is a circuit.
        line: the curve itself.
        passes: (K, 2) chainage [m] and its rate [m/s] of vehicles that may be met under way.
    """

    def __init__(self, line: Centreline, attitude_sigma: float, step_m: float = 0.1) -> None:
        """Tabulate ``line``; ``attitude_sigma`` [rad] is how far the built track may be off."""
        count = max(3, int(np.ceil(line.length / step_m)) + 1)
        s = np.linspace(0.0, line.length, count)
        self.line = line
        self.passes: Array = np.empty((0, 2))
        self.length, self.closed = float(line.length), bool(line.closed)
        self.step_m = float(s[1] - s[0])
        self.position = np.ascontiguousarray(line.position(s))
        R = line.attitude(s)
        slope, bend = line.slope(s), line.slope(s, 2)
        stretch = np.maximum(np.linalg.norm(slope, axis=1), 1e-3)
        tangent = slope / stretch[:, None]
        self.rows = np.full((count, WIDTH), np.nan)
        self.rows[:, ATTITUDE] = R.reshape(-1, 9)
        self.rows[:, TURNING] = line.curvature(s)
        self.rows[:, TANGENT] = np.einsum('nji,nj->ni', R, tangent)
        self.rows[:, STRETCH] = stretch
        self.rows[:, LEVER] = np.einsum('ni,ni->n', tangent, bend)
        self.rows[:, CLIMB] = GRAVITY * tangent[:, 2]
        self.rows[:, SIGMA] = attitude_sigma
        self.rows[:, RENEWAL] = 0.0

    @property
    def chainage(self) -> Array:
        """Chainage (M,) of the rows [m]."""
        return np.linspace(0.0, self.length, len(self.rows))

    def set_speed(self, speed: Array, sigma: Array, renewal: Array) -> None:
        """Set usual speed, its standard deviation [m/s] and its renewal [1/m], each (M,)."""
        self.rows[:, SPEED], self.rows[:, SPEED_SIGMA] = speed, sigma
        self.rows[:, RENEWAL] = renewal

    def set_speed_back(self, speed: Array, sigma: Array) -> None:
        """Set the usual speed of running backward, negative, and its deviation [m/s], (M,)."""
        self.rows[:, BACK], self.rows[:, BACK_SIGMA] = speed, sigma

    def turn(self, correction: Array) -> None:
        """
        Correct the attitude by rotation vectors (M, 3) in body axes [rad], learnt from rides.

        The body sits on its rails: the tangent turns with it, and gravity's share along the line.
        """
        change = so3.exp(correction)
        R = self.rows[:, ATTITUDE].reshape(-1, 3, 3) @ change
        self.rows[:, ATTITUDE] = R.reshape(-1, 9)
        turning = np.einsum('nji,nj->ni', change, self.rows[:, TURNING])
        self.rows[:, TURNING] = turning + np.gradient(correction, self.step_m, axis=0)
        self.rows[:, CLIMB] = GRAVITY * np.einsum('ni,ni->n', R[:, 2], self.rows[:, TANGENT])

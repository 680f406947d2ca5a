"""
How far a navigator is off at the end of windows in which it was deprived of its fixes.

Beside it, what needs no filter: dead reckoning by odometer and yaw gyro from the true start.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

Array = NDArray[np.float64]


class Way:
    """Where a vehicle truly was, between samples too: cubic, by position and velocity."""

    def __init__(self, time_s: Array, position: Array, velocity: Array, yaw: Array) -> None:
        """
        Make it.

        Args:
            time_s: (N,) increasing [s].
            position: (N, 3) east, north, up [m].
            velocity: (N, 3) [m/s].
            yaw: (N,) of the vehicle from east, anticlockwise, without jumps [rad].
        """
        self.time_s, self._yaw = time_s, yaw
        self._spline = CubicHermiteSpline(time_s, position, velocity)

    def position(self, time_s: Array) -> Array:
        """Return the positions (N, 3) at times (N,)."""
        place: Array = self._spline(time_s)
        return place

    def yaw(self, time_s: Array) -> Array:
        """Return the yaws (N,) at times (N,) [rad]."""
        return np.interp(time_s, self.time_s, self._yaw)


@dataclasses.dataclass(frozen=True)
class Ends:
    """
    Errors at the ends of windows of one length.

    Attributes:
        begin_s: (N,) where the windows begin [s].
        along: (N,) error in the vehicle's own direction [m].
        cross: (N,) to its left [m].
        sigma: (N,) claimed, root of the horizontal variances' sum [m]; NaN where none is.
        nees: (N,) of the horizontal error, 2 on average where the claim is honest.
    """

    begin_s: Array
    along: Array
    cross: Array
    sigma: Array
    nees: Array

    @property
    def horizontal(self) -> Array:
        """Horizontal error (N,) [m]."""
        return np.hypot(self.along, self.cross)


def end_errors(
    begin_s: Array, end_s: Array, position: Array, covariance: Array | None, way: Way
) -> Ends:
    """
    Return the errors of positions (N, 2) or (N, 3) at ``end_s`` (N,).

    ``covariance`` (N, 2, 2) is what the navigator claims of east and north; None: nothing.
    """
    error = position[:, :2] - way.position(end_s)[:, :2]
    yaw = way.yaw(end_s)
    along = error[:, 0] * np.cos(yaw) + error[:, 1] * np.sin(yaw)
    cross = error[:, 1] * np.cos(yaw) - error[:, 0] * np.sin(yaw)
    sigma = nees = np.full(len(begin_s), np.nan)
    if covariance is not None:
        sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
        nees = np.einsum('ij,ij->i', error, np.linalg.solve(covariance, error[..., None])[..., 0])
    return Ends(begin_s, along, cross, sigma, nees)


def figures(ends: Ends) -> dict[str, float]:
    """
    Return what a table shows: lengths in metres.

    ``error/sigma`` is the root of the mean NEES over 2: 1 where the claim is honest, more where
    it is too small. ``in 2 sigma`` is the share of windows whose NEES is below the chi-square
    bound of 95.4 %, which for two dimensions is 6.18.
    """
    error = ends.horizontal
    return {
        'windows': len(error),
        'median': float(np.median(error)),
        '95 %': float(np.percentile(error, 95.0)),
        'max': float(error.max()),
        'along, median': float(np.median(np.abs(ends.along))),
        'cross, median': float(np.median(np.abs(ends.cross))),
        'error/sigma': float(np.sqrt(0.5 * ends.nees.mean())),
        'in 2 sigma': float(np.mean(ends.nees < 6.18)) if np.isfinite(ends.nees).all() else np.nan,
    }


def dead_reckoned(
    begin_s: Array,
    length_s: float,
    way: Way,
    gyro: tuple[Array, Array],
    odometer: tuple[Array, Array],
) -> Array:
    """
    Return positions (N, 2) where odometer and yaw gyro alone end, from the true pose at the start.

    Args:
        begin_s: (N,) starts [s].
        length_s: time from there [s].
        way: the truth.
        gyro: stamps (M,) and yaw rates (M,) [rad/s].
        odometer: stamps (K,) and speeds (K,) [m/s].
    """
    elapsed = np.concatenate([[0.0], np.cumsum(np.diff(gyro[0]) * gyro[1][1:])])
    ends = np.empty((len(begin_s), 2))
    for k, begin in enumerate(begin_s):
        t = np.linspace(begin, begin + length_s, round(length_s * 10.0) + 1)
        middle = 0.5 * (t[1:] + t[:-1])
        turned = np.interp(middle, gyro[0], elapsed) - np.interp(begin, gyro[0], elapsed)
        yaw = way.yaw(np.array([begin]))[0] + turned
        run = np.interp(middle, *odometer) * np.diff(t)
        moved = np.array([run @ np.cos(yaw), run @ np.sin(yaw)])
        ends[k] = way.position(np.array([begin]))[0, :2] + moved
    return ends

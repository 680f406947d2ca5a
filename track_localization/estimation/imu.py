"""A recorded stretch of IMU samples, and one sample of it."""

from __future__ import annotations

import dataclasses
from bisect import bisect_left
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ImuSample(NamedTuple):
    """One sample: stamp [s], specific force (3,) [m/s^2] and angular rate (3,) [rad/s]."""

    time_s: float
    specific_force: Array
    angular_rate: Array


@numba.njit(cache=True)
def largest_part(v: Array) -> float:
    """Return the largest magnitude in a vector (3,), NaN where a part of it is not finite."""
    largest = 0.0
    for part in v:
        if not np.isfinite(part):
            return np.nan
        largest = max(largest, abs(part))
    return largest


@dataclasses.dataclass(frozen=True)
class ImuSeries:
    """
    IMU samples in the order they were taken.

    Attributes:
        time_s: (N,) header stamps [s]. Strictly increasing once ``clean`` has passed.
        specific_force: (N, 3) in the sensor's axes [m/s^2], +9.81 on z at rest.
        angular_rate: (N, 3) in the sensor's axes [rad/s]; NaN where there is no gyro.
    """

    time_s: Array
    specific_force: Array
    angular_rate: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, index: slice | NDArray[np.bool_] | NDArray[np.int64]) -> ImuSeries:
        return ImuSeries(self.time_s[index], self.specific_force[index], self.angular_rate[index])

    def sample(self, i: int) -> ImuSample:
        """Return sample ``i``."""
        return ImuSample(float(self.time_s[i]), self.specific_force[i], self.angular_rate[i])

    @property
    def rate_hz(self) -> float:
        """Median sampling rate [Hz]; NaN for fewer than two samples."""
        if len(self) < 2:
            return float('nan')
        return float(1.0 / np.median(np.diff(self.time_s)))

    @property
    def has_gyro(self) -> bool:
        """Whether the angular rate was measured at all."""
        return bool(np.isfinite(self.angular_rate).any())


def clean(series: ImuSeries) -> tuple[ImuSeries, dict[str, int]]:
    """
    Drop samples that cannot be used, and count them by reason.

    Reasons: ``not_finite`` (a stamp or force that is NaN or infinite, or a rate where others have
    one), ``repeated_time``, ``backward_time`` (not later than the latest kept stamp). Where that
    rule would cost more than a tenth of the recording (one stamp years ahead, a clock that starts
    over), as few samples as possible are dropped instead, and counted as ``time_jump``.
    """
    finite = np.isfinite(series.time_s) & np.isfinite(series.specific_force).all(axis=1)
    if series.has_gyro:
        finite &= np.isfinite(series.angular_rate).all(axis=1)
    kept = series[finite]
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], kept.time_s]))[:-1]
    repeated, backward = kept.time_s == latest, kept.time_s < latest
    counts = {'not_finite': int((~finite).sum())}
    if (repeated | backward).sum() > 0.1 * len(kept):
        keep = _longest_increasing(kept.time_s)
        counts['time_jump'] = int((~keep).sum())
    else:
        keep = ~(repeated | backward)
        counts['repeated_time'], counts['backward_time'] = int(repeated.sum()), int(backward.sum())
    return kept[keep], {reason: n for reason, n in counts.items() if n}


def _longest_increasing(values: Array) -> NDArray[np.bool_]:
    """Return a mask (N,) of a longest strictly increasing subsequence (patience sorting)."""
    tails: list[float] = []
    ends: list[int] = []
    before = np.full(len(values), -1)
    for i, value in enumerate(values.tolist()):
        pile = bisect_left(tails, value)
        before[i] = ends[pile - 1] if pile else -1
        tails[pile : pile + 1] = [value]
        ends[pile : pile + 1] = [i]
    mask = np.zeros(len(values), dtype=bool)
    i = ends[-1] if ends else -1
    while i >= 0:
        mask[i] = True
        i = int(before[i])
    return mask

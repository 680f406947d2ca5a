"""A recorded stretch of IMU samples, and one sample of it."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ImuSample(NamedTuple):
    """One sample: stamp [s], specific force (3,) [m/s^2] and angular rate (3,) [rad/s]."""

    time_s: float
    specific_force: Array
    angular_rate: Array


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
    one), ``repeated_time``, ``backward_time`` (not later than the latest kept stamp). The first
    sample kept is the first finite one.
    """
    finite = np.isfinite(series.time_s) & np.isfinite(series.specific_force).all(axis=1)
    if series.has_gyro:
        finite &= np.isfinite(series.angular_rate).all(axis=1)
    kept = series[finite]
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], kept.time_s]))[:-1]
    repeated, backward = kept.time_s == latest, kept.time_s < latest
    counts = {
        'not_finite': int((~finite).sum()),
        'repeated_time': int(repeated.sum()),
        'backward_time': int(backward.sum()),
    }
    return kept[~(repeated | backward)], {k: n for k, n in counts.items() if n}

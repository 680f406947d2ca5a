"""``paper`` as it is: measurements in the order of their stamps, what comes late is refused."""

from __future__ import annotations

import math

from maglev_localization.config import MaglevConfig
from maglev_localization.estimate import Estimate
from maglev_localization.health import SensorHealth
from maglev_localization.measurements import Measurement, sensor_of
from maglev_localization.paper_filter import PaperFilter
from track_localization.estimation.gating import Rejections
from track_localization.track.balise_table import BaliseTable


class InOrderCore:
    """
    The paper's filter and its start.

    Attributes:
        rejections: refused measurements by sensor and reason.
        health: of the sensors.
    """

    def __init__(self, config: MaglevConfig, balises: BaliseTable, length: float) -> None:
        self._filter = PaperFilter(config, balises)
        self.health = SensorHealth()
        self._told: tuple[float, float] | None = None

    @property
    def rejections(self) -> Rejections:
        """Refused measurements by sensor and reason."""
        return self._filter.rejections

    @property
    def started(self) -> bool:
        """Whether the filter runs."""
        return self._filter.started

    def set_start(self, chainage: float, variance: float) -> None:
        """Start at the next measurement, from a chainage [m] and its variance [m^2]."""
        self._told = (chainage, variance)

    def after_gap(self, gap_s: float) -> None:
        """Go on: the paper's filter knows no gaps."""

    def take(self, measurement: Measurement) -> Estimate | None:
        """Take a measurement; return the estimate that it makes, if it makes one."""
        sensor, time_s = sensor_of(measurement), measurement.time_s
        if self._told is not None:
            chainage, variance = self._told
            self._told = None
            speed = float(self._filter.mean[1]) if self.started else 0.0
            self._filter.set_start(time_s, chainage, variance, speed)
        before = self._filter.rejections.total(sensor)
        estimate = self._filter.step(measurement)
        refused = self._filter.rejections.total(sensor) > before
        self.health.heard(sensor, time_s, refused, math.nan)
        if estimate is not None:
            self.health.judge(estimate.time_s, 0.0)
        return estimate

    def figures(self) -> dict[str, float | str]:
        """Return what diagnostics should tell of the filter itself."""
        return {f'n_eff.{name}': round(n, 1) for name, n in self._filter.n_eff.items()}

"""The maglev's estimator as a plain object: measurements in as they arrive, estimates out."""

from __future__ import annotations

import math

from maglev_localization.config import MaglevConfig
from maglev_localization.estimate import Estimate
from maglev_localization.health import ISOLATED, SILENT
from maglev_localization.in_order import InOrderCore
from maglev_localization.measurements import Measurement, sensor_of
from maglev_localization.plausible import believed, problem
from maglev_localization.replaying import ReplayingCore
from track_localization.estimation.gating import Rejections
from track_localization.estimation.stamps import Stamps
from track_localization.track.balise_table import BaliseTable

BEYOND_M = 1000.0
"""How far the line goes on behind the last balise, where its length is not told [m]."""

JUMP_S = 5.0
"""A stamp so far ahead is believed when the next confirms it [s]."""
RESTART_S = 5.0
"""Stamps that stay behind for so long are those of a recording that starts over [s]."""


class MaglevPipeline:
    """
    The method that ``config`` names, driven by stamps only.

    Nothing that is pushed can raise: what cannot be used is counted with the reason.
    """

    def __init__(
        self, config: MaglevConfig, balises: BaliseTable, line_length_m: float = 0.0
    ) -> None:
        """
        Make it for a line.

        Args:
            config: every setting.
            balises: the surveyed table; without rows nothing resolves an unknown start.
            line_length_m: of the line [m]; 0 takes it to end a kilometre behind the last balise.
        """
        self._config, self._balises = config, balises
        last = float(balises.chainage[-1]) if len(balises) else 0.0
        self._length = line_length_m if line_length_m > 0.0 else last + BEYOND_M
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next measurement starts anew."""
        self._stamps = Stamps(self._config.horizon_s, jump_s=JUMP_S, restart_s=RESTART_S)
        self._unusable = Rejections()
        self._latest: Estimate | None = None
        self._core = self._make_core()

    def _make_core(self) -> InOrderCore | ReplayingCore:
        make = InOrderCore if self._config.method == 'paper' else ReplayingCore
        return make(self._config, self._balises, self._length)

    def _start_over(self) -> None:
        """Start anew, and go on counting."""
        before, self._core = self._core, self._make_core()
        self._core.health.changes.extend(before.health.changes)
        for sensor, reasons in before.rejections.as_dict().items():
            for reason, count in reasons.items():
                self._unusable.add(sensor, reason, count)

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """Refused measurements: sensor -> reason -> count."""
        out = self._unusable.as_dict()
        for sensor, reasons in self._core.rejections.as_dict().items():
            kept = out.setdefault(sensor, {})
            for reason, count in reasons.items():
                kept[reason] = kept.get(reason, 0) + count
        return out

    def set_start(self, chainage: float, variance: float) -> str | None:
        """Say where the train is [m], known to ``variance`` [m^2]; return why not, or None."""
        if not (math.isfinite(chainage) and math.isfinite(variance)):
            return 'not_finite'
        if variance <= 0.0:
            return 'bad_variance'
        if not -BEYOND_M <= chainage <= self._length + BEYOND_M:
            return 'off_the_line'
        self._core.set_start(chainage, min(variance, self._length**2))
        return None

    def push(self, measurement: Measurement) -> list[Estimate]:
        """Take a measurement; return the estimates that it makes possible, at most one."""
        sensor = sensor_of(measurement)
        reason = problem(measurement) or self._stamps.refuse(sensor, measurement.time_s)
        if reason is not None:
            self._unusable.add(sensor, reason)
            return []
        if self._stamps.restarted:
            self._start_over()
        if self._stamps.gap_s > 0.0:
            self._core.after_gap(self._stamps.gap_s)
        estimate = self._core.take(believed(measurement))
        if estimate is None:
            return []
        self._latest = estimate
        return [estimate]

    def health(self) -> dict[str, str]:
        """Return the state of each sensor: waiting, ok, silent or isolated."""
        return dict(self._core.health.states)

    def health_changes(self) -> list[tuple[float, str, str]]:
        """Return (stamp [s], sensor, new state) of every change, oldest first."""
        return list(self._core.health.changes)

    def diagnostics(self) -> dict[str, float | str]:
        """Return what a user wants to see of the filter's state."""
        out: dict[str, float | str] = {'method': self._config.method, 'status': self._status()}
        if self._latest is not None:
            out |= {
                'chainage_m': round(self._latest.chainage, 3),
                'sigma_along_m': round(self._latest.sigma_along, 4),
                'speed_mps': round(self._latest.speed, 3),
            }
        for sensor, state in self.health().items():
            out[f'health.{sensor}'] = state
            nis = self._core.health.nis[sensor]
            if math.isfinite(nis):
                out[f'nis.{sensor}'] = round(nis, 3)
        return out | self._core.figures()

    def _status(self) -> str:
        """Return what is wrong, '' when nothing is."""
        if not self._core.started:
            return 'waiting for a start'
        states = self.health().items()
        return ', '.join(f'{s} {state}' for s, state in states if state in (SILENT, ISOLATED))

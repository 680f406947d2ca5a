"""
The paper's federated particle filter, its equations by number (paper 2).

Two local particle filters, one fed by the loop, one by the radar, hold the state (chainage, speed,
acceleration) each. A master shares its information among them, fuses what they make of their
measurements, eq. (8), gives the outcome back to both, and takes balises itself.

The transition printed in eq. (3) is that of eq. (2)'s derivative and stops the train in three
steps; the one of constant acceleration stands here. The paper samples once a second; at other
intervals T the jerk W keeps its intensity: Q = (0.001 / T) G G', which at T = 1 s is the paper's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_localization.config import MaglevConfig
from maglev_localization.estimate import Estimate
from maglev_localization.measurements import (
    BALISE,
    LOOP,
    RADAR,
    BalisePassing,
    LoopPosition,
    Measurement,
    sensor_of,
)
from maglev_localization.paper_kernels import ALL, MEAN, NOTHING
from maglev_localization.paper_locals import LocalFilters
from maglev_localization.paper_start import Begin, Start
from track_localization.errors import DataError
from track_localization.estimation.gating import Rejections
from track_localization.track.balise_table import BaliseTable

Array = NDArray[np.float64]

LOCALS = (LOOP, RADAR)
"""Local filters in order; what each measures is the state of the same index."""

START_ACCELERATION_SIGMA = 1.0
"""What a train may accelerate with when the filter starts [m/s^2]."""

LEAST_PARTICLES = 50


class PaperFilter:
    """
    The paper's filter on a stream of measurements in the order of their stamps.

    ``step`` gives an estimate at every radar measurement and every balise. At one stamp balises go
    first, then the loop, then the radar: both locals are corrected before anything is fed back.

    Nothing is gated, as in the paper. Where a measurement is so far off that too few particles tell
    the posterior, its local filter goes on from that of a Kalman filter.

    Attributes:
        rejections: refused measurements by sensor and reason.
    """

    def __init__(self, config: MaglevConfig, balises: BaliseTable) -> None:
        if config.particles < LEAST_PARTICLES:
            raise DataError(
                f'setting particles: {config.particles} are too few for the method paper; '
                f'give it {LEAST_PARTICLES} at least'
            )
        self._config, self._paper, self._balises = config, config.paper, balises
        self._given = ALL if config.paper.feedback == 'mean_covariance' else MEAN
        self._variance = (config.paper.loop_variance, config.paper.radar_variance)
        rng = np.random.default_rng(config.seed)
        self._locals = LocalFilters(config.particles, config.paper.resampling, rng)
        self._start = Start(config)
        self._time_s: float | None = None
        self._mean, self._covariance = np.zeros(3), np.zeros((3, 3))
        self._to_fuse = self._to_give = self._moved = False
        self._counter_zero, self._counter_unset = 0.0, False
        self.rejections = Rejections()

    @property
    def started(self) -> bool:
        """Whether there is an estimate."""
        return self._time_s is not None

    @property
    def mean(self) -> Array:
        """The master's chainage, speed, acceleration (3,) [m, m/s, m/s^2]."""
        self._fuse()
        return self._mean.copy()

    @property
    def covariance(self) -> Array:
        """Covariance (3, 3) of the mean."""
        self._fuse()
        return self._covariance.copy()

    @property
    def n_eff(self) -> dict[str, float]:
        """Effective number of particles of each local filter after its last measurement."""
        return dict(zip(LOCALS, self._locals.n_eff, strict=True))

    def set_start(
        self,
        time_s: float,
        chainage: float,
        variance: float,
        speed: float = 0.0,
        speed_variance: float | None = None,
    ) -> None:
        """
        Begin anew at ``time_s`` [s] from a chainage [m], variance [m^2] and speed [m/s].

        Where a balise sets the loop counter (``paper.balise`` rezero), so does this.
        """
        set_counter = self._paper.balise == 'rezero'
        self._begin(Begin(time_s, chainage, variance, speed, set_counter), speed_variance)

    def step(self, measurement: Measurement) -> Estimate | None:
        """Take the next measurement; return the estimate that it makes, if it makes one."""
        if self._time_s is not None and measurement.time_s < self._time_s:
            self.rejections.add(sensor_of(measurement), 'backward_time')
            return None
        if isinstance(measurement, BalisePassing):
            return self._take_balise(measurement)
        if not self.started:
            return self._try_to_begin(self._start.take(measurement))
        self._advance(measurement.time_s)
        if isinstance(measurement, LoopPosition):
            if self._counter_unset:
                self._counter_zero = float(self._mean[0]) - measurement.reading
                self._counter_unset = False
            self._correct(0, measurement.reading + self._counter_zero)
            return None
        self._correct(1, measurement.speed)
        return self._estimate()

    def _take_balise(self, measurement: BalisePassing) -> Estimate | None:
        """Let a balise move the master, and give that back to both locals."""
        row = self._balises.index(measurement.balise)
        if row is None:
            self.rejections.add(BALISE, 'unknown_id')
            return None
        chainage = float(self._balises.chainage[row]) + measurement.offset
        variance = float(self._balises.sigma[row]) ** 2 + measurement.variance
        if not self.started:
            return self._try_to_begin(self._start.take_balise(measurement, chainage))
        self._advance(measurement.time_s)
        self._fuse()
        if self._paper.balise == 'rezero':
            self._mean[0] = chainage
            self._covariance[0] = self._covariance[:, 0] = 0.0
            self._covariance[0, 0] = variance
            self._counter_unset = True
        else:
            gain = self._covariance[:, 0] / (self._covariance[0, 0] + variance)
            self._mean += gain * (chainage - self._mean[0])
            self._covariance -= np.outer(gain, self._covariance[0])
        self._to_give = self._moved = True
        return self._estimate()

    def _try_to_begin(self, begin: Begin | None) -> Estimate | None:
        if begin is None:
            return None
        self._begin(begin, None)
        return self._estimate()

    def _begin(self, begin: Begin, speed_variance: float | None) -> None:
        if speed_variance is None:
            speed_variance = self._config.motion.start_speed_sigma_mps**2
        # A number known exactly would leave nothing to draw particles from.
        spread = (max(begin.variance, 1e-6), max(speed_variance, 1e-6), START_ACCELERATION_SIGMA**2)
        self._time_s = begin.time_s
        self._mean, self._covariance = np.array([begin.chainage, begin.speed, 0.0]), np.diag(spread)
        self._counter_unset = begin.set_counter
        self._draw()

    def _shares(self) -> Array:
        """Return the locals' shares of information (2,), which sum to one."""
        slow = self._mean[1] < self._paper.share_speed_mps
        loop = self._paper.share_slow if slow else self._paper.share_fast
        return np.array([loop, 1.0 - loop])

    def _advance(self, time_s: float) -> None:
        """Feed the fusion back, then carry master and locals to ``time_s``; eq. (3)."""
        assert self._time_s is not None
        T = time_s - self._time_s
        if T <= 0.0 and not self._moved:
            return
        self._fuse()
        given = self._given if self._to_give else NOTHING
        variance = self._paper.process_variance / T if T > 0.0 else 0.0
        self._locals.advance(self._mean, self._covariance, self._shares(), given, T, variance)
        self._time_s, self._to_give, self._moved = time_s, False, False

    def _correct(self, local: int, z: float) -> None:
        """Let a local filter take its measurement."""
        self._locals.correct(local, z, self._variance[local])
        self._to_fuse = True

    def _fuse(self) -> None:
        """Add the information of both locals, eq. (8), if that is due."""
        if not self._to_fuse:
            return
        self._to_fuse = False
        mean, P, regular = self._locals.fused()
        if regular:
            self._mean, self._covariance, self._to_give = mean, P, True
        else:
            self._draw()

    def _draw(self) -> None:
        """Draw both locals around the master's estimate."""
        self._locals.draw(self._mean, self._covariance, self._shares())
        self._to_fuse = self._to_give = self._moved = False

    def _estimate(self) -> Estimate:
        assert self._time_s is not None
        return Estimate(self._time_s, self.mean, self.covariance)

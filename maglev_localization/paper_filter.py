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

from maglev_localization import paper_kernels as kernels
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
from maglev_localization.paper_start import Begin, Start
from track_localization.errors import DataError
from track_localization.estimation import particles
from track_localization.estimation.cholesky import lower_root
from track_localization.estimation.federated import fuse_information
from track_localization.estimation.gating import Rejections
from track_localization.track.balise_table import BaliseTable

Array = NDArray[np.float64]

LOCALS = (LOOP, RADAR)
"""Local filters in order; what each measures is the state of the same index."""

START_ACCELERATION_SIGMA = 1.0
"""What a train may accelerate with when the filter starts [m/s^2]."""

LEAST_PARTICLES = 20
LEAST_EFFECTIVE = 4.0
"""Effective particles that a covariance of three states takes; fewer do not tell a posterior."""

GATE = 16.0
"""Squared innovation against its variance beyond which a measurement is refused then."""

REFUSED_S = 5.0
"""A sensor that nothing explains for so long is believed: the filter has lost it [s]."""


class PaperFilter:
    """
    The paper's filter on a stream of measurements in the order of their stamps.

    ``step`` gives an estimate at every radar measurement and every balise. At one stamp balises go
    first, then the loop, then the radar: both locals are then corrected before they are fed back.

    A measurement that leaves fewer than four effective particles is refused and counted (gate);
    after five seconds of it the sensor is believed and the particles are drawn around what it says.

    Attributes:
        mean: (3,) the master's chainage, speed, acceleration [m, m/s, m/s^2].
        covariance: (3, 3) of the mean.
        rejections: refused measurements by sensor and reason.
    """

    def __init__(self, config: MaglevConfig, balises: BaliseTable) -> None:
        count = config.particles
        if count < LEAST_PARTICLES:
            raise DataError(
                f'setting particles: {count} are too few for the method paper; '
                f'give it {LEAST_PARTICLES} at least'
            )
        self._config, self._paper, self._balises = config, config.paper, balises
        self._rng = np.random.default_rng(config.seed)
        self._resample = particles.RESAMPLING[config.paper.resampling]
        self._variance = (config.paper.loop_variance, config.paper.radar_variance)
        self._start = Start(config)
        self._time_s: float | None = None
        self._clouds, self._log_w = np.zeros((2, 3, count)), np.zeros((2, count))
        self._w, self._spare = np.zeros((2, count)), np.zeros((3, count))
        self._means, self._covariances = np.zeros((2, 3)), np.zeros((2, 3, 3))
        self._n_eff = [float(count)] * 2
        self._fused, self._moved, self._degenerate = False, False, [False, False]
        self._refused_since: list[float | None] = [None, None]
        self._counter_zero, self._counter_unset = 0.0, False
        self.mean, self.covariance = np.zeros(3), np.zeros((3, 3))
        self.rejections = Rejections()

    @property
    def started(self) -> bool:
        """Whether there is an estimate."""
        return self._time_s is not None

    @property
    def n_eff(self) -> dict[str, float]:
        """Effective number of particles of each local filter."""
        return dict(zip(LOCALS, self._n_eff, strict=True))

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
                self._counter_zero = float(self.mean[0]) - measurement.reading
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
        if self._paper.balise == 'rezero':
            self._replace(0, chainage, variance)
            self._counter_unset = True
        else:
            gain = self.covariance[:, 0] / (self.covariance[0, 0] + variance)
            self.covariance = self.covariance - np.outer(gain, self.covariance[0])
            self.mean = self.mean + gain * (chainage - self.mean[0])
        self._fused = self._moved = True
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
        self.mean, self.covariance = np.array([begin.chainage, begin.speed, 0.0]), np.diag(spread)
        self._refused_since = [None, None]
        self._counter_unset = begin.set_counter
        self._draw()

    def _shares(self) -> Array:
        """Return the locals' shares of information (2,), which sum to one."""
        slow = self.mean[1] < self._paper.share_speed_mps
        loop = self._paper.share_slow if slow else self._paper.share_fast
        return np.array([loop, 1.0 - loop])

    def _advance(self, time_s: float) -> None:
        """Feed the fusion back, then carry master and locals to ``time_s``; eq. (3)."""
        if self._time_s is None or (time_s <= self._time_s and not self._moved):
            return
        T = time_s - self._time_s
        variance, shares = self._paper.process_variance / max(T, 1e-9), self._shares()
        targets, roots = self._feedback(shares)
        kernels.advance(
            self._clouds,
            self._w,
            self._means,
            self._covariances,
            targets,
            roots,
            T,
            np.sqrt(variance / shares),
            self._rng,
        )
        self.mean, self.covariance = kernels.predict(self.mean, self.covariance, T, variance)
        self._time_s, self._fused, self._moved = time_s, False, False

    def _feedback(self, shares: Array) -> tuple[Array, Array]:
        """Return where each cloud goes, (2, 3), and what widens or narrows it, (2, 3, 3)."""
        roots = np.tile(np.eye(3), (2, 1, 1))
        if not self._fused:
            return self._means.copy(), roots
        for i in range(2):
            if self._degenerate[i]:
                self._draw_anew(i)
        whole = self._paper.feedback == 'mean_covariance'
        if not kernels.feedback(self._covariances, self.covariance, shares, whole, roots):
            self._draw()
            return self._means.copy(), np.tile(np.eye(3), (2, 1, 1))
        return np.stack([self.mean, self.mean]), roots

    def _correct(self, local: int, z: float) -> None:
        """Weigh a local's particles by its measurement, eqs (5) and (7), and fuse both."""
        cloud, (log_w, w, _) = self._clouds[local], self._spare
        mean, P = np.empty(3), np.empty((3, 3))
        kernels.weigh(cloud[local], self._log_w[local], z, self._variance[local], log_w)
        np.exp(log_w, out=w)
        total, squares = kernels.measure(cloud, w, self._means[local], mean, P)
        n_eff = self._n_eff[local] = total * total / squares if squares > 0.0 else 0.0
        if n_eff >= LEAST_EFFECTIVE:
            kernels.settle(log_w, w, total, self._log_w[local], self._w[local])
            self._means[local], self._covariances[local] = mean, P
            self._degenerate[local] = n_eff < 0.5 * len(w)
        elif not self._rescue(local, z):
            self._refuse(local, z)
            return
        self._refused_since[local] = None
        self._fuse()

    def _rescue(self, local: int, z: float) -> bool:
        """Draw a local's particles where a measurement says that they should be, if it may be."""
        mean, P = self._means[local], self._covariances[local]
        nu, S = z - mean[local], P[local, local] + self._variance[local]
        if nu * nu > GATE * S:
            return False
        gain = P[:, local] / S
        self._draw_local(local, mean + gain * nu, P - np.outer(gain, P[local]))
        return True

    def _refuse(self, local: int, z: float) -> None:
        """Count a measurement that no particle explains; believe it in the end."""
        self.rejections.add(LOCALS[local], 'gate')
        now = self._estimate().time_s
        since = self._refused_since[local]
        self._refused_since[local] = now if since is None else since
        if since is not None and now - since >= REFUSED_S:
            self._refused_since[local] = None
            self._replace(local, z, self._variance[local])
            self._draw()

    def _fuse(self) -> None:
        """Add the information of both locals, eq. (8)."""
        mean, P, regular = fuse_information(self._means, self._covariances)
        if not regular:
            self._draw()
            return
        self.mean, self.covariance = mean, P
        self._fused = True

    def _draw_anew(self, local: int) -> None:
        """Resample a local's particles, unless too few different ones would be left."""
        self._degenerate[local] = False
        count = self._clouds.shape[2]
        w, mean, P = np.full(count, 1.0 / count), np.empty(3), np.empty((3, 3))
        kernels.pick(self._clouds[local], self._resample(self._w[local], self._rng), self._spare)
        kernels.measure(self._spare, w, self._means[local], mean, P)
        if lower_root(P)[1]:
            self._clouds[local], self._w[local], self._log_w[local] = self._spare, w, np.log(w[0])
            self._means[local], self._covariances[local] = mean, P

    def _draw(self) -> None:
        """Draw both locals around the master's estimate."""
        for i, beta in enumerate(self._shares()):
            self._draw_local(i, self.mean, self.covariance / beta)
        self._fused = self._moved = False

    def _draw_local(self, local: int, mean: Array, P: Array) -> None:
        """Draw a local's particles from a normal distribution."""
        count = self._clouds.shape[2]
        L, _ = lower_root(P)
        self._clouds[local] = mean[:, None] + L @ self._rng.standard_normal((3, count))
        self._w[local], self._log_w[local] = 1.0 / count, -np.log(count)
        self._n_eff[local], self._degenerate[local] = float(count), False
        kernels.measure(
            self._clouds[local], self._w[local], mean, self._means[local], self._covariances[local]
        )

    def _replace(self, state: int, value: float, variance: float) -> None:
        """Let the master know one state anew, whatever it held before."""
        self.mean = self.mean.copy()
        self.mean[state] = value
        self.covariance = self.covariance.copy()
        self.covariance[state] = self.covariance[:, state] = 0.0
        self.covariance[state, state] = variance

    def _estimate(self) -> Estimate:
        assert self._time_s is not None
        return Estimate(self._time_s, self.mean.copy(), self.covariance.copy())

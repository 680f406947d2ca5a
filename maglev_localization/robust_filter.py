"""The federated particle filter made good: a bank of hypotheses, each with two local filters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_localization import bank, counting, hearing, passing, standing
from maglev_localization.config import MaglevConfig
from maglev_localization.counting import START_MPS, START_MPS2, Counting
from maglev_localization.estimate import Estimate
from maglev_localization.line_kernels import SIZE, A, B, C, K, Noise, S, V
from maglev_localization.measurements import BalisePassing, LoopPosition, Measurement, RadarSpeed
from track_localization.track.balise_table import BaliseTable

Array = NDArray[np.float64]

CYCLE_S = 0.05
"""The local filters are fused at the radar's stamps; twice this after the last without one [s]."""
STILL_SIGMA_MPS2 = 0.2
"""Acceleration of a train that stands [m/s^2]: it may be about to leave."""


EXTRA_SHARE = 0.25
"""Crossings counted twice, for each that is missed."""
SHARE_CROSSINGS = 30000.0
"""Over so many crossings the share of those missed is learnt."""


class Bank(NamedTuple):
    """
    What the filter knows; never changed in place, so that a history can go back to it.

    Attributes:
        log_w: (n,) weights of the hypotheses.
        x: (n, 2, 6) means of the local filters; see ``line_kernels``.
        P: (n, 2, 6, 6) covariances.
        loop_s: stamp of the loop's local filters [s].
        fused_s: stamp of the radar's, and of the last fusion [s].
        memory: of readings.
        says: what the likeliest hypothesis says of the newest measurement (``hearing.PLAIN``, ...).
        nis: normalised innovation squared of that measurement; NaN when it was not used.
        missed_share: of crossings that are missed singly, of late.
        loop_doubt: logarithm of how much greater the loop's variance is than claimed.
        radar_doubt: the same of the radar.
    """

    log_w: Array
    x: Array
    P: Array
    loop_s: float
    fused_s: float
    memory: Counting
    says: int
    nis: float
    missed_share: float
    loop_doubt: float = 0.0
    radar_doubt: float = 0.0


class RobustFilter:
    """Takes a bank from measurement to measurement; stamps must not decrease."""

    def __init__(self, config: MaglevConfig, table: BaliseTable, length: float) -> None:
        self._config, self._table, self._length = config, table, length
        loop = config.loop
        self._noise = Noise(
            config.motion.jerk_density,
            loop.offset_walk**2,
            loop.slope_walk**2,
            config.radar.scale_walk**2,
        )
        self._same_m = 0.4 * loop.pitch_m
        self._R_table = table.sigma**2

    def start(self, time_s: float, chainage: float, variance: float) -> Bank:
        """Return the bank of a train that is at ``chainage`` [m], known to ``variance`` [m^2]."""
        config = self._config
        x, sigma = np.zeros((1, 2, SIZE)), np.zeros(SIZE)
        x[:, :, B] = -chainage
        sigma[C], sigma[B] = 1e-3, math.sqrt(variance)
        sigma[V], sigma[A] = START_MPS, START_MPS2
        sigma[S], sigma[K] = config.loop.slope_sigma, config.radar.scale_sigma
        P = np.tile(np.diag(sigma**2) / bank.SHARE, (1, 2, 1, 1))
        memory = Counting.begin(time_s)
        return Bank(
            np.zeros(1),
            x,
            P,
            time_s,
            time_s,
            memory,
            hearing.PLAIN,
            math.nan,
            config.loop.missed_share,
        )

    def apply(self, state: Bank, heard: tuple[Measurement, float]) -> Bank:
        """Return the bank after a measurement, heard with a draw from [0, 1) for resampling."""
        measurement, uniform = heard
        if isinstance(measurement, LoopPosition):
            return self._loop(state, measurement, uniform)
        if isinstance(measurement, RadarSpeed):
            return self._radar(state, measurement, uniform)
        return self._balise(state, measurement, uniform)

    def estimate(self, state: Bank) -> Estimate:
        """Return the estimate at the stamp of the last fusion."""
        mean, covariance, _ = bank.moments(state.log_w, state.x, state.P)
        return Estimate(state.fused_s, mean, covariance)

    def _loop(self, state: Bank, z: LoopPosition, uniform: float) -> Bank:
        loop = self._config.loop
        first = math.isnan(state.memory.reading)
        x, P = state.x.copy(), state.P.copy()
        if first:
            state = self._federate(state._replace(x=x, P=P), z.time_s)
            x, P = state.x, state.P
        bank.predict_local(x, P, 0, z.time_s - state.loop_s, self._noise)
        memory, crossing = counting.hear(state.memory, z, float(x[0, 0, V]), loop)
        log_w, says, nis, share = state.log_w, hearing.PLAIN, math.nan, state.missed_share
        doubt = state.loop_doubt
        if crossing is not None and first:
            bank.begin_count(x, P, crossing.position, crossing.variance)
        elif crossing is not None and (
            crossing.moved or not standing.bounded(x, P, crossing.position, crossing.variance)
        ):
            if crossing.departed:
                standing.depart(P, crossing.pitch)
            log_w, x, P, nis, says, few = hearing.hear_loop(
                log_w,
                x,
                P,
                crossing.position,
                crossing.variance * math.exp(doubt),
                crossing.pitch,
                share * crossing.crossings,
                EXTRA_SHARE * share * crossing.crossings,
                min(loop.burst_per_m * crossing.travel, 0.3),
                self._config.particles,
                uniform,
            )
            weight = crossing.crossings / (SHARE_CROSSINGS + crossing.crossings)
            share += weight * (few / crossing.crossings - share)
            doubt = counting.doubted(doubt, nis, says in (hearing.UNKNOWN, hearing.IGNORED))
        state = state._replace(
            log_w=log_w,
            x=x,
            P=P,
            loop_s=z.time_s,
            memory=memory,
            says=says,
            nis=nis,
            missed_share=share,
            loop_doubt=doubt,
        )
        if z.time_s - state.fused_s > 2.0 * CYCLE_S:
            state = self._federate(state, z.time_s)
        return state

    def _radar(self, state: Bank, z: RadarSpeed, uniform: float) -> Bank:
        radar = self._config.radar
        log_w, x, P = state.log_w.copy(), state.x.copy(), state.P.copy()
        elapsed = z.time_s - state.fused_s
        bank.predict_local(x, P, 1, elapsed, self._noise)
        says, nis, doubt = hearing.PLAIN, math.nan, state.radar_doubt
        memory = counting.hear_radar(state.memory, z)
        if memory.frozen:
            says = hearing.IGNORED
        elif abs(z.speed) < radar.least_mps:
            if memory.counts(z.time_s, radar.least_mps, self._config.loop.pitch_m):
                says = hearing.IGNORED if abs(x[0, 1, V]) > 2.0 * radar.least_mps else says
            elif standing.hear_slowness(
                log_w, x, P, memory.heading, radar.least_mps, radar.outlier_share
            ):
                says = hearing.IGNORED
        else:
            log_w, x, P, nis, says = hearing.hear_radar(
                log_w,
                x,
                P,
                z.speed,
                z.variance * math.exp(doubt),
                radar.outlier_share,
                radar.slip_per_s * max(elapsed, 0.0),
                radar.slip_sigma,
                radar.least_mps,
                *state.memory.unseen(z, radar.least_mps),
                self._config.particles,
                uniform,
            )
            doubt = counting.doubted(doubt, nis, False)
        state = state._replace(
            log_w=log_w,
            x=x,
            P=P,
            fused_s=z.time_s,
            memory=memory.headed(float(x[0, 1, V]), radar.least_mps),
            says=says,
            nis=nis,
            radar_doubt=doubt,
        )
        return self._federate(state, z.time_s)

    def _balise(self, state: Bank, z: BalisePassing, uniform: float) -> Bank:
        state = self._federate(state._replace(x=state.x.copy(), P=state.P.copy()), z.time_s)
        settings, table = self._config.balise, self._table
        told = table.index(z.balise)
        jitter = float(state.x[0, 0, V]) * settings.jitter_s
        log_w, x, P, nis, says = passing.hear_balise(
            state.log_w,
            state.x,
            state.P,
            table.chainage + z.offset,
            self._R_table + z.variance + jitter * jitter,
            -1 if told is None else told,
            settings.wrong_share,
            settings.nothing_share,
            settings.astray_share,
            self._length,
            self._config.particles,
            uniform,
        )
        log_w, x, P = bank.merge(log_w, x, P, self._same_m)
        return state._replace(log_w=log_w, x=x, P=P, says=says, nis=nis)

    def _federate(self, state: Bank, time_s: float) -> Bank:
        """Bring the local filters to one stamp, fuse them and give the result back."""
        x, P, memory = state.x, state.P, state.memory
        bank.predict_local(x, P, 0, time_s - state.loop_s, self._noise)
        bank.predict_local(x, P, 1, time_s - state.fused_s, self._noise)
        bank.federate(x, P)
        sigma = memory.still_sigma(time_s)
        if sigma > 0.0:
            standing.stand_still(x, P, sigma, STILL_SIGMA_MPS2)
            memory = memory._replace(still_s=time_s)
        log_w, x, P = bank.merge(state.log_w, x, P, self._same_m)
        return state._replace(log_w=log_w, x=x, P=P, loop_s=time_s, fused_s=time_s, memory=memory)

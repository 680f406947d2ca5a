"""The baseline: the robust method's model in one extended Kalman filter with gates."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_localization import counting
from maglev_localization.config import MaglevConfig
from maglev_localization.counting import START_MPS, START_MPS2, Counting
from maglev_localization.estimate import Estimate
from maglev_localization.line_kernels import (
    SIZE,
    A,
    B,
    C,
    K,
    Noise,
    S,
    V,
    correct,
    correct_fully,
    predict,
    project,
    recount,
)
from maglev_localization.measurements import BalisePassing, LoopPosition, Measurement, RadarSpeed
from track_localization.track.balise_table import BaliseTable

Array = NDArray[np.float64]

GATE = 49.0
"""NIS of a loop or radar measurement that is refused: 7 sigma."""
DOUBT = 4.0
"""NIS of a radar speed above which its variance is raised in proportion."""
BALISE_SIGMAS, BALISE_LEAST_M = 5.0, 3.0
JUMP_AFTER = 2
"""So many loop readings refused in a row are a jump of the counter."""
STILL_SIGMA_MPS2 = 0.2
DEPARTURE_MPS, DEPARTURE_MPS2, BACKWARD_MPS = 0.5, 0.5, 0.1

TO_CHAINAGE = np.zeros((3, SIZE))
TO_CHAINAGE[0, C], TO_CHAINAGE[0, B], TO_CHAINAGE[1, V], TO_CHAINAGE[2, A] = 1.0, -1.0, 1.0, 1.0


class Belief(NamedTuple):
    """
    What the filter knows; never changed in place.

    Attributes:
        x: (6,) mean; see ``line_kernels``.
        P: (6, 6) covariance.
        fused_s: stamp [s].
        memory: of readings.
        refused: loop readings refused in a row.
        reason: why the newest measurement was refused; '' when it was not.
        nis: normalised innovation squared of it; NaN when it was not used.
    """

    x: Array
    P: Array
    fused_s: float
    memory: Counting
    refused: int
    reason: str
    nis: float


class KalmanFilter:
    """Takes a belief from measurement to measurement; stamps must not decrease."""

    def __init__(self, config: MaglevConfig, table: BaliseTable, length: float) -> None:
        self._config, self._table = config, table
        loop = config.loop
        self._noise = Noise(
            config.motion.jerk_density,
            loop.offset_walk**2,
            loop.slope_walk**2,
            config.radar.scale_walk**2,
        )

    def start(self, time_s: float, chainage: float, variance: float) -> Belief:
        """Return the belief of a train at ``chainage`` [m], known to ``variance`` [m^2]."""
        config = self._config
        x, sigma = np.zeros(SIZE), np.zeros(SIZE)
        x[B] = -chainage
        sigma[C], sigma[B] = 1e-3, math.sqrt(variance)
        sigma[V], sigma[A] = START_MPS, START_MPS2
        sigma[S], sigma[K] = config.loop.slope_sigma, config.radar.scale_sigma
        return Belief(x, np.diag(sigma**2), time_s, Counting.begin(time_s), 0, '', math.nan)

    def apply(self, state: Belief, heard: tuple[Measurement, float]) -> Belief:
        """Return the belief after a measurement; the draw that comes with it is not needed."""
        z = heard[0]
        x, P = state.x.copy(), state.P.copy()
        predict(x, P, z.time_s - state.fused_s, self._noise, 1.0)
        state = state._replace(x=x, P=P, fused_s=z.time_s, reason='', nis=math.nan)
        if isinstance(z, LoopPosition):
            return self._loop(state, z)
        if isinstance(z, RadarSpeed):
            return self._radar(state, z)
        return self._balise(state, z)

    def estimate(self, state: Belief) -> Estimate:
        """Return the estimate at the belief's stamp."""
        covariance = TO_CHAINAGE @ state.P @ TO_CHAINAGE.T
        return Estimate(state.fused_s, TO_CHAINAGE @ state.x, covariance)

    def _loop(self, state: Belief, z: LoopPosition) -> Belief:
        x, P = state.x, state.P
        first = math.isnan(state.memory.reading)
        memory, crossing = counting.hear(state.memory, z, float(x[V]), self._config.loop)
        state = state._replace(memory=memory)
        if crossing is None:
            return state
        if first:
            recount(x, P, crossing.position, crossing.variance)
            return state
        bounded = (
            P[C, C] < 1.5 * crossing.variance and abs(crossing.position - x[C]) < crossing.pitch
        )
        if not crossing.moved and bounded:
            return state
        if crossing.departed:
            P[C, C] += crossing.pitch**2
            P[V, V] += DEPARTURE_MPS**2
            P[A, A] += DEPARTURE_MPS2**2
        nu, variance = crossing.position - x[C], P[C, C] + crossing.variance
        nis = nu * nu / variance
        if nis > GATE:
            if state.refused + 1 < JUMP_AFTER:
                return state._replace(refused=state.refused + 1, reason='gate', nis=nis)
            recount(x, P, crossing.position, crossing.variance + 0.01)
            return state._replace(refused=0, reason='gate', nis=nis)
        correct(x, P, P[:, C].copy(), variance, nu)
        return state._replace(refused=0, nis=nis)

    def _radar(self, state: Belief, z: RadarSpeed) -> Belief:
        x, P, time_s = state.x, state.P, state.fused_s
        memory, reason, nis = counting.hear_radar(state.memory, z), '', math.nan
        PH, H = np.empty(SIZE), np.zeros(SIZE)
        least = self._config.radar.least_mps
        if memory.frozen:
            reason = 'gate'
        elif abs(z.speed) < least:
            reason = _hold_slow(x, P, memory.heading, least)
        else:
            H[V], H[K] = 1.0 + x[K], x[V]
            nu = z.speed - (1.0 + x[K]) * x[V]
            spread = project(P, H, PH)
            nis = nu * nu / (spread + z.variance)
            if nis > GATE:
                reason = 'gate'
            else:
                correct(x, P, PH, spread + z.variance * max(nis / DOUBT, 1.0), nu)
        memory = memory.headed(float(x[V]), least)
        still = memory.still_sigma(time_s)
        if still > 0.0 and x[V] ** 2 <= GATE * (P[V, V] + still**2):
            for place, sigma in ((V, still), (A, STILL_SIGMA_MPS2)):
                correct(x, P, P[:, place].copy(), P[place, place] + sigma**2, -x[place])
            memory = memory._replace(still_s=time_s)
        return state._replace(memory=memory, reason=reason, nis=nis)

    def _balise(self, state: Belief, z: BalisePassing) -> Belief:
        x, P, table = state.x, state.P, self._table
        H, PH = np.zeros(SIZE), np.empty(SIZE)
        H[C], H[B] = 1.0, -1.0
        spread = project(P, H, PH)
        gate = max(BALISE_SIGMAS * math.sqrt(spread), BALISE_LEAST_M)
        ahead = table.chainage + z.offset - (x[C] - x[B])
        told = table.index(z.balise)
        reason = 'unknown_id' if told is None else ''
        if told is None or abs(ahead[told]) > gate:
            reason = reason or 'wrong_id'
            nearest = int(np.argmin(np.abs(ahead))) if len(table) else None
            told = None if nearest is None or abs(ahead[nearest]) > gate else nearest
        if told is None:
            return state._replace(reason='gate' if reason == 'wrong_id' else reason)
        R = table.sigma[told] ** 2 + z.variance + (x[V] * self._config.balise.jitter_s) ** 2
        nu = float(ahead[told])
        correct_fully(x, P, H, R, nu)
        return state._replace(reason=reason, nis=nu * nu / (spread + R))


def _hold_slow(x: Array, P: Array, heading: float, least: float) -> str:
    """Hold a speed that a radar below ``least`` [m/s] leaves no room for; return why not, or ''."""
    v, sigma = heading * x[V], 0.5 * least
    if 0.0 <= v <= least and P[V, V] <= sigma**2:
        return ''
    level = sigma if v > least else 0.0
    spread = P[V, V] + (BACKWARD_MPS if v < 0.0 else sigma) ** 2
    if (level - v) ** 2 > GATE * spread:
        return 'gate'
    correct(x, P, P[:, V].copy(), spread, heading * (level - v))
    return ''

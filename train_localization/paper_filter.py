"""
The paper's SINS/DR filter, its equations by number (paper 4): 19 states, sequential, fading.

The error state is that of the inertial navigation (15), the dead-reckoned position's (3) and the
odometer's scale (1). While fixes are good they correct it (BDS/SINS); with three satellites they
correct it in the plane; else the difference of the navigated and the dead-reckoned position does,
eqs (4), (5). Dead reckoning starts anew at every fix. The paper works in north-east-down; here
axes are east-north-up and the attitude error is in the body, see ``estimation.ins``.

What the paper leaves open, and settings decide:

- From fix to fix the two positions are compared as well, so that the odometer's scale is known when
  an outage begins, and the heading is the way's: the 19 states have no angle for the IMU's mounting
  in the car, which goes into the attitude error. A way that does not fit is that of a slipping
  wheel, and is left out until the next fix; in an outage nothing is, as in the paper.
- They are compared in the plane, in which the paper tells its errors. In height the mounting's
  pitch would have to be a tilt against gravity, which the accelerometers deny.
- A fix that does not fit is left out, unless too many follow each other.
- Gyros count for less than they are worth. What the states lack, such as a slow error of the fixes
  and the IMU's mounting, would otherwise be believed to be the way's heading for too long.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.estimation.sequential import innovation, update
from train_localization import gaps, kernels
from train_localization.alignment import Start
from train_localization.config import TrainConfig
from train_localization.measurements import WheelSpeed
from train_localization.robust_filter import LOST_AFTER_S, SETTLING_S, RobustFilter
from train_localization.state import Fix, Fused, Heard, Stretch

Array = NDArray[np.float64]

SIZE, DR, SCALE = 19, 15, 18
FADING_MEMORY = 0.95
"""Of the innovation's variance, eq. (6)."""
OFF = np.full(3, math.inf)
"""Innovation variances of channels that do not fade."""
LONGEST_STEP_S = 2.0
"""An odometer's speed tells nothing of what was longer ago [s]: dead reckoning begins anew."""


@njit(cache=True)
def fade(P: Array, h: Array, R: float, nu: float, V: float, limit: float) -> float:
    """
    Raise ``P`` by the adaptive single fading factor of one channel, eqs (6), (10), in place.

    ``V`` is the channel's innovation variance before; return it with ``nu`` in it. NaN begins it.
    The paper knows no ``limit``; without one an error that is no noise, such as a slipping wheel,
    multiplies P beyond all bounds.
    """
    V = nu * nu if math.isnan(V) else (FADING_MEMORY * V + nu * nu) / (1.0 + FADING_MEMORY)
    hPh = h @ P @ h
    if hPh > 0.0:
        factor = float((V - R) / hPh)
        if factor > 1.0:
            P[:] = P * min(factor, limit)
    return V


@njit(cache=True)
def correct(
    nav: Array,
    aux: Array,
    P: Array,
    ahead: Array,
    R: Array,
    other: int,
    axes: int,
    V: Array,
    limit: float,
) -> None:
    """
    Correct the navigation by a position ``ahead`` (3,) of it [m], one axis after the other.

    ``other`` is where the error of that position stands in the state, -1 where it has none.
    ``V`` (3,) are the channels' innovation variances, infinite where fading is off.
    """
    dx, h = np.zeros(SIZE), np.zeros(SIZE)
    for k in range(axes):
        h[:] = 0.0
        h[k] = 1.0
        if other >= 0:
            h[other + k] = -1.0
        if not math.isinf(V[k]):
            V[k] = fade(P, h, R[k], ahead[k] - h @ dx, V[k], limit)
        update(P, h, R[k], ahead[k], dx)
    kernels.give(nav, aux, dx)


@njit(cache=True)
def greatest_nis(P: Array, ahead: Array, R: Array, other: int, axes: int) -> float:
    """Return the greatest NIS of an axis of what ``correct`` is told likewise."""
    worst, h, nothing = 0.0, np.zeros(SIZE), np.zeros(SIZE)
    for k in range(axes):
        h[:] = 0.0
        h[k] = 1.0
        if other >= 0:
            h[other + k] = -1.0
        nu, S = innovation(P, h, R[k], ahead[k], nothing)
        worst = max(worst, nu * nu / S)
    return worst


def _doubted(config: TrainConfig) -> TrainConfig:
    """Return the settings with gyros that count for so much less."""
    imu, times = config.imu.of_grade(), config.paper.gyro_times
    imu = dataclasses.replace(
        imu, gyro_noise=times * imu.gyro_noise, gyro_bias_walk=times * imu.gyro_bias_walk
    )
    return dataclasses.replace(config, imu=imu)


class PaperFilter:
    """Takes what is known from measurement to measurement; see ``RobustFilter``."""

    def __init__(self, config: TrainConfig) -> None:
        self._config = config
        # What carries the inertial states over a stretch is the same.
        self._inertial = RobustFilter(_doubted(config), aided=False)

    def start(self, start: Start) -> Fused:
        """Return what is known at a start; ``aux`` is biases, dead-reckoned lead, scale, V."""
        imu = self._config.imu.of_grade()
        sigma = np.zeros(SIZE)
        sigma[9:12] = math.radians(imu.gyro_bias_sigma) / 3600.0
        sigma[12:15] = imu.accel_bias_sigma * 1e-3 * GRAVITY
        sigma[DR:SCALE] = 1e-3
        sigma[SCALE] = self._config.paper.scale_sigma
        P = np.diag(sigma**2)
        P[:9, :9] = start.covariance
        state = self._inertial.start(start)
        channels = np.full(3, math.nan) if self._config.paper.fading else OFF
        return state._replace(aux=np.concatenate([np.zeros(10), channels]), P=P)

    def apply(self, state: Fused, heard: Heard) -> Fused:
        """Return what is known after a measurement."""
        state = state._replace(
            nav=state.nav.copy(), aux=state.aux.copy(), P=state.P.copy(), reason='', nis=math.nan
        )
        if isinstance(heard, Stretch):
            return self._stretch(state, heard)
        silent = heard.time_s - state.time_s > state.gap_s
        if isinstance(heard, Fix):
            if silent and heard.axes:
                return state._replace(reason=gaps.IMU_SILENT)
            return self._fix(state, heard)
        if silent:
            return state._replace(wheel_s=heard.time_s, reason=gaps.IMU_SILENT)
        return self._wheel(state, heard)

    def told(self, state: Fused) -> Fused:
        """Return what is told of a state: all of it."""
        return state

    def _stretch(self, state: Fused, stretch: Stretch) -> Fused:
        before = state.nav[3:6].copy()
        span = stretch.time_s - state.time_s
        gap = kernels.longest_gap(state.time_s, stretch.stamps) > state.gap_s
        state, _ = self._inertial.predict(state, stretch)
        if gap:
            self._set_dead_reckoning(state)  # what was unseen it has not reckoned
            return state
        # The dead-reckoned position stays where it was, and so falls behind the navigated one.
        state.aux[6:9] -= 0.5 * (before + state.nav[3:6]) * span
        return state

    def _fix(self, state: Fused, heard: Fix) -> Fused:
        if heard.axes == 0:
            return state._replace(axes=0)
        fix, nav = heard.gnss, state.nav
        ahead = kernels.apart(nav, fix.latitude, fix.longitude, fix.height)
        lever, _ = kernels.antenna(nav, self._config.gnss.lever)
        ahead -= nav[3:6] * (fix.time_s - state.time_s) + lever
        R = np.maximum(np.diag(fix.covariance), self._config.paper.gnss_sigma_m**2)
        paper, again = self._config.paper, state.refused_fixes >= self._config.paper.recover_after
        settling = again or fix.time_s - state.began_s < SETTLING_S
        nis = greatest_nis(state.P, ahead, R, -1, heard.axes)
        if nis > paper.gate and not settling:
            return state._replace(refused_fixes=state.refused_fixes + 1, reason='gate', nis=nis)
        correct(nav, state.aux[:10], state.P, ahead, R, -1, heard.axes, OFF.copy(), 1.0)
        self._set_dead_reckoning(state)
        began_s = fix.time_s if again else state.began_s
        return state._replace(
            fixed_s=fix.time_s,
            axes=heard.axes,
            refused_fixes=0,
            refused_wheel=0,
            nis=nis,
            began_s=began_s,
        )

    def _wheel(self, state: Fused, heard: WheelSpeed) -> Fused:
        """Carry the dead-reckoned position on, and correct by it."""
        nav, aux, P = state.nav, state.aux, state.P
        elapsed = heard.time_s - state.wheel_s
        state = state._replace(wheel_s=heard.time_s)
        if elapsed > LONGEST_STEP_S:
            self._set_dead_reckoning(state)
            return state
        # The paper's odometer counts way; a speed is that of a moment ago, not of the interval.
        earlier = 0.5 * elapsed - max(self._config.wheel.delay_s, 0.0)
        R_nb, run = kernels.rotation(nav), (heard.speed - state.gain * earlier) * elapsed
        way = run / (1.0 + aux[9])
        aux[6:9] += way * R_nb[:, 0]
        self._carry(P, R_nb, way, run)
        lost = state.axes == 0 or state.time_s - state.fixed_s > LOST_AFTER_S
        return self._compare(state, heard, lost) if lost or self._config.paper.compares else state

    def _compare(self, state: Fused, heard: WheelSpeed, lost: bool) -> Fused:
        """Correct by the difference of the two positions, eq. (4)."""
        nav, aux, P, paper = state.nav, state.aux, state.P, self._config.paper
        axes = 3 if paper.height else 2
        if lost and state.refused_wheel:
            self._set_dead_reckoning(state)  # the way since the last fix was that of a slip
        ahead = aux[6:9] + nav[3:6] * (state.time_s - heard.time_s)
        R = np.full(3, (paper.dr_sigma_m if lost else paper.way_sigma_m) ** 2)
        if not lost:
            nis = greatest_nis(P, ahead, R, DR, axes)
            if nis > paper.gate:
                return state._replace(refused_wheel=state.refused_wheel + 1, reason='slip', nis=nis)
        settling = state.time_s - state.began_s < SETTLING_S
        V = aux[10:13] if lost and not settling else OFF.copy()
        before = nav[:3].copy()
        correct(nav, aux[:10], P, ahead, R, DR, axes, V, paper.fading_limit)
        aux[6:9] += kernels.apart(nav, *before)
        return state._replace(refused_wheel=0) if lost else state

    @staticmethod
    def _carry(P: Array, R_nb: Array, way: float, run: float) -> None:
        """Carry the errors of the dead-reckoned position over a way [m], in place."""
        F = np.eye(SIZE)
        # d(C u way) = C (theta x u) way - C u run dK, with u forward.
        F[DR:SCALE, 7] = -R_nb[:, 2] * way
        F[DR:SCALE, 8] = R_nb[:, 1] * way
        F[DR:SCALE, SCALE] = -R_nb[:, 0] * run
        P[:] = F @ P @ F.T
        P[DR:SCALE, DR:SCALE] += np.eye(3) * (1e-3 * abs(way)) ** 2

    @staticmethod
    def _set_dead_reckoning(state: Fused) -> None:
        """
        Let dead reckoning start from the navigated position, errors and all.

        It is carried on from odometer to odometer, so its place is that of the last of them.
        """
        since = min(state.time_s - state.wheel_s, LONGEST_STEP_S)
        state.aux[6:9] = -state.nav[3:6] * since
        P = state.P
        P[DR:SCALE, :] = P[:3, :]
        P[:, DR:SCALE] = P[:, :3]
        P[DR:SCALE, DR:SCALE] = P[:3, :3]

"""The default filter: inertial navigation held by fixes, odometer, rails and the surveyed line."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.track.centreline import Centreline
from train_localization import gaps, kernels, map_kernels, straights
from train_localization.alignment import Start
from train_localization.config import TrainConfig
from train_localization.kernels import AUX, INERTIAL, MAP, PITCH, SCALE, SIZE, SLOW, YAW, Noise
from train_localization.measurements import WheelSpeed
from train_localization.placing import Placing
from train_localization.standing import STILL_SIGMA_MPS, quiet
from train_localization.state import Fix, Fused, Heard, Stretch
from train_localization.straights import Marks

Array = NDArray[np.float64]

SETTLING_S, SETTLING_SHARE = 5.0, 0.05
"""
After a start nothing is refused for so long [s]; a wheel that slips just then is not found out, so
a share of the odometer's speed is unsure.
"""
LOST_AFTER_S = 2.5
"""Without a fix for so long there is an outage [s]."""
STILL_AFTER_S, STILL_MPS = 1.0, 0.02
"""A train whose odometer reads less than this for so long stands."""
NEARLY_MPS = 2.0
"""An odometer that reads nothing while the train is faster is stuck [m/s]."""
STILL_SIGMA_RADPS = 3e-4
LEAST_MPS, SURE = 3.0, 10.0
"""
Rails and the line's direction tell something of a train that is faster [m/s]; rails of one whose
speed is known so many times better than it is.
"""
ALONE_S = 1.0
"""An odometer not heard for so long is missing [s]."""
BIAS_AFTER_REST = 0.2
"""Share of the gyro biases' sigma that is left after a rest."""

LOST_M, DOUBT_DEG = 50.0, 5.0
AGAINST_FIXES, AGAINST_WHEEL = 4, 10
"""So many fixes and odometer speeds in a row, both refused: it is the filter that is wrong."""
ALIKE, USUAL = 10.0, 1.5
"""
A fix that claims more than so many times the usual slow error has more of it; so many in a row, one
a second, are taken to err alike. Under an open sky HDOP changes by less.
"""
MAP_GATE = 25.0
ANY = 1e300
IDENTITY = np.eye(SIZE)


class RobustFilter:
    """
    Takes what is known from measurement to measurement; stamps must not decrease.

    Without a line (``track``, in the frame of ``placing``) it is ``robust``; with one
    ``robust_map``. With ``aided`` False nothing but fixes is used: ``ins``.
    """

    def __init__(
        self,
        config: TrainConfig,
        track: Centreline | None = None,
        placing: Placing | None = None,
        aided: bool = True,
    ) -> None:
        self._config, self._track, self._placing, self._aided = config, track, placing, aided
        self._by_shape = aided and config.straight.used
        imu, gnss = config.imu.of_grade(), config.gnss
        hour = math.radians(1.0) / 3600.0
        self._noise = Noise(
            (math.radians(imu.gyro_noise) / 60.0) ** 2,
            (imu.accel_noise / 60.0) ** 2,
            (imu.gyro_bias_walk * hour) ** 2,
            (imu.accel_bias_walk * 1e-3 * GRAVITY) ** 2,
            gnss.slow_sigma_m**2,
            gnss.slow_sigma_up_m**2,
            gnss.slow_s,
        )

    def start(self, start: Start) -> Fused:
        """Return what is known at a start."""
        imu, wheel, gnss, line = (
            self._config.imu.of_grade(),
            self._config.wheel,
            self._config.gnss,
            self._config.map,
        )
        sigma = np.zeros(SIZE)
        sigma[9:12] = math.radians(imu.gyro_bias_sigma) / 3600.0
        if start.rested:
            sigma[9:12] = np.maximum(
                BIAS_AFTER_REST * sigma[9:12], math.radians(imu.gyro_noise) / 60.0
            )
        sigma[12:15] = imu.accel_bias_sigma * 1e-3 * GRAVITY
        sigma[SCALE], sigma[YAW : PITCH + 1] = (
            wheel.scale_sigma,
            math.radians(wheel.mounting_sigma_deg),
        )
        sigma[SLOW : SLOW + 2], sigma[SLOW + 2] = gnss.slow_sigma_m, gnss.slow_sigma_up_m
        sigma[MAP : MAP + 2] = line.offset_sigma_m, line.offset_sigma_up_m
        P = np.diag(sigma**2)
        P[:9, :9] = start.covariance
        aux = np.zeros(AUX)
        if start.rested:
            aux[:3] = start.gyro_bias
        nav = np.concatenate([start.geodetic, start.velocity, start.quaternion])
        t, never = start.time_s, -math.inf
        return Fused(
            nav, aux, P, t, np.full(6, np.nan), gaps.shortest(self._config.epoch_s), np.zeros(3),
            0.0, t, t, 3, 0, never, 0, t, t, t, math.nan, Marks(), math.nan, '', math.nan,
        )  # fmt: skip

    def apply(self, state: Fused, heard: Heard) -> Fused:
        """Return what is known after a measurement."""
        nav, aux, P = state.nav.copy(), state.aux.copy(), state.P.copy()
        state = state._replace(nav=nav, aux=aux, P=P, reason='', nis=math.nan)
        if isinstance(heard, Stretch):
            return self._stretch(state, heard)
        silent = heard.time_s - state.time_s > state.gap_s
        if isinstance(heard, Fix):
            if silent and heard.axes:
                return state._replace(reason=gaps.IMU_SILENT)
            return self._fix(state, heard)
        if not self._aided:
            return state
        turned = abs(heard.speed) > STILL_MPS
        state = state._replace(
            wheel_s=heard.time_s, moved_s=heard.time_s if turned else state.moved_s
        )
        return state._replace(reason=gaps.IMU_SILENT) if silent else self._wheel(state, heard)

    def predict(self, state: Fused, stretch: Stretch) -> tuple[Fused, Array]:
        """Return the state carried over IMU samples alone, and the transition (27, 27)."""
        nav, aux, P = state.nav.copy(), state.aux.copy(), state.P.copy()
        before = state.before.copy()
        if np.isnan(before[0]):
            before[:3], before[3:] = stretch.rates[0], stretch.forces[0]
        Phi, marks = IDENTITY.copy(), state.marks
        longest = kernels.longest_gap(state.time_s, stretch.stamps)
        if longest > state.gap_s:
            marks = Marks()  # of a chord that nobody saw
        elif self._by_shape:
            way_m = kernels.speed_of(nav) * max(stretch.time_s - state.time_s, 0.0)
            R = self._config.straight.course_sigma_rad**2
            marks = straights.carry(nav, aux, P, marks, way_m, R, Phi)
        inertial = np.empty((INERTIAL, INERTIAL))
        speed = kernels.speed_of(nav)
        kernels.predict(
            nav, aux, P, state.time_s, stretch.stamps, stretch.rates, stretch.forces, before,
            self._noise, inertial,
        )  # fmt: skip
        span = max(stretch.time_s - state.time_s, 1e-9)
        Phi[:INERTIAL, :INERTIAL] = inertial
        Phi[SLOW : SLOW + 3, SLOW : SLOW + 3] *= math.exp(-span / self._noise.slow_s)
        gained = (kernels.speed_of(nav) - speed) / span
        if longest > state.gap_s:
            gaps.unseen(P, nav, longest)
        state = state._replace(
            nav=nav, aux=aux, P=P, time_s=stretch.time_s, before=before,
            gap_s=gaps.adapted(
                state.gap_s, self._config.epoch_s, stretch.stamps, state.time_s
            ),
            w_mean=stretch.rates.mean(axis=0), gain=gained, marks=marks,
        )  # fmt: skip
        return state, Phi

    def told(self, state: Fused) -> Fused:
        """
        Return what is told of a state: with a line, whether its map is right is weighed.

        Nothing of that enters the filter, so that fixes to come may speak against the map.
        """
        if self._track is None:
            return state
        nav, aux, P = state.nav.copy(), state.aux.copy(), state.P.copy()
        line = self._config.map
        right = map_kernels.weigh_map(
            nav, aux, P, line.offset_sigma_m**2, line.right_sigma_m**2, line.right_share
        )
        return state._replace(nav=nav, aux=aux, P=P, map_right=right)

    def _stretch(self, state: Fused, stretch: Stretch) -> Fused:
        state, _ = self.predict(state, stretch)
        if not self._aided:
            return state
        now, wheel = state.time_s, self._config.wheel
        nav, aux, P = state.nav, state.aux, state.P
        speed = kernels.speed_of(nav)
        heard = now - state.wheel_s < ALONE_S
        stands = now - state.moved_s > STILL_AFTER_S and speed < NEARLY_MPS
        stands = stands and quiet(nav, aux, P, state.w_mean, stretch.forces.mean(axis=0))
        if heard and stands and state.refused_wheel == 0:
            kernels.stand(nav, aux, P, state.w_mean, STILL_SIGMA_MPS**2, STILL_SIGMA_RADPS**2)
        elif (
            wheel.nonholonomic
            and speed > max(LEAST_MPS, SURE * math.sqrt(P[3, 3] + P[4, 4]))
            and now - state.railed_s > 1.0 / wheel.constraint_rate_hz - 1e-6
        ):
            kernels.rails(nav, aux, P, wheel.side_sigma_mps**2, state.w_mean, wheel.lever_m)
            state = state._replace(railed_s=now)
        if self._by_shape and speed > LEAST_MPS:
            marks = straights.tell(nav, aux, P, state.marks, self._config.straight)
            state = state._replace(marks=marks)
        return self._line(state, speed) if self._track is not None else state

    def _line(self, state: Fused, speed: float) -> Fused:
        """Use the surveyed line, whose offset may be anything for now; see ``told``."""
        line, now = self._config.map, state.time_s
        nav, aux, P = state.nav, state.aux, state.P
        if now - state.mapped_s < 1.0 / line.rate_hz - 1e-6:
            return state
        assert self._track is not None
        assert self._placing is not None
        position, to_level = self._placing.position(nav), self._placing.rotation(nav).T
        near = None if math.isnan(state.chainage) else state.chainage + speed / line.rate_hz
        s = float(self._track.nearest(position, near, None if near is None else 100.0))
        tangent = to_level @ self._track.tangent(s)
        left = np.array([-tangent[1], tangent[0], 0.0]) / max(math.hypot(*tangent[:2]), 1e-6)
        if speed > LEAST_MPS:
            # The wander is no white noise: what is seen of it within its length counts once.
            alike = max(line.rate_hz * line.wander_m / speed, 1.0)
            R = alike * np.array([line.local_sigma_m**2, line.height_sigma_m**2])
            ahead = to_level @ (self._track.position(s) - position)
            nis = map_kernels.line(
                nav, aux, P, ahead, left, np.cross(tangent, left), R,
                alike * math.radians(line.course_sigma_deg) ** 2, MAP_GATE,
            )  # fmt: skip
            state = state._replace(nis=nis, reason='off_the_map' if nis > MAP_GATE else '')
        return state._replace(mapped_s=now, chainage=s)

    def _fix(self, state: Fused, heard: Fix) -> Fused:
        gnss, fix = self._config.gnss, heard.gnss
        if heard.axes == 0:
            return state
        nav, aux, P = state.nav, state.aux, state.P
        ahead = kernels.apart(nav, fix.latitude, fix.longitude, fix.height)
        lever, turned = kernels.antenna(nav, gnss.lever)
        ahead -= nav[3:6] * (fix.time_s - state.time_s) + lever
        claimed = np.sqrt(np.maximum(np.diag(fix.covariance), 0.0))
        R = np.maximum(gnss.white_share * claimed, gnss.least_sigma_m) ** 2
        slow = np.array([gnss.slow_sigma_m, gnss.slow_sigma_m, gnss.slow_sigma_up_m])
        worse = (1.0 - min(gnss.white_share, 1.0) ** 2) * claimed**2 - (USUAL * slow) ** 2
        R += ALIKE * np.maximum(worse, 0.0)
        settling = state.time_s - state.began_s < SETTLING_S
        alone = state.refused_fixes >= gnss.recover_after
        both = state.refused_fixes >= AGAINST_FIXES and state.refused_wheel >= AGAINST_WHEEL
        if alone or both:
            self._doubt(P, ahead, fix.time_s - state.fixed_s)
            state = state._replace(began_s=fix.time_s, refused_wheel=0)
            settling = True
        huber, gate = (gnss.gate, ANY) if settling else (gnss.huber, gnss.gate)
        nis = kernels.fix(nav, aux, P, ahead, turned, R, heard.axes, huber, gate)
        if nis > gnss.gate and not settling:
            return state._replace(refused_fixes=state.refused_fixes + 1, reason='gate', nis=nis)
        return state._replace(refused_fixes=0, fixed_s=fix.time_s, axes=heard.axes, nis=nis)

    def _doubt(self, P: Array, ahead: Array, elapsed: float) -> None:
        """Forget nearly all of what is known of the motion: fixes have spoken against it."""
        imu = self._config.imu.of_grade()
        P[:INERTIAL, :] = 0.0
        P[:, :INERTIAL] = 0.0
        sigma = np.empty(INERTIAL)
        sigma[:3] = np.abs(ahead) + LOST_M
        sigma[3:6] = np.abs(ahead).max() / max(elapsed, 1.0)
        sigma[6:9] = math.radians(DOUBT_DEG)
        sigma[9:12] = math.radians(imu.gyro_bias_sigma) / 3600.0
        sigma[12:15] = imu.accel_bias_sigma * 1e-3 * GRAVITY
        P[:INERTIAL, :INERTIAL] = np.diag(sigma**2)

    def _wheel(self, state: Fused, heard: WheelSpeed) -> Fused:
        wheel = self._config.wheel
        nav, aux, P = state.nav, state.aux, state.P
        gained = state.gain * (state.time_s - heard.time_s + max(wheel.delay_s, 0.0))
        R = max(wheel.sigma_mps**2, heard.variance)
        settling = state.time_s - state.began_s < SETTLING_S
        if settling:
            R += (SETTLING_SHARE * heard.speed) ** 2
        if state.refused_wheel >= wheel.recover_after:
            P[3:6, 3:6] += np.eye(3) * (heard.speed - kernels.speed_of(nav)) ** 2
            settling = True
        gate = ANY if settling else wheel.gate
        nis = kernels.wheel(nav, aux, P, heard.speed, gained, R, gate)
        if nis > gate:
            return state._replace(refused_wheel=state.refused_wheel + 1, reason='slip', nis=nis)
        return state._replace(refused_wheel=0, nis=nis)

"""The standstill update (ZUPT) of the coaster's filter, and when the train is taken to stand."""

from __future__ import annotations

import numpy as np

from coaster_localization.estimate import FusedState
from coaster_localization.replaying import ZUPT_INTERVAL_S
from track_localization.estimation import eskf
from track_localization.estimation.imu_monitor import ImuStep

SIGMA_MPS = 0.02
"""Velocity at standstill."""
ROLLS_MPS, SURELY, ROLLED_S = 1.0, 5.0, 1.0
"""
A speed so many times its sigma is surely one; a train that rolls so long as quietly as it stands is
one that may do so anywhere.
"""
CRAWLS_MPS = 0.5
"""A train that is slower stands."""
TURNS_RADPS = 0.02


def standstill(state: FusedState, step: ImuStep, usual_mps: float) -> FusedState:
    """
    Use a step that feels like rest: no velocity, and the mean rate is the gyro's bias.

    A quiet chain lift feels the same, so the filter's own speed must agree. A train that was seen
    to roll as quietly as it stands must be known to stand, or be where its usual speed, that of
    the design, is none.
    """
    nav = state.nav
    state = state._replace(last_zupt_s=step.time_s)
    sigma_v = float(np.sqrt(np.trace(nav.P[3:6, 3:6])))
    speed = float(np.linalg.norm(nav.velocity))
    if speed > max(ROLLS_MPS, SURELY * sigma_v):
        return state._replace(rolled_s=state.rolled_s + ZUPT_INTERVAL_S)
    if speed > 0.3 + 2.0 * sigma_v or sigma_v > 3.0:
        return state
    rolls_quietly = state.rolled_s > ROLLED_S and usual_mps > CRAWLS_MPS
    if rolls_quietly and speed + 2.0 * sigma_v > CRAWLS_MPS:
        return state
    if np.linalg.norm(step.w_mean - nav.gyro_bias) > TURNS_RADPS:
        return state
    H = np.zeros((6, eskf.ERROR_STATES))
    H[0:3, eskf.VELOCITY] = np.eye(3)
    H[3:6, eskf.GYRO_BIAS] = np.eye(3)
    nu = np.concatenate([-nav.velocity, step.w_mean - nav.gyro_bias])
    R = np.diag([SIGMA_MPS**2] * 3 + [max(0.3 * step.w_std, 2e-4) ** 2] * 3)
    return state._replace(nav=eskf.update(nav, nu, H, R))

"""
How the sensor sits in the body, from a whole ride and the design ride alone.

What no rotation changes, the lengths of specific force and angular rate, is matched to the design;
the rotation between matched vectors is then Kabsch's. No rest, level or first guess is needed. The
track filter finds its mount by itself and more precisely; this is a check that owes it nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coaster_localization import dtw
from coaster_localization.channels import low_pass
from coaster_localization.track_config import TrackFilterConfig
from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSeries
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

NATIVE_HZ, RATE_HZ, LOW_PASS_HZ = 100.0, 25.0, 1.0
FORCE_UNIT, RATE_UNIT = 10.0, 1.0
"""Force [m/s^2] that weighs as much as a rate [rad/s]."""
DERIVATIVE_WEIGHT, STEP_PENALTY = 0.25, 0.02
TURNING_RADPS, MARGIN_S = 0.1, 2.0
"""The ride begins and ends this long beside where it first and last turns faster than this."""
SHORTEST_S = 10.0
BLOCKS = 12
"""Stretches of the ride, each left out once to see how the mount scatters."""


def calibrate_mount(
    imu: ImuSeries, design: DesignRide, config: TrackFilterConfig | None = None
) -> tuple[Array, float]:
    """
    Return R_bm (3, 3), sensor to body axes, and its standard deviation per axis [rad].

    ``imu`` holds the whole ride, once, in the sensor's axes. Sigma has two parts: how the mount
    scatters when stretches are left out, and what the sensors' biases (``config``) do to it.
    Raise DataError where either ride hardly turns.
    """
    config = config or TrackFilterConfig()
    measured = _turning_part(imu.time_s, imu.specific_force, imu.angular_rate, 'recording')
    planned = _turning_part(
        design.time_s, design.specific_force, design.angular_rate, 'design ride'
    )
    path = dtw.align(_lengths(measured), _lengths(planned), STEP_PENALTY).path
    a, b = measured[path[:, 0]], planned[path[:, 1]]
    R_bm, weight = _rotation(a, b)
    scatter = np.empty((BLOCKS, 3))
    for k, block in enumerate(np.array_split(np.arange(len(a)), BLOCKS)):
        R_without, _ = _rotation(np.delete(a, block, axis=0), np.delete(b, block, axis=0))
        scatter[k] = so3.log(R_without @ R_bm.T)
    deviation = scatter - scatter.mean(axis=0)
    variance = (BLOCKS - 1.0) / BLOCKS * (deviation**2).sum(axis=0)
    bias = np.array([config.accel_bias_sigma / FORCE_UNIT, config.gyro_bias_sigma / RATE_UNIT])
    total = float(variance.mean() + _bias_variance(b, weight, bias))
    return R_bm, math.sqrt(total)


def _turning_part(time_s: Array, force: Array, rate: Array, name: str) -> Array:
    """Return force and rate in their units, smoothed, (N, 2, 3) at ``RATE_HZ``."""
    fine = np.arange(time_s[0], time_s[-1], 1.0 / NATIVE_HZ)
    raw = np.hstack([force / FORCE_UNIT, rate / RATE_UNIT])
    if len(fine) < SHORTEST_S * NATIVE_HZ or not np.isfinite(raw).all():
        raise DataError(f'{name}: less than {SHORTEST_S:.0f} s, or not finite: no mount from it')
    smooth = low_pass(
        np.stack([np.interp(fine, time_s, c) for c in raw.T], axis=1), NATIVE_HZ, LOW_PASS_HZ
    )[:: round(NATIVE_HZ / RATE_HZ)]
    turning = np.flatnonzero(np.linalg.norm(smooth[:, 3:], axis=1) * RATE_UNIT > TURNING_RADPS)
    if not len(turning) or turning[-1] - turning[0] < SHORTEST_S * RATE_HZ:
        raise DataError(f'{name}: hardly turns, which a ride does: no mount from it')
    margin = round(MARGIN_S * RATE_HZ)
    return smooth[max(turning[0] - margin, 0) : turning[-1] + margin].reshape(-1, 2, 3)


def _lengths(vectors: Array) -> Array:
    """Return what no mount changes, (N, 4): both lengths and their derivatives."""
    return dtw.with_derivative(2.0 * np.linalg.norm(vectors, axis=2), RATE_HZ, DERIVATIVE_WEIGHT)


def _rotation(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the rotation that takes ``a`` (L, 2, 3) to ``b`` best, and what each weighs (L, 2)."""
    shape = a.shape[:2]
    a, b = a.reshape(-1, 3), b.reshape(-1, 3)
    weight = np.ones(len(a))
    R: Array = np.eye(3)
    for _ in range(8):
        U, _, Vt = np.linalg.svd((b * weight[:, None]).T @ a)
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        left = np.linalg.norm(b - a @ R.T, axis=1)
        # Far ones are wrong matches: they are disregarded.
        weight = 1.0 / (1.0 + (left / (1.4826 * max(float(np.median(left)), 1e-9))) ** 2) ** 2
    return R, weight.reshape(shape)


def _bias_variance(b: Array, weight: Array, bias_sigma: Array) -> float:
    """
    Return the mount's variance per axis [rad^2] that constant biases cause.

    ``b`` (L, 2, 3), ``weight`` (L, 2), ``bias_sigma`` (2,): of force and rate, in their units. To
    first order a bias turns the mount by A^-1 (sum of w b) x bias, A = sum of w (b.b - b b^T).
    """
    A = np.einsum('lk,lki,lki->', weight, b, b) * np.eye(3)
    A -= np.einsum('lk,lki,lkj->ij', weight, b, b)
    lever = so3.hat(np.einsum('lk,lki->ki', weight, b)) * bias_sigma[:, None, None]
    turn = np.linalg.solve(A, lever)
    return float((turn**2).sum() / 3.0)

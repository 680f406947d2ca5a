"""What the track filter's kernels need to know of the settings and of the sensor's shaking."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_config import TrackFilterConfig

Array = NDArray[np.float64]

GAP_S = 0.1
"""A step longer than this was not measured: what the train did in it is unknown."""
GAP_ACCEL, GAP_RATE = 15.0, 1.5
"""How a train may accelerate [m/s^2] and turn [rad/s] unseen."""


def settings_of(config: TrackFilterConfig) -> Array:
    """Return the settings (11,) of ``line_bank.close_epoch``."""
    c = config
    return np.array(
        [
            *(c.attitude_correlation_m, c.soft_gate, c.spread_m, c.reach_m),
            *(c.speed_noise, c.speed_noise_m, c.zupt_sigma),
            *(c.vibration_gain, c.gyro_vibration_gain, c.accel_noise, c.accel_scale_sigma),
        ],
        dtype=float,
    )


def process_noise(config: TrackFilterConfig, dt: float) -> Array:
    """
    Return the process noise (6,) of ``line_motion.predict`` without what shaking adds.

    ``dt`` is the latest step [s]; a long one was not measured.
    """
    c = config
    accel, rate = 0.0, c.gyro_noise**2
    if dt > GAP_S:
        accel += GAP_ACCEL**2 * dt
        rate += GAP_RATE**2 * dt
    walks = (c.gyro_bias_walk**2, c.accel_bias_walk**2, c.mount_walk**2)
    return np.array([accel, rate, *walks, c.speed_sigma])

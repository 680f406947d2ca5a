"""Every setting of the track filter: the only home of their defaults."""

from __future__ import annotations

import dataclasses

from track_localization.settings import setting


@dataclasses.dataclass(frozen=True)
class TrackFilterConfig:
    """Kalman filter on the chainage: attitude against the line's, force along it, standstill."""

    epoch_s: float = setting(0.05, 's', 'time between two comparisons with the line', 0.01, 1.0)
    # The line
    attitude_sigma: float = setting(
        0.004, 'rad', "built track's attitude against the design's", 1e-4, 0.5
    )
    attitude_correlation_m: float = setting(
        6.0, 'm', 'distance over which the built track keeps its deviation', 0.0, 1000.0
    )
    soft_gate: float = setting(9.0, '', 'NIS of an axis above which it weighs less', 1.0, 1e6)
    spread_m: float = setting(
        0.4, 'm', 'sigma of the chainage above which the line is linearised statistically', 0.0
    )
    reach_m: float = setting(25.0, 'm', 'most that this looks ahead and back', 0.5, 200.0)
    line_sigma_m: float = setting(
        0.022, 'm', 'built track and seat against the design line, each axis', 1e-4, 10.0
    )
    # Speed prior
    speed_sigma: float = setting(
        0.06, '', "a ride's speed against the design's, as a share; 0: not used", 0.0, 10.0
    )
    speed_correlation_m: float = setting(
        1000.0, 'm', 'distance over which this deviation persists', 0.1, 1e5
    )
    speed_noise: float = setting(0.005, '', 'what persists for less, as a share', 0.0, 10.0)
    speed_noise_m: float = setting(20.0, 'm', 'distance over which that persists', 0.0, 1e4)
    # Start
    rest_s: float = setting(1.0, 's', 'standstill used for levelling before the ride', 0.2, 60.0)
    start_sigma_m: float = setting(0.3, 'm', 'where the train stands at the start', 1e-3, 1e4)
    mount_sigma_deg: float = setting(
        5.0, 'deg', "sensor's attitude in the vehicle against mount_rpy_deg", 0.01, 180.0
    )
    mount_known: bool = setting(
        False, '', 'the sensor is turned no further about the vertical than mount_sigma_deg'
    )
    seek_after_s: float = setting(
        3.0, 's', 'without a rest for so long, the ride is taken to be under way', 0.5, 600.0
    )
    lost_after_s: float = setting(
        0.5, 's', 'lost for so long, the train is looked for on the whole line', 0.0, 60.0
    )
    # IMU
    accel_noise: float = setting(
        0.03,
        'm/s^2',
        'error of the force along the line, per sample at 100 Hz, at least',
        0.0,
        10.0,
    )
    vibration_gain: float = setting(
        0.7, '', 'the same as a multiple of the force above 4 Hz', 0.0, 100.0
    )
    gyro_noise: float = setting(1.5e-4, 'rad/s/sqrt(Hz)', 'angle random walk', 0.0, 1.0)
    gyro_vibration_gain: float = setting(
        0.5, '', 'share of the rate above 4 Hz that acts as white noise', 0.0, 10.0
    )
    accel_bias_sigma: float = setting(0.05, 'm/s^2', 'accelerometer bias at start', 1e-6, 10.0)
    accel_bias_walk: float = setting(0.003, 'm/s^2/sqrt(s)', 'bias walk', 0.0, 1.0)
    accel_scale_sigma: float = setting(0.005, '', 'scale error of the accelerometer', 0.0, 0.5)
    gyro_bias_sigma: float = setting(0.006, 'rad/s', 'gyro bias at start', 1e-8, 1.0)
    gyro_bias_walk: float = setting(1.5e-4, 'rad/s/sqrt(s)', 'bias walk', 0.0, 1.0)
    gyro_scale_sigma: float = setting(0.004, '', 'scale error of the gyro', 0.0, 0.5)
    mount_walk: float = setting(1e-4, 'rad/sqrt(s)', 'how a loose mount may turn', 0.0, 1.0)
    # Standstill
    zupt_sigma: float = setting(0.01, 'm/s', 'speed at standstill', 1e-4, 1.0)
    # Output
    lag_s: float = setting(1.0, 's', 'age of what is given out with fixed lag', 0.0, 30.0)

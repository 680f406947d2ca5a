"""Every setting of the coaster's matcher and filters: the only home of their defaults."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from coaster_localization.track_config import TrackFilterConfig
from track_localization.settings import setting

CHANNELS = ('z', 'pitch', 'yaw', 'roll', 'multi')
MATCHERS = ('dtw', 'dtw_derivative', 'dtw_penalised', 'srdtw')


@dataclasses.dataclass(frozen=True)
class MatcherConfig:
    """
    Matching of the measured ride against the design ride (paper 1, section 1).

    ``PAPER_MATCHER`` holds what differs in the paper's own form.
    """

    method: str = setting(
        'dtw_penalised', '', 'matching algorithm; live, dtw_penalised alone', choices=MATCHERS
    )
    channel: str = setting('multi', '', 'what is compared', choices=CHANNELS)
    rate_hz: float = setting(50.0, 'Hz', 'rate both series are resampled to', 5.0, 200.0)
    rest_s: float = setting(2.0, 's', 'standstill kept at both ends of the ride', 0.0, 60.0)
    derivative_weight: float = setting(
        0.2, '', "kd of eq. 14, the derivative's weight, derivatives per second", 0.0, 1e3
    )
    heading: bool = setting(True, '', "find the mount's heading from the ride (multi only)")
    pace_walk: float = setting(
        0.01,
        '1/sqrt(s)',
        "srdtw: random walk of the ride's pace by which its staircase is evened; 0: not at all",
        0.0,
        10.0,
    )
    accel_walk: float = setting(
        0.05, 'm/s/sqrt(s)', 'random walk of the speed against the design', 0.0, 10.0
    )
    match_correlation_s: float = setting(
        2.0, 's', 'srdtw, evened: time over which matching errors persist', 0.02, 60.0
    )
    match_correlation_m: float = setting(
        50.0, 'm', 'srdtw, evened: distance over which they persist', 0.0, 1000.0
    )
    # dtw, dtw_derivative, dtw_penalised
    low_pass_hz: float = setting(2.5, 'Hz', 'zero-phase low-pass of the series', 0.1, 50.0)
    step_penalty: float = setting(
        10.0, '', 'dtw_penalised: cost of a step that is not diagonal', 0.0, 1e6
    )
    standing_weight: float = setting(
        4.0, '', 'dtw_penalised: root cost of a moving sample against a standing one', 0.0, 1e3
    )
    # srdtw
    segment_low_pass_hz: float = setting(1.25, 'Hz', 'the same for srdtw', 0.1, 50.0)
    prominence: float = setting(
        0.4, '', "least height of an extremum, in the design series' deviations", 0.01, 5.0
    )
    plateau: float = setting(
        0.15,
        '',
        'an extremum is cut in the middle of what is this share of prominence off',
        0.0,
        1.0,
    )
    penalty_form: str = setting('power', '', 'form of kg, eq. 14', choices=('power', 'linear'))
    penalty_value: float = setting(
        1.05, '', 'kg = value^d (d in samples at 50 Hz), or 1 + value d (d in 0..1)', 0.0, 1e3
    )
    segment_step_penalty: float = setting(
        0.1, '', 'cost of a step that is not diagonal, inside groups; the paper has none', 0.0, 1e6
    )
    # how sure a match is
    doubt_m: float = setting(10.0, 'm', 'a match further off than this is a gross one', 0.1, 1e3)
    sigma_floor_m: float = setting(0.05, 'm', 'least standard deviation of a match', 0.0, 100.0)
    # online
    observation_rate_hz: float = setting(5.0, 'Hz', 'rate of emitted matches', 0.1, 100.0)
    lag_s: float = setting(1.0, 's', 'age of the sample that is matched', 0.0, 10.0)
    online_rate_hz: float = setting(25.0, 'Hz', 'rate of the rows compared', 5.0, 100.0)
    online_low_pass_hz: float = setting(2.5, 'Hz', 'causal low-pass of the series', 0.1, 50.0)
    online_noise: float = setting(
        0.5, '', "variance of a row's distance, for errors that last", 1e-6, 1e6
    )
    pace_change: float = setting(
        0.003, '', 'probability per row of each neighbouring pace', 0.0, 0.5
    )
    jump: float = setting(0.02, '', 'probability per row of one row more or less', 0.0, 0.3)
    gap_s: float = setting(1.0, 's', 'pause in the samples after which all is sought', 0.05, 10.0)
    seek_after_s: float = setting(
        3.0, 's', 'without a rest for so long, the ride is taken to be under way', 0.5, 600.0
    )
    lost_misfit: float = setting(60.0, '', 'mean distance above which all is sought', 1.0, 1e9)
    lost_after_s: float = setting(5.0, 's', 'time over which it is averaged', 0.1, 100.0)
    unsure_m: float = setting(30.0, 'm', 'matches less sure than this are kept back', 0.1, 1e4)


PAPER_MATCHER: Mapping[str, Any] = {
    'method': 'srdtw',
    'channel': 'z',
    'rate_hz': 50.0,
    'derivative_weight': 0.2,
    'pace_walk': 0.0,
    'segment_low_pass_hz': 1.25,
    'prominence': 0.4,
    'plateau': 0.0,
    'penalty_form': 'power',
    'penalty_value': 1.05,
    'segment_step_penalty': 0.0,
}
"""Overrides that make the matcher the paper's, where the paper says; its kg's form is ours."""


@dataclasses.dataclass(frozen=True)
class EskfConfig:
    """Error-state Kalman filter on IMU and matches (paper 1, section 2)."""

    preset: str = setting(
        'default',
        '',
        "'paper': every match with eq. 21's fixed covariance; 'default': each match by its own "
        'quality, thinned for its correlation, held to the line',
        choices=('default', 'paper'),
    )
    # Observation, preset 'paper'
    lambda_x: float = setting(10.0, 'm^2', 'variance of a match along the vehicle', 1e-6, 1e6)
    n: float = setting(1000.0, '', 'lambda_x over lambda_y and lambda_z', 1e-3, 1e9)
    # Observation, preset 'default'
    match_correlation_s: float = setting(
        0.5, 's', 'time over which matching errors persist: closer matches weigh less', 0.0, 60.0
    )
    match_slow_mps: float = setting(
        12.0, 'm/s', 'below this speed they persist longer, by its square', 0.0, 100.0
    )
    line_sigma_m: float = setting(
        0.02, 'm', 'built track and seat against the design line, across', 1e-4, 10.0
    )
    line_correlation_m: float = setting(
        3.0, 'm', 'distance over which the built track keeps its deviation', 0.0, 1000.0
    )
    gate_nis: float = setting(9.0, '', 'NIS of a match along the track, above it weighs less', 1.0)
    reject_nis: float = setting(50.0, '', 'NIS above which a match is refused', 1.0)
    relocate_s: float = setting(
        6.0, 's', 'beyond the gate without a break for so long, matches are believed', 0.1, 600.0
    )
    history_s: float = setting(10.0, 's', 'how late a match may arrive', 0.1, 120.0)
    # Start
    rest_s: float = setting(3.0, 's', 'standstill used for levelling before the ride', 0.2, 60.0)
    start_sigma_m: float = setting(0.3, 'm', 'where the train stands at the start', 1e-3, 1e4)
    yaw_sigma_deg: float = setting(4.0, 'deg', "sensor's heading in the vehicle", 0.01, 180.0)
    tilt_sigma_deg: float = setting(0.4, 'deg', 'levelling by a biased accelerometer', 0.01, 90.0)
    # IMU
    accel_noise: float = setting(0.003, 'm/s^2/sqrt(Hz)', 'velocity random walk', 0.0, 1.0)
    gyro_noise: float = setting(3e-4, 'rad/s/sqrt(Hz)', 'angle random walk', 0.0, 1.0)
    accel_bias_sigma: float = setting(0.06, 'm/s^2', 'accelerometer bias at start', 1e-6, 10.0)
    gyro_bias_sigma: float = setting(0.006, 'rad/s', 'gyro bias where no rest tells it', 1e-8, 1.0)
    accel_bias_walk: float = setting(0.003, 'm/s^2/sqrt(s)', 'bias walk', 0.0, 1.0)
    gyro_bias_walk: float = setting(1.5e-4, 'rad/s/sqrt(s)', 'bias walk', 0.0, 1.0)
    accel_scale: float = setting(0.004, '', 'scale error of the accelerometer', 0.0, 0.5)
    gyro_scale: float = setting(0.0035, '', 'scale error of the gyro', 0.0, 0.5)
    vibration_gain: float = setting(
        0.35, '', 'share of the force above 4 Hz that acts as white noise', 0.0, 10.0
    )
    # Output
    path_rate_hz: float = setting(5.0, 'Hz', 'poses a second on the path topic', 0.1, 100.0)


@dataclasses.dataclass(frozen=True)
class CoasterConfig:
    """The whole system."""

    matcher: MatcherConfig = MatcherConfig()
    eskf: EskfConfig = EskfConfig()
    track_filter: TrackFilterConfig = dataclasses.field(default_factory=TrackFilterConfig)
    mount_rpy_deg: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), 'deg', 'roll, pitch, yaw of the sensor in the body, ZYX', -180.0, 180.0
    )

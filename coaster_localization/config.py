"""Every setting of the coaster's matcher and filters: the only home of their defaults."""

from __future__ import annotations

import dataclasses

from track_localization.settings import setting

CHANNELS = ('z', 'pitch', 'yaw', 'roll', 'multi')
MATCHERS = ('dtw', 'dtw_derivative', 'dtw_penalised', 'srdtw')


@dataclasses.dataclass(frozen=True)
class MatcherConfig:
    """Matching of the measured ride against the design ride (paper 1, section 1)."""

    method: str = setting('dtw_penalised', '', 'matching algorithm', choices=MATCHERS)
    channel: str = setting('multi', '', 'what is compared', choices=CHANNELS)
    rate_hz: float = setting(50.0, 'Hz', 'rate both series are resampled to', 5.0, 200.0)
    observation_rate_hz: float = setting(5.0, 'Hz', 'rate of emitted matches, online', 0.1, 100.0)


@dataclasses.dataclass(frozen=True)
class EskfConfig:
    """Error-state Kalman filter on IMU and matches (paper 1, section 2)."""

    preset: str = setting('default', '', 'observation covariance', choices=('default', 'paper'))


@dataclasses.dataclass(frozen=True)
class CoasterConfig:
    """The whole system."""

    matcher: MatcherConfig = MatcherConfig()
    eskf: EskfConfig = EskfConfig()
    mount_rpy_deg: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), 'deg', 'roll, pitch, yaw of the sensor in the body, ZYX', -180.0, 180.0
    )

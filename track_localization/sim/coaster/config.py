"""Every error of the simulated coaster, and the scenarios."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from track_localization.errors import DataError
from track_localization.settings import override, setting
from track_localization.sim.imu_error import ImuErrors


@dataclasses.dataclass(frozen=True)
class RideErrors:
    """How the real ride differs from the nominal one; N(1, s) is a factor drawn per run."""

    mass: float = setting(0.05, '', 'mass, N(1, this)', 0.0, 0.3)
    friction: float = setting(0.10, '', 'rolling friction, N(1, this)', 0.0, 0.5)
    drag: float = setting(0.06, '', 'air drag, N(1, this)', 0.0, 0.5)
    wind_mps: float = setting(2.5, 'm/s', 'wind in a random direction, N(0, this)', 0.0, 20.0)
    gusts: float = setting(0.30, '', 'rms of gusts over the mean wind', 0.0, 2.0)
    gust_time_s: float = setting(4.0, 's', 'correlation time of gusts', 0.1, 100.0)
    chain: float = setting(0.03, '', 'chain speed, N(1, this)', 0.0, 0.3)
    tyres: float = setting(0.05, '', 'tyre drive speed, N(1, this)', 0.0, 0.3)
    launch: float = setting(0.03, '', 'launch force, N(1, this)', 0.0, 0.3)
    brake: float = setting(0.08, '', 'brake force, N(1, this)', 0.0, 0.5)
    brake_shift_m: float = setting(0.5, 'm', 'where each brake begins, N(0, this)', 0.0, 5.0)
    start_m: float = setting(0.15, 'm', 'start position, N(0, this)', 0.0, 2.0)
    dwell_before_s: tuple[float, float] = setting(
        (8.0, 40.0), 's', 'standstill before, uniform', 0.0, 3600.0
    )
    dwell_after_s: tuple[float, float] = setting(
        (4.0, 10.0), 's', 'standstill after, uniform', 0.0, 3600.0
    )
    block_stop_s: float = setting(0.0, 's', 'unplanned stop in the first block', 0.0, 600.0)


@dataclasses.dataclass(frozen=True)
class TrackErrors:
    """How the built track differs from its design."""

    deviations: float = setting(1.0, '', 'factor on all deviations of the track', 0.0, 20.0)
    cross_m: float = setting(0.0, 'm', "cross-track rms; 0 takes the track's own", 0.0, 0.5)
    cross_correlation_m: float = setting(8.0, 'm', 'correlation length', 1.0, 100.0)
    along_m: float = setting(0.020, 'm', 'along-track rms', 0.0, 1.0)
    along_correlation_m: float = setting(40.0, 'm', 'correlation length', 5.0, 500.0)
    stretch: float = setting(1.2e-4, '', 'along-track error over distance, either sign', 0.0, 0.01)
    roll_rad: float = setting(0.002, 'rad', 'roll rms (uneven rails)', 0.0, 0.1)
    seat_m: float = setting(0.015, 'm', 'sensor from its nominal place, N(0, this)', 0.0, 0.5)
    build_seed: int = setting(
        -1, '', 'ride seed whose built track all rides get; -1: each seed builds its own', -1
    )


@dataclasses.dataclass(frozen=True)
class Vibration:
    """Vibration of the car, on top of its path."""

    scale: float = setting(1.0, '', 'factor on all vibration', 0.0, 20.0)
    accel_mps2: float = setting(
        0.0, 'm/s^2', "rms per axis at 20 m/s; 0 takes the track's own", 0.0, 50.0
    )
    gyro_radps: float = setting(
        0.0, 'rad/s', "rms per axis at 20 m/s; 0 takes the track's own", 0.0, 5.0
    )
    resonance_hz: tuple[float, float] = setting(
        (7.0, 14.0), 'Hz', 'resonance of each axis, uniform', 0.5, 500.0
    )


@dataclasses.dataclass(frozen=True)
class Clock:
    """Clocks of the recording and of the ground."""

    start_s: float = setting(100.0, 's', "recording's clock at the first sample", 0.0, 1e10)
    offset_s: float = setting(0.0, 's', "ground clock minus recording's clock", -1e6, 1e6)
    random_offset_s: float = setting(0.0, 's', 'further offset, U(-this, this)', 0.0, 1e4)


@dataclasses.dataclass(frozen=True)
class CoasterSimConfig:
    """Everything that can be set on a simulated ride."""

    ride: RideErrors = RideErrors()
    track: TrackErrors = TrackErrors()
    vibration: Vibration = Vibration()
    imu: ImuErrors = dataclasses.field(default_factory=ImuErrors)
    clock: Clock = Clock()


SCENARIOS: Mapping[str, Mapping[str, Any]] = {
    'nominal': {},
    'novib': {'vibration.scale': 0.0},
    'vib3': {'vibration.scale': 3.0},
    'mount0': {'imu.mount_sigma_deg': 0.0},
    'mount8': {'imu.mount': 'angle', 'imu.mount_angle_deg': 8.0},
    'mount20': {'imu.mount': 'angle', 'imu.mount_angle_deg': 20.0},
    'mount90': {'imu.mount': 'angle', 'imu.mount_angle_deg': 90.0},
    'mountany': {'imu.mount': 'any'},
    'dwell0': {'ride.dwell_before_s': (0.0, 0.0)},
    'dwell120': {'ride.dwell_before_s': (120.0, 120.0)},
    'blockstop': {'ride.block_stop_s': 25.0},
    'clip4g': {'imu.clip_g': 4.0},
    'track0': {'track.deviations': 0.0},
    'track3': {'track.deviations': 3.0},
    'shuttle': {},
    'clock_offset': {'clock.random_offset_s': 2.0},
}
"""Differences of each scenario from the defaults; ``shuttle`` also selects the shuttle track."""

PERFECT: Mapping[str, Any] = {
    **{f'ride.{name}': 0.0 for name in ('mass', 'friction', 'drag', 'wind_mps', 'chain')},
    **{f'ride.{name}': 0.0 for name in ('tyres', 'launch', 'brake', 'brake_shift_m', 'start_m')},
    'track.deviations': 0.0,
    'track.seat_m': 0.0,
    'vibration.scale': 0.0,
    **{
        f'imu.{sensor}_{error}': 0.0
        for sensor in ('accel', 'gyro')
        for error in ('bias', 'walk', 'scale', 'noise')
    },
    'imu.jitter_s': 0.0,
    'imu.mount_sigma_deg': 0.0,
}
"""Overrides that switch every error off: the design ride as an ideal sensor feels it."""


def scenario(name: str) -> CoasterSimConfig:
    """Return the configuration of a scenario; raise DataError for an unknown name."""
    if name not in SCENARIOS:
        raise DataError(f'unknown scenario {name!r}; known: {", ".join(SCENARIOS)}')
    return override(CoasterSimConfig(), SCENARIOS[name])

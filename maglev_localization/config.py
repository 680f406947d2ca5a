"""Every setting of the maglev's estimators: the only home of their defaults."""

from __future__ import annotations

import dataclasses

from track_localization.settings import setting

METHODS = ('robust', 'paper', 'kalman')


@dataclasses.dataclass(frozen=True)
class MotionConfig:
    """How a train moves: constant acceleration, changed by white jerk."""

    jerk_density: float = setting(0.1, 'm^2/s^5', 'spectral density of the jerk', 1e-6, 1e3)
    start_sigma_m: float = setting(1.0, 'm', 'of the start, 1 sigma', 1e-3, 1e6)
    start_speed_sigma_mps: float = setting(0.5, 'm/s', 'of the speed at the start', 0.0, 200.0)
    start_known: bool = setting(
        True,
        '',
        'the first loop reading is the chainage, to start_sigma_m; else the train may be anywhere '
        'on the line until a balise tells',
    )


@dataclasses.dataclass(frozen=True)
class LoopConfig:
    """The crossed induction loop, a counter of crossings."""

    pitch_m: float = setting(0.2, 'm', 'distance of crossings; 0: readings are not counts', 0.0, 5)
    slope_sigma: float = setting(1e-4, '', 'of the distance counted per metre, minus 1', 0.0, 0.1)
    slope_walk: float = setting(1e-6, '1/sqrt(m)', 'walk of that slope', 0.0, 0.1)
    offset_walk: float = setting(1e-4, 'm/sqrt(m)', 'walk of the distance counted', 0.0, 1.0)
    noise_m: float = setting(0.02, 'm', 'of a crossing, least that is believed', 1e-6, 10.0)
    missed_share: float = setting(3e-4, '', 'of crossings not counted, or twice', 0.0, 0.2)
    burst_per_m: float = setting(1e-3, '1/m', 'rate of bursts, dead zones, glitches', 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class RadarConfig:
    """The Doppler radar."""

    scale_sigma: float = setting(0.01, '', 'of its scale, minus 1', 0.0, 0.5)
    scale_walk: float = setting(3e-4, '1/sqrt(s)', 'walk of its scale', 0.0, 0.1)
    least_mps: float = setting(0.5, 'm/s', 'not used below this speed', 0.0, 10.0)
    outlier_share: float = setting(0.02, '', 'of readings that mean nothing', 0.0, 0.5)
    slip_per_s: float = setting(0.003, '1/s', 'rate at which its scale changes at once', 0.0, 1.0)
    slip_sigma: float = setting(0.03, '', 'size of such a change of scale', 0.0, 0.5)


@dataclasses.dataclass(frozen=True)
class BaliseConfig:
    """Balises and their reader."""

    wrong_share: float = setting(0.05, '', 'of passings that tell the id of another', 0.0, 0.9)
    nothing_share: float = setting(1e-4, '', 'of passings of no balise in the table', 1e-9, 0.9)
    astray_share: float = setting(1e-3, '', 'of passings that find the train astray', 1e-12, 0.5)
    jitter_s: float = setting(0.002, 's', 'of the time of crossing, 1 sigma', 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class PaperConfig:
    """The paper's federated particle filter; its figures are the defaults (sections 2 to 4)."""

    process_variance: float = setting(0.001, '', 'of W in eq. (3)', 1e-12, 1e3)
    loop_variance: float = setting(0.01, 'm^2', 'of eq. (5)', 1e-9, 1e6)
    radar_variance: float = setting(0.01, 'm^2/s^2', 'of eq. (7)', 1e-9, 1e6)
    share_slow: float = setting(0.8, '', "the loop's share of information when slow", 0.01, 0.99)
    share_fast: float = setting(0.5, '', "the loop's share of information when fast", 0.01, 0.99)
    share_speed_mps: float = setting(70.0, 'm/s', 'where slow ends and fast begins', 0.0, 1e3)
    feedback: str = setting(
        'mean_covariance',
        '',
        'what the master gives back: the mean (eq. 8), or the covariance too',
        choices=('mean', 'mean_covariance'),
    )
    balise: str = setting(
        'rezero',
        '',
        'what a balise does: moves the master only, or sets the loop counter too',
        choices=('master', 'rezero'),
    )
    resampling: str = setting(
        'systematic',
        '',
        'how particles are drawn anew',
        choices=('systematic', 'stratified', 'residual', 'multinomial'),
    )


@dataclasses.dataclass(frozen=True)
class MaglevConfig:
    """All of it."""

    method: str = setting('robust', '', 'how the sensors are fused', choices=METHODS)
    particles: int = setting(1000, '', 'of each local filter (paper); at most (robust)', 1, 1000000)
    seed: int = setting(1, '', 'of every random draw', 0, 2**31)
    horizon_s: float = setting(1.5, 's', 'how late a message may come', 0.0, 60.0)
    motion: MotionConfig = MotionConfig()
    loop: LoopConfig = LoopConfig()
    radar: RadarConfig = RadarConfig()
    balise: BaliseConfig = BaliseConfig()
    paper: PaperConfig = PaperConfig()

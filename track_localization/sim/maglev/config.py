"""Every error of the simulated maglev, and the scenarios."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from track_localization.errors import DataError
from track_localization.settings import override, setting, validate, walk

DAY_S = 86400.0


@dataclasses.dataclass(frozen=True)
class Line:
    """The line and what stands on it."""

    length_m: float = setting(7000.0, 'm', 'length of the line, or of one section', 10.0, 1e6)
    stops_m: str = setting('0 1700 3300 5200 7000', 'm', 'where trains stop, in a section')
    sections: int = setting(1, '', 'equal sections, end to end', 1, 1000)
    curve_radius_m: float = setting(
        0.0, 'm', 'tightest curve; 0: a straight line without track.csv', 0.0, 1e6
    )
    grade: float = setting(0.02, '', 'steepest slope of a line with curves', 0.0, 0.2)


@dataclasses.dataclass(frozen=True)
class MotionErrors:
    """How the train runs."""

    profile: str = setting(
        'stops',
        '',
        'stops: from stop to stop; accelerating: for duration_s from start_speed_mps on',
        choices=('stops', 'accelerating'),
    )
    speed_mps: float = setting(27.8, 'm/s', 'stops: cruising speed', 0.5, 200.0)
    acceleration_mps2: float = setting(1.0, 'm/s^2', 'of starting and braking', 0.01, 10.0)
    jerk_mps3: float = setting(0.5, 'm/s^3', 'stops: greatest jerk', 0.01, 100.0)
    dwell_s: tuple[float, float] = setting(
        (20.0, 20.0), 's', 'stops: standstill at each, uniform', 0.0, DAY_S
    )
    start_chainage_m: tuple[float, float] = setting(
        (0.0, 0.0), 'm', 'stops: where the recording begins, uniform', 0.0, 1e6
    )
    start_moving: bool = setting(
        False, '', 'stops: a start between stops is met at speed, not at a standstill'
    )
    start_speed_mps: float = setting(20.0, 'm/s', 'accelerating: at the start', 0.0, 200.0)
    duration_s: float = setting(100.0, 's', 'accelerating: how long', 1.0, DAY_S)
    jerk_variance: float = setting(
        0.001, 'm^2/s^6', 'accelerating: of the jerk, drawn for each second', 0.0, 10.0
    )


@dataclasses.dataclass(frozen=True)
class LoopErrors:
    """The crossed induction loop; its counter sees a crossing every pitch."""

    rate_hz: float = setting(50.0, 'Hz', 'sampling rate', 0.1, 1000.0)
    absolute: bool = setting(False, '', 'the reading is the chainage itself, not a count')
    noise_m: float = setting(0.0, 'm', 'white noise per sample', 0.0, 10.0)
    pitch_m: float = setting(0.2, 'm', 'distance of crossings', 0.001, 100.0)
    missed: float = setting(2e-4, '', 'share of crossings not counted', 0.0, 1.0)
    extra: float = setting(5e-5, '', 'share of crossings counted twice', 0.0, 1.0)
    bursts_per_km: float = setting(0.5, '1/km', 'mean number of bursts of missed ones', 0.0, 100.0)
    burst: tuple[int, int] = setting((3, 29), '', 'crossings missed in a burst, uniform', 1, 10000)
    dead_zones_per_km: float = setting(0.3, '1/km', 'mean number of zones not counted', 0.0, 100.0)
    dead_zone_m: tuple[float, float] = setting(
        (5.0, 40.0), 'm', 'length of such a zone, uniform', 0.0, 1e4
    )
    glitches: int = setting(1, '', 'lasting jumps of the count in a run', 0, 1000)
    glitch_most: int = setting(40, '', 'greatest jump, either sign', 1, 100000)
    jump_at_balise: float = setting(
        0.0, '', 'chance of a jump within 50 ms of each balise', 0.0, 1.0
    )
    starts_at_chainage: bool = setting(True, '', 'the first reading is the chainage')
    start_reading_m: float = setting(0.0, 'm', 'first reading, if it is not', -1e7, 1e7)
    dead_from_s: float = setting(0.0, 's', 'it fails so long after the start', 0.0, DAY_S)
    dead_for_s: float = setting(0.0, 's', 'for so long', 0.0, DAY_S)
    dead_frozen: bool = setting(False, '', 'failing, it repeats its last reading; else is silent')
    dead_counts: bool = setting(False, '', 'the counter goes on unseen while it fails')


@dataclasses.dataclass(frozen=True)
class RadarErrors:
    """The Doppler radar."""

    rate_hz: float = setting(20.0, 'Hz', 'sampling rate', 0.1, 1000.0)
    scale: float = setting(0.005, '', 'scale factor error, N(0, this)', 0.0, 0.5)
    drift: float = setting(0.002, '', 'rms of its drift', 0.0, 0.5)
    drift_time_s: float = setting(60.0, 's', 'correlation time of the drift', 0.1, 1e5)
    noise_mps: float = setting(0.05, 'm/s', 'white noise per sample', 0.0, 10.0)
    noise_share: float = setting(0.003, '', 'further white noise over the speed', 0.0, 0.5)
    outliers: float = setting(0.01, '', 'share of samples that are outliers', 0.0, 1.0)
    outlier_mps: float = setting(5.0, 'm/s', 'error of an outlier, either sign', 0.0, 100.0)
    slips: int = setting(1, '', 'slips in a run', 0, 1000)
    slip_share: float = setting(0.03, '', 'scale error in a slip, either sign', 0.0, 1.0)
    slip_s: tuple[float, float] = setting((5.0, 15.0), 's', 'length of a slip, uniform', 0.0, DAY_S)
    least_mps: float = setting(0.5, 'm/s', 'unreliable below this speed', 0.0, 10.0)
    least_zero: float = setting(0.5, '', 'share of samples there that read 0', 0.0, 1.0)
    least_noise_mps: float = setting(0.2, 'm/s', 'the others read N(0, this)', 0.0, 10.0)
    dead_from_s: float = setting(0.0, 's', 'it fails so long after the start', 0.0, DAY_S)
    dead_for_s: float = setting(0.0, 's', 'for so long', 0.0, DAY_S)
    dead_frozen: bool = setting(False, '', 'failing, it repeats its last speed; else is silent')


@dataclasses.dataclass(frozen=True)
class BaliseErrors:
    """Balises and their reader."""

    first_m: float = setting(1000.0, 'm', 'chainage of the first', 0.0, 1e6)
    spacing_m: float = setting(1000.0, 'm', 'distance of balises', 1.0, 1e6)
    survey_sigma_m: float = setting(0.05, 'm', 'true place less the table, N(0, this)', 0.0, 10.0)
    missed: float = setting(0.05, '', 'share of passings not heard', 0.0, 1.0)
    wrong_id: float = setting(0.02, '', 'share that tell the id of another', 0.0, 1.0)
    unknown_id: float = setting(0.0, '', 'share that tell an id of no balise', 0.0, 1.0)
    jitter_s: float = setting(0.002, 's', 'of the time of crossing, N(0, this)', 0.0, 1.0)
    offset_sigma_m: float = setting(0.02, 'm', 'error of the offset told, N(0, this)', 0.0, 10)
    dead_from_s: float = setting(0.0, 's', 'none is heard so long after the start', 0.0, DAY_S)
    dead_for_s: float = setting(0.0, 's', 'for so long', 0.0, DAY_S)


@dataclasses.dataclass(frozen=True)
class Delivery:
    """The way of a message from sensor to recording."""

    dropped: float = setting(0.01, '', 'share of messages lost', 0.0, 1.0)
    late: float = setting(0.02, '', 'share of messages held back', 0.0, 1.0)
    late_s: tuple[float, float] = setting((0.2, 1.0), 's', 'by so much, uniform', 0.0, 60.0)
    latency_s: tuple[float, float] = setting(
        (0.010, 0.030), 's', 'least latency of a sensor, uniform per run', 0.0, 60.0
    )
    latency_tail_s: float = setting(0.005, 's', 'mean of the exponential tail', 0.0, 10.0)
    gaps: float = setting(1.0, '', "mean number of gaps in each sensor's messages", 0.0, 1000.0)
    gap_s: tuple[float, float] = setting((0.5, 2.0), 's', 'length of a gap, uniform', 0.0, DAY_S)


@dataclasses.dataclass(frozen=True)
class Clock:
    """The recording's clock."""

    start_s: float = setting(1000.0, 's', 'at the start', 0.0, 1e9)
    truth_rate_hz: float = setting(100.0, 'Hz', 'of the truth', 1.0, 1000.0)
    staggered: bool = setting(True, '', 'sensors sample at phases of their own; else in step')


@dataclasses.dataclass(frozen=True)
class MaglevSimConfig:
    """Everything that can be set on a simulated run."""

    line: Line = Line()
    motion: MotionErrors = MotionErrors()
    loop: LoopErrors = LoopErrors()
    radar: RadarErrors = RadarErrors()
    balise: BaliseErrors = BaliseErrors()
    delivery: Delivery = Delivery()
    clock: Clock = Clock()


UNFAILING: Mapping[str, Any] = {
    'loop.missed': 0.0,
    'loop.extra': 0.0,
    'loop.bursts_per_km': 0.0,
    'loop.dead_zones_per_km': 0.0,
    'loop.glitches': 0,
    'radar.scale': 0.0,
    'radar.drift': 0.0,
    'radar.outliers': 0.0,
    'radar.slips': 0,
    'radar.least_mps': 0.0,
    'balise.missed': 0.0,
    'balise.wrong_id': 0.0,
    'delivery.dropped': 0.0,
    'delivery.late': 0.0,
    'delivery.latency_tail_s': 0.0,
    'delivery.gaps': 0.0,
}
"""Overrides after which nothing fails; quantisation, noise, survey and latency stay."""

PAPER: Mapping[str, Any] = {
    **UNFAILING,
    'line.length_m': 10000.0,
    'motion.profile': 'accelerating',
    'loop.rate_hz': 1.0,
    'loop.absolute': True,
    'loop.noise_m': 0.1,
    'radar.rate_hz': 1.0,
    'radar.noise_mps': 0.1,
    'radar.noise_share': 0.0,
    'balise.survey_sigma_m': 0.0,
    'balise.jitter_s': 0.0,
    'balise.offset_sigma_m': 0.0,
    'delivery.latency_s': (0.0, 0.0),
    'clock.staggered': False,
}
"""The paper's section 4: 20 m/s and 1 m/s^2 for 100 s, a sample a second, variances of 0.01."""

DEAD_FROM_S, DEAD_FOR_S = 150.0, 60.0


def _dead(sensor: str, **more: Any) -> dict[str, Any]:
    spell = {'dead_from_s': DEAD_FROM_S, 'dead_for_s': DEAD_FOR_S, **more}
    return {f'{sensor}.{name}': value for name, value in spell.items()}


SCENARIOS: Mapping[str, Mapping[str, Any]] = {
    'line': {},
    'clean': UNFAILING,
    'paper': PAPER,
    'paper_missed': {
        **PAPER,
        'loop.absolute': False,
        'loop.noise_m': 0.0,
        'loop.missed': 0.0014,
    },
    'wrongid20': {'balise.wrong_id': 0.2},
    'startunknown': {
        'motion.start_chainage_m': (100.0, 4500.0),
        'motion.start_moving': True,
        'loop.starts_at_chainage': False,
    },
    'jumpbalise': {'loop.jump_at_balise': 1.0},
    'loopdead': _dead('loop'),
    'loopfrozen': _dead('loop', dead_frozen=True),
    'radardead': _dead('radar'),
    'radarfrozen': _dead('radar', dead_frozen=True),
    'balisedead': _dead('balise'),
    'long': {'line.sections': 17},
    'curved': {'line.curve_radius_m': 600.0},
}
"""Differences of each scenario from the defaults."""


def check(config: MaglevSimConfig) -> MaglevSimConfig:
    """Return ``config`` itself, or raise DataError for a setting out of range or order."""
    for name, _, value in walk(validate(config)):
        if isinstance(value, tuple) and value[0] > value[1]:
            raise DataError(f'setting {name}: {list(value)}; give the lesser first')
    return config


def scenario(name: str) -> MaglevSimConfig:
    """Return the configuration of a scenario; raise DataError for an unknown name."""
    if name not in SCENARIOS:
        raise DataError(f'unknown scenario {name!r}; known: {", ".join(SCENARIOS)}')
    return override(MaglevSimConfig(), SCENARIOS[name])

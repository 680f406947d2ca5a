"""A simulated maglev run: what loop, radar and balises tell, and what truly happened."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.settings import validate
from track_localization.sim.maglev.balise import hear_balises, lay_balises
from track_localization.sim.maglev.config import MaglevSimConfig
from track_localization.sim.maglev.delivery import deliver
from track_localization.sim.maglev.loop import read_loop
from track_localization.sim.maglev.motion import Motion, plan_motion
from track_localization.sim.maglev.radar import read_radar
from track_localization.track.balise_table import BaliseTable
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

TRUTH_RATE_HZ = 100.0
SENSORS = ('balise', 'loop', 'radar')
"""In the order in which messages of the same arrival are recorded."""


@dataclasses.dataclass(frozen=True)
class Stream:
    """
    Messages of one sensor, in the order of their stamps.

    Attributes:
        time_s: (N,) stamps, the times of measurement [s].
        arrival_s: (N,) when they arrive [s].
        value: (N,) what they tell: loop reading [m], radar speed [m/s], antenna ahead of the
            balise [m].
        variance: (N,) what the sender claims of it.
    """

    time_s: Array
    arrival_s: Array
    value: Array
    variance: Array

    def __len__(self) -> int:
        return len(self.time_s)


@dataclasses.dataclass(frozen=True)
class BaliseStream(Stream):
    """Balises heard; ``id`` (N,) is what they told."""

    id: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class SimulatedRun:
    """
    One run.

    Attributes:
        time_s: (N,) stamps of the truth, 100 Hz, in the recording's clock [s].
        chainage, speed, acceleration: (N,) the truth [m, m/s, m/s^2].
        loop, radar, balise: what the sensors tell.
        table: the balises as surveyed.
        track: the line in ``map``; None where it is straight.
        info: what went wrong, by sensor; times in seconds of the run.
    """

    time_s: Array
    chainage: Array
    speed: Array
    acceleration: Array
    loop: Stream
    radar: Stream
    balise: BaliseStream
    table: BaliseTable
    track: TrackFile | None
    info: dict[str, Any]

    def arrivals(self) -> list[tuple[str, int]]:
        """Return (sensor, row of its stream) of every message in the order of arrival."""
        streams: tuple[Stream, ...] = (self.balise, self.loop, self.radar)
        arrival = np.concatenate([stream.arrival_s for stream in streams])
        names = np.repeat(SENSORS, [len(stream) for stream in streams])
        rows = np.concatenate([np.arange(len(stream)) for stream in streams])
        order = np.argsort(arrival, kind='stable')
        return list(zip(names[order].tolist(), rows[order].tolist(), strict=True))

    def truth(self) -> Trajectory:
        """Return the true motion in ``map``; without a track x is the chainage."""
        zero = np.zeros_like(self.chainage)
        return Trajectory(
            time_s=self.time_s,
            position=np.stack([self.chainage, zero, zero], axis=1),
            velocity=np.stack([self.speed, zero, zero], axis=1),
            chainage=self.chainage,
            speed=self.speed,
        )


def simulate_maglev(config: MaglevSimConfig | None = None, seed: int = 1) -> SimulatedRun:
    """
    Simulate one run; the same arguments give the same bits.

    Motion, survey, sensors and delivery draw from generators of their own, so that a setting of
    one leaves the others as they were. Raise DataError when settings contradict each other.
    """
    config = validate(config or MaglevSimConfig())
    if seed < 0:
        raise DataError(f'seed {seed}: must not be negative')
    rng = dict(zip(PARTS, np.random.SeedSequence(seed).spawn(len(PARTS)), strict=True))
    draw = {part: np.random.default_rng(sequence) for part, sequence in rng.items()}
    motion = plan_motion(draw['motion'], config.line, config.motion)
    length = config.line.length_m * config.line.sections
    table, place = lay_balises(draw['survey'], config.balise, length)
    loop, loop_info = _loop(draw, config, motion, place)
    radar, radar_info = _radar(draw, config, motion)
    balise, balise_info = _balise(draw, config, motion, table, place)
    start = config.clock.start_s
    t = _ticks(motion, TRUTH_RATE_HZ, 0.0)
    s, v, a = motion.at(t)
    info = {'loop': loop_info, 'radar': radar_info, 'balise': balise_info}
    return SimulatedRun(start + t, s, v, a, loop, radar, balise, table, None, info)


PARTS = ('motion', 'survey', 'phase', 'loop', 'radar', 'balise', *(f'{s} way' for s in SENSORS))
"""What draws random numbers of its own."""


def _loop(
    draw: dict[str, Generator], config: MaglevSimConfig, motion: Motion, place: Array
) -> tuple[Stream, dict[str, Any]]:
    phase = draw['phase'].uniform() if config.clock.staggered else 0.0
    t = _ticks(motion, config.loop.rate_hz, phase)
    crossed = motion.passing_times(place)
    crossed = crossed[np.isfinite(crossed)]
    value, variance, info = read_loop(draw['loop'], config.loop, motion, t, crossed)
    e = config.loop
    value, alive = _failing(t, value, e.dead_from_s, e.dead_for_s, e.dead_frozen)
    arrival, kept, way = deliver(draw['loop way'], config.delivery, t, motion.duration_s)
    keep, start = kept & alive, config.clock.start_s
    stream = Stream(start + t[keep], start + arrival[keep], value[keep], variance[keep])
    return stream, {**info, **way}


def _radar(
    draw: dict[str, Generator], config: MaglevSimConfig, motion: Motion
) -> tuple[Stream, dict[str, Any]]:
    phase = draw['phase'].uniform() if config.clock.staggered else 0.0
    t = _ticks(motion, config.radar.rate_hz, phase)
    value, variance, info = read_radar(draw['radar'], config.radar, t, motion.at(t)[1])
    e = config.radar
    value, alive = _failing(t, value, e.dead_from_s, e.dead_for_s, e.dead_frozen)
    arrival, kept, way = deliver(draw['radar way'], config.delivery, t, motion.duration_s)
    keep, start = kept & alive, config.clock.start_s
    stream = Stream(start + t[keep], start + arrival[keep], value[keep], variance[keep])
    return stream, {**info, **way}


def _balise(
    draw: dict[str, Generator],
    config: MaglevSimConfig,
    motion: Motion,
    table: BaliseTable,
    place: Array,
) -> tuple[BaliseStream, dict[str, Any]]:
    heard, info = hear_balises(draw['balise'], config.balise, motion, table, place)
    t, start = heard.time_s, config.clock.start_s
    arrival, keep, way = deliver(draw['balise way'], config.delivery, t, motion.duration_s)
    ids = tuple(told for told, kept in zip(heard.id, keep, strict=True) if kept)
    stream = BaliseStream(
        start + t[keep], start + arrival[keep], heard.offset[keep], heard.variance[keep], ids
    )
    return stream, {**info, **way}


def _ticks(motion: Motion, rate_hz: float, phase: float) -> Array:
    """Return the times of a run at which a sensor samples [s]."""
    count = int(np.floor(motion.duration_s * rate_hz - phase + 1e-9)) + 1
    return np.asarray((np.arange(count) + phase) / rate_hz)


def _failing(
    time_s: Array, value: Array, begin: float, length: float, frozen: bool
) -> tuple[Array, NDArray[np.bool_]]:
    """Return values with a failure in them, and which of them are sent at all."""
    failed = (time_s >= begin) & (time_s < begin + length)
    if not frozen or not failed.any():
        return value, ~failed
    last = max(int(np.argmax(failed)) - 1, 0)
    return np.where(failed, value[last], value), np.ones(len(value), dtype=bool)

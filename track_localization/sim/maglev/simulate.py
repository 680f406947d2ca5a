"""A simulated maglev run: what loop, radar and balises tell, and what truly happened."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.sim.maglev.balise import hear_balises, lay_balises
from track_localization.sim.maglev.config import MaglevSimConfig, check
from track_localization.sim.maglev.delivery import deliver
from track_localization.sim.maglev.guideway import Guideway, guideway_of
from track_localization.sim.maglev.loop import read_loop
from track_localization.sim.maglev.motion import Motion, plan_motion
from track_localization.sim.maglev.radar import read_radar
from track_localization.track.balise_table import BaliseTable
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

SENSORS = ('balise', 'loop', 'radar')
"""In the order in which messages of the same arrival are recorded."""

PARTS = ('motion', 'survey', 'phase', 'loop', 'radar', 'balise', *(f'{s} way' for s in SENSORS))
"""What draws random numbers of its own."""


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

    def columns(self) -> tuple[Array, Array, Array, Array]:
        """Return stamps, arrivals, values and variances."""
        return self.time_s, self.arrival_s, self.value, self.variance


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
        guideway: the line's closed form, which ``track`` samples; None where it is straight.
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
    guideway: Guideway | None = None

    @property
    def duration_s(self) -> float:
        """How long the run is [s]."""
        return float(self.time_s[-1] - self.time_s[0])

    def arrivals(self) -> list[tuple[str, int]]:
        """Return (sensor, row of its stream) of every message in the order of arrival."""
        streams: tuple[Stream, ...] = (self.balise, self.loop, self.radar)
        arrival = np.concatenate([stream.arrival_s for stream in streams])
        names = np.repeat(SENSORS, [len(stream) for stream in streams])
        rows = np.concatenate([np.arange(len(stream)) for stream in streams])
        order = np.argsort(arrival, kind='stable')
        return list(zip(names[order].tolist(), rows[order].tolist(), strict=True))

    def truth(self) -> Trajectory:
        """Return the true motion in ``map``; on a straight line x is the chainage."""
        s, zero = self.chainage, np.zeros_like(self.chainage)
        front, quaternion = np.array([1.0, 0.0, 0.0]), None
        position = np.stack([s, zero, zero], axis=1)
        if self.guideway is not None:
            position, front = self.guideway.position(s), self.guideway.direction(s)
            quaternion = self.guideway.quaternion(s)
        return Trajectory(
            time_s=self.time_s,
            position=position,
            quaternion=quaternion,
            velocity=self.speed[:, None] * front,
            chainage=s,
            speed=self.speed,
        )


def simulate_maglev(config: MaglevSimConfig | None = None, seed: int = 1) -> SimulatedRun:
    """
    Simulate one run; the same arguments give the same bits.

    Motion, survey, sensors and delivery draw from generators of their own, so that a setting of
    one leaves the others as they were. Raise DataError when settings contradict each other.
    """
    config = check(config or MaglevSimConfig())
    if seed < 0:
        raise DataError(f'seed {seed}: must not be negative')
    draw = _generators(seed)
    motion = plan_motion(draw['motion'], config.line, config.motion)
    length = config.line.length_m * config.line.sections
    table, place = lay_balises(draw['survey'], config.balise, length)
    loop, loop_info = _loop(draw, config, motion, place)
    radar, radar_info = _radar(draw, config, motion)
    balise, balise_info = _balise(draw, config, motion, table, place)
    t = _ticks(motion, config.clock.truth_rate_hz, 0.0)
    guideway = guideway_of(config.line)
    return SimulatedRun(
        config.clock.start_s + t,
        *motion.at(t),
        loop=loop,
        radar=radar,
        balise=balise,
        table=table,
        track=guideway.track() if guideway else None,
        info={'loop': loop_info, 'radar': radar_info, 'balise': balise_info},
        guideway=guideway,
    )


def _generators(seed: int) -> dict[str, Generator]:
    """Return a generator for each part of the simulation."""
    sequences = np.random.SeedSequence(seed).spawn(len(PARTS))
    return {p: np.random.default_rng(s) for p, s in zip(PARTS, sequences, strict=True)}


def _loop(
    draw: dict[str, Generator], config: MaglevSimConfig, motion: Motion, place: Array
) -> tuple[Stream, dict[str, Any]]:
    e = config.loop
    t = _ticks(motion, e.rate_hz, _phase(draw, config))
    crossed = motion.passing_times(place)
    crossed = crossed[np.isfinite(crossed)]
    value, variance, info = read_loop(draw['loop'], e, motion, t, crossed)
    value, alive = _failing(t, value, e.dead_from_s, e.dead_for_s, e.dead_frozen)
    way = deliver(draw['loop way'], config.delivery, t, motion.duration_s)
    keep = way.kept & alive
    return _stream(config, t, way.arrival_s, value, variance, keep), {**info, **way.info}


def _radar(
    draw: dict[str, Generator], config: MaglevSimConfig, motion: Motion
) -> tuple[Stream, dict[str, Any]]:
    e = config.radar
    t = _ticks(motion, e.rate_hz, _phase(draw, config))
    value, variance, info = read_radar(draw['radar'], e, t, motion.at(t)[1])
    value, alive = _failing(t, value, e.dead_from_s, e.dead_for_s, e.dead_frozen)
    way = deliver(draw['radar way'], config.delivery, t, motion.duration_s)
    keep = way.kept & alive
    return _stream(config, t, way.arrival_s, value, variance, keep), {**info, **way.info}


def _balise(
    draw: dict[str, Generator],
    config: MaglevSimConfig,
    motion: Motion,
    table: BaliseTable,
    place: Array,
) -> tuple[BaliseStream, dict[str, Any]]:
    heard, info = hear_balises(draw['balise'], config.balise, motion, table, place)
    way = deliver(draw['balise way'], config.delivery, heard.time_s, motion.duration_s)
    plain = _stream(config, heard.time_s, way.arrival_s, heard.offset, heard.variance, way.kept)
    ids = tuple(told for told, kept in zip(heard.id, way.kept, strict=True) if kept)
    stream = BaliseStream(plain.time_s, plain.arrival_s, plain.value, plain.variance, ids)
    return stream, {**info, **way.info}


def _phase(draw: dict[str, Generator], config: MaglevSimConfig) -> float:
    """Return when a sensor first samples, in sample periods."""
    return float(draw['phase'].uniform()) if config.clock.staggered else 0.0


def _ticks(motion: Motion, rate_hz: float, phase: float) -> Array:
    """Return the times of a run at which a sensor samples [s]."""
    count = int(np.floor(motion.duration_s * rate_hz - phase + 1e-9)) + 1
    return np.asarray((np.arange(count) + phase) / rate_hz)


def _stream(
    config: MaglevSimConfig,
    time_s: Array,
    arrival_s: Array,
    value: Array,
    variance: Array,
    keep: NDArray[np.bool_],
) -> Stream:
    start = config.clock.start_s
    return Stream(start + time_s[keep], start + arrival_s[keep], value[keep], variance[keep])


def _failing(
    time_s: Array, value: Array, begin: float, length: float, frozen: bool
) -> tuple[Array, NDArray[np.bool_]]:
    """Return values with a failure in them, and which of them are sent at all."""
    failed = (time_s >= begin) & (time_s < begin + length)
    if not frozen or not failed.any():
        return value, ~failed
    last = max(int(np.argmax(failed)) - 1, 0)
    return np.where(failed, value[last], value), np.ones(len(value), dtype=bool)

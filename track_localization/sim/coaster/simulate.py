"""A simulated coaster ride: what a phone in row 1 records, and what truly happened."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.sim import imu_error
from track_localization.sim.coaster import as_built, marking
from track_localization.sim.coaster.config import CoasterSimConfig, RideErrors
from track_localization.sim.coaster.dynamics import DONE, WHY, Conditions, Run, run_train
from track_localization.sim.coaster.kernels import GUST_STEP_S, STEP_S
from track_localization.sim.coaster.ride_plan import RidePlan
from track_localization.sim.coaster.seat import Motion, SeatPath
from track_localization.sim.coaster.tracks import TRACKS, built_in
from track_localization.sim.coaster.vibration import vibrate
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.markers import Markers
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

DESIGN_RATE_HZ = 100.0
DESIGN_REST_S = 2.0


@dataclasses.dataclass(frozen=True)
class CoasterModel:
    """
    A track made ready for rides.

    Attributes:
        name: what messages call it.
        track: its file, the design line.
        plan: how trains run on it.
        line: the design line, fitted.
        seat: path of the row-1 seat by design.
        design: the nominal ride.
        marks: (16,) chainages of row 1 at the marked places [m].
    """

    name: str
    track: TrackFile
    plan: RidePlan
    line: Centreline
    seat: SeatPath
    design: DesignRide
    marks: Array


@dataclasses.dataclass(frozen=True)
class SimulatedRide:
    """
    One ride.

    Attributes:
        imu: what the sensor recorded, in the recording's clock.
        truth: the row-1 seat (body axes) at the true sampling times.
        design: the nominal ride on the design track.
        track: the design track.
        markers: passing of the 16 marked places.
        R_bm: (3, 3) the mount: rotates sensor axes to body axes.
        clock_offset_s: ground clock minus recording's clock, as in ``markers``.
    """

    imu: ImuSeries
    truth: Trajectory
    design: DesignRide
    track: TrackFile
    markers: Markers
    R_bm: Array
    clock_offset_s: float


def prepare(track: TrackFile, plan: RidePlan, name: str = 'track') -> CoasterModel:
    """
    Fit the line, run the nominal ride and choose the marked places.

    Raise DataError when the nominal train does not get round.
    """
    line = Centreline.from_track(track)
    seat = SeatPath(line, plan.train, plan.line_height_m, np.zeros(3))
    run = run_train(line, plan)
    if run.outcome != DONE:
        raise DataError(
            f'{name}: {WHY[run.outcome]} at {run.s[-1]:.1f} m with nominal settings; '
            'change the ride plan: more speed, another brake, a station to stop in'
        )
    design = _design_ride(line, seat, run)
    return CoasterModel(name, track, plan, line, seat, design, marking.places(line, run))


@functools.cache
def built_in_model(name: str) -> CoasterModel:
    """Return a built-in track made ready; raise DataError for an unknown name."""
    if name not in TRACKS:
        raise DataError(f'unknown track {name!r}; built in: {", ".join(TRACKS)}')
    track = built_in(name)
    return prepare(track.file, track.plan, name)


def simulate_coaster(
    track: str | CoasterModel, config: CoasterSimConfig | None = None, seed: int = 1
) -> SimulatedRide:
    """
    Simulate one ride; the same arguments give the same bits.

    ``track`` is the name of a built-in track or a model from ``prepare``. Raise DataError when
    the train of this seed does not get round.
    """
    model = built_in_model(track) if isinstance(track, str) else track
    config = config or CoasterSimConfig()
    ride_rng, track_rng, imu_rng, vibration_rng, clock_rng = _generators(seed)
    plan = model.plan
    if config.ride.block_stop_s > 0.0:
        plan = plan.with_block_stop(config.ride.block_stop_s)
    run, before, after = _run(ride_rng, model, plan, config.ride, seed)
    t, s, v, a = _sampled(run, 1.0 / config.imu.rate_hz, before, after)
    seat = _built_seat(track_rng, model, config)
    motion = seat.motion(s, v, a)
    R_bm = imu_error.draw_mount(imu_rng, config.imu)
    shake, twist = _vibration(vibration_rng, model.plan, config, v, s)
    force, rate = imu_error.corrupt(
        imu_rng,
        motion.specific_force @ R_bm + shake,
        motion.angular_rate @ R_bm + twist,
        config.imu,
    )
    start = config.clock.start_s
    stamps = imu_error.jitter(imu_rng, start + t, config.imu.jitter_s)
    spread = config.clock.random_offset_s
    offset = config.clock.offset_s + (clock_rng.uniform(-spread, spread) if spread else 0.0)
    passing = start + before + marking.passing_times(run, model.marks)
    return SimulatedRide(
        imu=ImuSeries(stamps, force, rate),
        truth=_truth(start + t, motion, seat.chainage(s), model.line),
        design=model.design,
        track=model.track,
        markers=marking.markers(passing + offset, model.seat.position(model.marks)),
        R_bm=R_bm,
        clock_offset_s=float(offset),
    )


def _generators(seed: int) -> list[Generator]:
    """Return the generators of ride, built track, sensor, vibration and clock."""
    return [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(5)]


def _run(
    rng: Generator, model: CoasterModel, plan: RidePlan, errors: RideErrors, seed: int
) -> tuple[Run, float, float]:
    """Run the perturbed train; return the run and the dwell before and after it [s]."""
    conditions = draw_conditions(rng, errors, plan)
    before = float(rng.uniform(*errors.dwell_before_s))
    after = float(rng.uniform(*errors.dwell_after_s))
    run = run_train(model.line, plan, conditions)
    if run.outcome != DONE:
        raise DataError(
            f'{model.name}: with seed {seed} {WHY[run.outcome]} at {run.s[-1]:.1f} m; '
            'take another seed, or milder ride.* errors'
        )
    return run, before, after


def _truth(time_s: Array, motion: Motion, chainage: Array, line: Centreline) -> Trajectory:
    return Trajectory(
        time_s=time_s,
        position=motion.position,
        quaternion=motion.quaternion,
        velocity=motion.velocity,
        chainage=chainage % line.length if line.closed else chainage,
        speed=np.linalg.norm(motion.velocity, axis=1),
    )


def draw_conditions(rng: Generator, errors: RideErrors, plan: RidePlan) -> Conditions:
    """Draw the factors, brakes, start and wind of one ride."""
    e = errors

    def factor(sigma: float) -> float:
        return float(1.0 + sigma * np.clip(rng.standard_normal(), -4.0, 4.0))

    mass, friction, drag = factor(e.mass), factor(e.friction), factor(e.drag)
    chain, tyres, launch, brake = (
        factor(e.chain),
        factor(e.tyres),
        factor(e.launch),
        factor(e.brake),
    )
    start = float(e.start_m * rng.standard_normal())
    course, wind = rng.uniform(0.0, np.pi), e.wind_mps * float(rng.standard_normal())
    shifts = e.brake_shift_m * rng.standard_normal(len(plan.zones))
    keep = np.exp(-GUST_STEP_S / e.gust_time_s)
    steps = rng.standard_normal(2000)
    gusts = itertools.accumulate(
        steps[1:], lambda g, n: keep * g + np.sqrt(1.0 - keep**2) * n, initial=steps[0]
    )
    return Conditions(
        mass=mass,
        friction=friction,
        drag=drag,
        chain=chain,
        tyres=tyres,
        launch=launch,
        brake=brake,
        brake_shift_m=tuple(float(x) for x in shifts),
        start_shift_m=start,
        wind_mps=(float(wind * np.cos(course)), float(wind * np.sin(course))),
        gusts=tuple(1.0 + e.gusts * float(g) for g in gusts),
    )


def _built_seat(rng: Generator, model: CoasterModel, config: CoasterSimConfig) -> SeatPath:
    """Return the seat's path on the track as built for this run."""
    e, line = config.track, model.line
    offset = e.seat_m * rng.standard_normal(3)
    if e.build_seed >= 0:
        # The sensor's place is this ride's own; the track is the one that build_seed would have.
        rng = _generators(e.build_seed)[1]
        rng.standard_normal(3)
    deviations = as_built.build(
        rng,
        line.length,
        line.closed,
        e.deviations * (e.cross_m or model.plan.cross_track_m),
        e.cross_correlation_m,
        e.deviations * e.along_m,
        e.along_correlation_m,
        e.deviations * e.stretch,
        e.deviations * e.roll_rad,
    )
    return SeatPath(line, model.plan.train, model.plan.line_height_m, offset, deviations)


def _vibration(
    rng: Generator, plan: RidePlan, config: CoasterSimConfig, v: Array, s: Array
) -> tuple[Array, Array]:
    """Return the vibration of force and rate (N, 3) along this run."""
    e = config.vibration
    levels = (e.accel_mps2 or plan.vibration_mps2, e.gyro_radps or plan.gyro_vibration_radps)
    force, rate = (
        vibrate(
            rng,
            v,
            s,
            config.imu.rate_hz,
            e.scale * level,
            e.resonance_hz,
            plan.joint_spacing_m,
            plan.train.wheelbase_m,
        )
        for level in levels
    )
    return force, rate


def _sampled(run: Run, dt: float, before: float, after: float) -> tuple[Array, Array, Array, Array]:
    """Return time, s, v, a (N,) every ``dt`` with standstill before and after the run."""
    count = int(np.floor((before + run.time_s[-1] + after) / dt)) + 1
    t = np.asarray(dt * np.arange(count), dtype=np.float64)
    x = np.clip(t - before, 0.0, run.time_s[-1])
    inside = (t >= before) & (t <= before + run.time_s[-1])
    i = np.minimum((x / STEP_S).astype(np.int64), len(run.s) - 2)
    h, u = STEP_S, x / STEP_S - i
    s0, s1, v0, v1 = run.s[i], run.s[i + 1], run.v[i], run.v[i + 1]
    s = s0 + h * u * v0 + u**2 * (3.0 * (s1 - s0) - h * (2.0 * v0 + v1))
    s = s + u**3 * (2.0 * (s0 - s1) + h * (v0 + v1))
    v = (1.0 - u) * v0 + u * v1
    a = (1.0 - u) * run.a[i] + u * run.a[i + 1]
    return t, s, np.asarray(np.where(inside, v, 0.0)), np.asarray(np.where(inside, a, 0.0))


def _design_ride(line: Centreline, seat: SeatPath, run: Run) -> DesignRide:
    t, s, v, a = _sampled(run, 1.0 / DESIGN_RATE_HZ, DESIGN_REST_S, DESIGN_REST_S)
    motion = seat.motion(s, v, a)
    return DesignRide(
        time_s=t,
        chainage=seat.chainage(s),
        position=motion.position,
        quaternion=motion.quaternion,
        velocity=motion.velocity,
        specific_force=motion.specific_force,
        angular_rate=motion.angular_rate,
    )

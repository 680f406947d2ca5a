"""A simulated train run: what IMU, receiver and odometer tell, and what truly happened."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSeries
from track_localization.geodesy import Datum, enu_from_geodetic
from track_localization.sim.train.alignment import set_out
from track_localization.sim.train.config import TrainSimConfig
from track_localization.sim.train.faults import spoil_gnss, spoil_imu, spoil_wheel
from track_localization.sim.train.gnss import GnssStream, read_gnss
from track_localization.sim.train.inertial import corrupt, start_sigmas
from track_localization.sim.train.motion import Motion, plan_motion
from track_localization.sim.train.odometer import Spans, draw_slips, read_odometer
from track_localization.sim.train.route import Pose, Route, axes_in_map, quaternions, radii
from track_localization.sim.train.run import LocalTruth, SimulatedRun, StartPose, WheelStream
from track_localization.sim.train.scenarios import check
from track_localization.sim.train.survey import survey
from track_localization.sim.train.terrain import Cover, lay_cover, see
from track_localization.sim.train.waves import draw_waves
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

PARTS = (
    *('line', 'motion', 'terrain', 'mount', 'survey', 'phase', 'start'),
    *('imu', 'sky', 'gnss', 'slips', 'wheel', 'wheel way'),
    *('imu faults', 'gnss faults', 'wheel faults', 'rails'),
)
"""What draws random numbers of its own."""

CLEAR_M = 800.0
"""The sky is open for so long after the start and before the end [m]."""


class World(NamedTuple):
    """What truly is: the line on the Earth, the run along it, the cover, and the IMU's mount."""

    route: Route
    motion: Motion
    cover: Cover
    mount: Array
    outages: Spans

    def chainage(self, time_s: Array) -> Array:
        """Return the true chainage (N,) at times of the run."""
        return self.route.start + self.motion.at(time_s)[0]

    def pose(self, time_s: Array) -> Pose:
        """Return how the IMU lies and moves at times (N,) of the run."""
        way, speed, _ = self.motion.at(time_s)
        pose = self.route.pose(self.route.start + way, speed)
        return pose._replace(attitude=pose.attitude @ self.mount.T)


def simulate_train(config: TrainSimConfig | None = None, seed: int = 1) -> SimulatedRun:
    """
    Simulate one run; the same arguments give the same bits.

    Line, motion, sensors and faults draw from generators of their own, so that a setting of one
    leaves the others as they were. Raise DataError when settings contradict each other.
    """
    config = check(config or TrainSimConfig())
    if seed < 0:
        raise DataError(f'seed {seed}: must not be negative')
    sequences = np.random.SeedSequence(seed).spawn(len(PARTS))
    draw = {p: np.random.default_rng(s) for p, s in zip(PARTS, sequences, strict=True)}
    world = _world(draw, config)
    imu, arrival, imu_info = _imu(draw, config, world)
    gnss, gnss_info = _gnss(draw, config, world)
    wheel, wheel_info = _wheel(draw, config, world)
    track, track_info = _track(draw['survey'], config, world.route)
    truth = _truth(config, world)
    return SimulatedRun(
        **truth,
        datum=world.route.datum,
        mount=world.mount,
        imu=imu,
        imu_arrival_s=arrival,
        gnss=gnss,
        wheel=wheel,
        start=_start(draw['start'], config, truth),
        track=track,
        outages=[(config.clock.start_s + a, config.clock.start_s + b) for a, b in world.outages],
        info={
            'imu': imu_info,
            'gnss': gnss_info,
            'wheel': wheel_info,
            'track': track_info,
            'curves_m': world.route.alignment.curve.tolist(),
            'tunnels_m': world.cover.tunnel.tolist(),
            'cuttings_m': world.cover.cutting.tolist(),
            'outages_s': [list(span) for span in world.outages],
        },
    )


def _world(draw: dict[str, Generator], config: TrainSimConfig) -> World:
    motion = plan_motion(draw['motion'], config.motion)
    lead, end = config.line.lead_m, config.line.lead_m + motion.distance_m
    alignment = set_out(draw['line'], config.line, end + lead, float(motion.speed.max()))
    datum = Datum(
        float(np.radians(config.line.latitude_deg)),
        float(np.radians(config.line.longitude_deg)),
        config.line.height_m,
    )
    clear = min(CLEAR_M, 0.1 * motion.distance_m)
    cover = lay_cover(draw['terrain'], config.terrain, lead + clear, end - clear)
    yaw, pitch = np.radians(config.odometer.mount_deg) * draw['mount'].standard_normal(2)
    mount = so3.matrix_from_rpy(0.0, float(pitch), float(yaw))
    spans = motion.passing_times(cover.tunnel - lead)
    outages = [(float(a), float(b)) for a, b in spans]
    if config.gnss.outage_s[1] > config.gnss.outage_s[0]:
        outages.append(config.gnss.outage_s)
    route = Route.lay(alignment, datum, lead, draw_waves(draw['rails'], config.rails))
    return World(route, motion, cover, mount, sorted(outages))


def _truth(config: TrainSimConfig, world: World) -> dict[str, Any]:
    """Return the truth's part of a run."""
    t = _ticks(world.motion, config.clock.truth_rate_hz, 0.0)
    pose = world.pose(t)
    place = pose.latitude, pose.longitude, pose.height
    R = axes_in_map(pose.latitude, pose.longitude, world.route.datum)
    return {
        'time_s': config.clock.start_s + t,
        'position': enu_from_geodetic(*place, world.route.datum),
        'velocity': np.einsum('nij,nj->ni', R, pose.velocity),
        'quaternion': quaternions(R @ pose.attitude),
        'chainage': world.chainage(t),
        'speed': world.motion.at(t)[1],
        'local': LocalTruth(*place, pose.velocity, quaternions(pose.attitude)),
    }


def _imu(
    draw: dict[str, Generator], config: TrainSimConfig, world: World
) -> tuple[ImuSeries, Array, dict[str, Any]]:
    t = _ticks(world.motion, config.imu.rate_hz, 0.0)
    way, speed, acceleration = world.motion.at(t)
    f, w = world.route.inertial(world.route.start + way, speed, acceleration)
    f, w = f @ world.mount.T, w @ world.mount.T
    f, w, info = corrupt(draw['imu'], config.imu, f, w)
    told, keep, wrong = spoil_imu(draw['imu faults'], config.faults, ImuSeries(t, f, w))
    start = config.clock.start_s
    series = ImuSeries(start + told.time_s, told.specific_force, told.angular_rate)[keep]
    return series, start + t[keep], {**info, **wrong}


def _gnss(
    draw: dict[str, Generator], config: TrainSimConfig, world: World
) -> tuple[GnssStream, dict[str, Any]]:
    t = _ticks(world.motion, config.gnss.rate_hz, _phase(draw, config))
    sky = see(draw['sky'], config.terrain, world.cover, t, world.chainage(t))
    antenna = _moved(world.pose(t), np.array(config.gnss.lever_m))
    stream, info = read_gnss(draw['gnss'], config.gnss, t, antenna, sky)
    stream, wrong = spoil_gnss(draw['gnss faults'], config.faults, stream)
    start = config.clock.start_s
    shifted = dataclasses.replace(
        stream, time_s=start + stream.time_s, arrival_s=start + stream.arrival_s
    )
    return shifted, {**info, **wrong}


def _wheel(
    draw: dict[str, Generator], config: TrainSimConfig, world: World
) -> tuple[WheelStream, dict[str, Any]]:
    e = config.odometer
    t = _ticks(world.motion, e.rate_hz, _phase(draw, config))
    t = t[t >= 1.0 / e.rate_hz]
    slips = draw_slips(draw['slips'], e, world.motion, world.outages)
    speed, variance, info = read_odometer(draw['wheel'], e, world.motion, t, slips)
    arrival = t + draw['wheel way'].uniform(*e.latency_s, len(t))
    stamps, speed, wrong = spoil_wheel(draw['wheel faults'], config.faults, t, speed)
    yaw, pitch, _ = so3.euler_zyx(world.mount)
    mount = {'mount_yaw_deg': float(np.degrees(yaw)), 'mount_pitch_deg': float(np.degrees(pitch))}
    if config.faults.no_wheel:
        stamps, arrival, speed, variance = (np.zeros(0) for _ in range(4))
    start = config.clock.start_s
    stream = WheelStream(start + stamps, start + arrival, speed, variance)
    return stream, {**info, **wrong, **mount}


def _track(
    rng: Generator, config: TrainSimConfig, route: Route
) -> tuple[TrackFile | None, dict[str, Any]]:
    if not config.survey.given:
        return None, {}
    return survey(rng, config.survey, route)


def _start(rng: Generator, config: TrainSimConfig, truth: dict[str, Any]) -> StartPose | None:
    """Return the pose that an aligned start is told, with its errors."""
    level, yaw = start_sigmas(config.start, config.imu)
    place = config.start.horizontal_m, config.start.horizontal_m, config.start.vertical_m
    sigma = np.array([*place, level, level, yaw])
    error = sigma * rng.standard_normal(6)
    if not config.start.given:
        return None
    true = so3.matrix_from_quat(truth['quaternion'][0])
    told = so3.quat_from_matrix(so3.exp(error[3:]) @ true)
    position = truth['position'][0] + error[:3]
    return StartPose(float(truth['time_s'][0]), position, told, np.diag(sigma**2))


def _moved(pose: Pose, lever: Array) -> Pose:
    """Return the pose of a point (3,) of the body; its velocity is left as it is."""
    meridian, across = radii(pose.latitude)
    way = pose.attitude @ lever
    return pose._replace(
        latitude=pose.latitude + way[:, 1] / (meridian + pose.height),
        longitude=pose.longitude + way[:, 0] / ((across + pose.height) * np.cos(pose.latitude)),
        height=pose.height + way[:, 2],
    )


def _phase(draw: dict[str, Generator], config: TrainSimConfig) -> float:
    """Return when a sensor first samples, in sample periods."""
    return float(draw['phase'].uniform()) if config.clock.staggered else 0.0


def _ticks(motion: Motion, rate_hz: float, phase: float) -> Array:
    """Return the times of a run at which a sensor samples [s]."""
    count = int(np.floor(motion.duration_s * rate_hz - phase + 1e-9)) + 1
    return np.asarray((np.arange(count) + phase) / rate_hz)

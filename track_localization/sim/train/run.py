"""What a simulated train run consists of."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.geodesy import Datum
from track_localization.sim.train.gnss import GnssStream
from track_localization.sim.train.odometer import Spans
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class WheelStream:
    """Speeds of the odometer (N,) [m/s], stamped at the ends of their intervals; arrivals [s]."""

    time_s: Array
    arrival_s: Array
    speed: Array
    variance: Array

    def __len__(self) -> int:
        return len(self.time_s)


@dataclasses.dataclass(frozen=True)
class StartPose:
    """
    What an aligned start is told: a pose in ``map`` and the covariance of its errors.

    Attributes:
        time_s: stamp, the run's first [s].
        position: (3,) [m].
        quaternion: (4,) x, y, z, w, IMU axes to ``map``.
        covariance: (6, 6) of the position [m^2] and of rotations about x, y, z of ``map`` [rad^2].
    """

    time_s: float
    position: Array
    quaternion: Array
    covariance: Array


@dataclasses.dataclass(frozen=True)
class LocalTruth:
    """
    The truth against the horizon where the train is, as a strapdown mechanisation has it.

    Attributes:
        latitude, longitude: (N,) [rad].
        height: (N,) above the ellipsoid [m].
        velocity: (N, 3) east, north, up there [m/s].
        quaternion: (N, 4) x, y, z, w, IMU axes to east, north, up there.
    """

    latitude: Array
    longitude: Array
    height: Array
    velocity: Array
    quaternion: Array


@dataclasses.dataclass(frozen=True)
class SimulatedRun:
    """
    One run. The truth's body is the IMU: ``mount`` turns vehicle axes into its axes.

    Attributes:
        time_s: (N,) stamps of the truth, 100 Hz, in the recording's clock [s].
        position: (N, 3) in ``map``, the Cartesian east-north-up frame of ``datum`` [m].
        velocity: (N, 3) in ``map`` [m/s].
        quaternion: (N, 4) x, y, z, w, IMU axes to ``map``.
        chainage: (N,) arc length along the true line, 0 where ``track`` begins [m].
        speed: (N,) along the line [m/s].
        local: the same truth against the local horizon.
        datum: origin of ``map``: where the train starts.
        mount: (3, 3) R_bv, vehicle (odometer) axes to IMU axes.
        imu: what the IMU tells, in its own axes; stamps as sent.
        imu_arrival_s: (M,) when its samples arrive [s].
        gnss: the fixes.
        wheel: the odometer; empty where there is none.
        start: what an aligned start is told; None where it is not.
        track: the line as surveyed; None where it is not given.
        outages: (from, to) of each spell without satellites [s].
        info: what was injected, by sensor; times in seconds of the run.
    """

    time_s: Array
    position: Array
    velocity: Array
    quaternion: Array
    chainage: Array
    speed: Array
    local: LocalTruth
    datum: Datum
    mount: Array
    imu: ImuSeries
    imu_arrival_s: Array
    gnss: GnssStream
    wheel: WheelStream
    start: StartPose | None
    track: TrackFile | None
    outages: Spans
    info: dict[str, Any]

    @property
    def duration_s(self) -> float:
        """How long the run is [s]."""
        return float(self.time_s[-1] - self.time_s[0])

    def truth(self) -> Trajectory:
        """Return the true motion in ``map``."""
        return Trajectory(
            time_s=self.time_s,
            position=self.position,
            quaternion=self.quaternion,
            velocity=self.velocity,
            chainage=self.chainage,
            speed=self.speed,
        )

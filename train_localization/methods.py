"""Every train method by name, run over one recording: what an evaluation compares."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization import garbage
from track_localization.estimation.trajectory import Trajectory
from track_localization.geodesy import Datum
from track_localization.track.centreline import Centreline
from train_localization.config import TrainConfig
from train_localization.estimate import Estimate
from train_localization.measurements import Measurement
from train_localization.pipeline import TrainPipeline, with_method
from train_localization.smoothing import Ride, smoothed

Array = NDArray[np.float64]

INS, PAPER, ROBUST, MAP, SMOOTHED = 'ins', 'paper', 'robust', 'robust_map', 'smoothed'
METHODS = (INS, PAPER, ROBUST, MAP, SMOOTHED)


class GivenStart(NamedTuple):
    """
    A pose in ``map`` that every method is told; see ``TrainPipeline.set_start``.

    Attributes:
        time_s: when the train was there [s].
        position: (3,) [m].
        quaternion: (4,) body to ``map``.
        covariance: (6, 6) of position and of the rotation about the axes of ``map``.
    """

    time_s: float
    position: Array
    quaternion: Array
    covariance: Array


@dataclasses.dataclass(frozen=True)
class MethodResult:
    """
    What one method made of a recording.

    Attributes:
        name: of the method.
        trajectory: its estimates, in ``map``.
        velocity_covariance: (N, 3, 3) of them, in ``map`` [m^2/s^2].
        modes: (stamp [s], what the position rests on from then on), oldest first.
        rejected: refused measurements, sensor -> reason -> count.
        runtime_s: processor time spent [s].
        notes: what a reader should know.
    """

    name: str
    trajectory: Trajectory
    velocity_covariance: Array
    modes: list[tuple[float, str]]
    rejected: dict[str, dict[str, int]]
    runtime_s: float
    notes: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class _Run:
    """A pipeline that has been through a recording; ``ride`` where it is to be smoothed."""

    pipeline: TrainPipeline
    estimates: list[Estimate]
    ride: Ride
    seconds: float
    notes: tuple[str, ...] = ()


def run_methods(
    measurements: Sequence[Measurement],
    config: TrainConfig,
    track: Centreline | None = None,
    datum: Datum | None = None,
    methods: Sequence[str] = METHODS,
    begin: Callable[[str], None] | None = None,
    start: GivenStart | None = None,
) -> Iterator[MethodResult]:
    """
    Yield each method's result; measurements in order of arrival, ``begin`` told its name.

    ``robust_map`` needs a track and is left out without; ``smoothed`` smooths it, or ``robust``
    without a track, and shares its run.
    """
    base = ROBUST if track is None else MAP
    runs: dict[str, _Run] = {}

    def run(method: str) -> _Run:
        if method not in runs:
            keep = method == base and SMOOTHED in methods
            pipeline = TrainPipeline(with_method(config, method), track, datum)
            runs[method] = _through(pipeline, measurements, start, config.horizon_s, keep)
        return runs[method]

    for name in methods:
        if name == MAP and track is None:
            continue
        if begin is not None:
            begin(name)
        if name == SMOOTHED:
            yield _smoothed(run(base), base)
        else:
            done = run(name)
            yield _result(name, done.pipeline, done.estimates, done.seconds, done.notes)
            if name != base:
                del runs[name]


@garbage.paused()
def _through(
    pipeline: TrainPipeline,
    measurements: Sequence[Measurement],
    start: GivenStart | None,
    horizon_s: float,
    keep: bool,
) -> _Run:
    """Run a pipeline over a recording; with ``keep`` note every step."""
    began = time.process_time()
    if start is not None:
        pipeline.set_start(*start)
    estimates: list[Estimate] = []
    ride, notes = Ride(horizon_s), []
    try:
        for measurement in measurements:
            given = pipeline.push(measurement)
            if given:
                estimates += given
                if keep:
                    ride.note(pipeline)
    except np.linalg.LinAlgError as error:
        notes.append(f'ended early, its numbers are none: {error}')
    ride.finish()
    return _Run(pipeline, estimates, ride, time.process_time() - began, tuple(notes))


def _smoothed(run: _Run, base: str) -> MethodResult:
    began = time.process_time()
    estimates = smoothed(run.ride, run.pipeline)
    seconds = run.seconds + time.process_time() - began
    return _result(SMOOTHED, run.pipeline, estimates, seconds, (f'made of {base}', *run.notes))


def _result(
    name: str,
    pipeline: TrainPipeline,
    estimates: Sequence[Estimate],
    seconds: float,
    notes: tuple[str, ...] = (),
) -> MethodResult:
    trajectory, velocity_covariance = trajectory_of(estimates)
    if not estimates:
        notes = (*notes, 'no estimate at all: it never found a start')
    return MethodResult(
        name,
        trajectory,
        velocity_covariance,
        modes_of(estimates),
        pipeline.rejected,
        seconds,
        notes,
    )


def modes_of(estimates: Sequence[Estimate]) -> list[tuple[float, str]]:
    """Return (stamp [s], mode) wherever the mode changes."""
    changes: list[tuple[float, str]] = []
    for estimate in estimates:
        if not changes or estimate.mode != changes[-1][1]:
            changes.append((estimate.time_s, estimate.mode))
    return changes


def trajectory_of(estimates: Sequence[Estimate]) -> tuple[Trajectory, Array]:
    """
    Return estimates as a trajectory and the covariances (N, 3, 3) of their velocities.

    Of two at one stamp the later one counts.
    """
    last = {estimate.time_s: estimate for estimate in estimates}
    kept = [last[time_s] for time_s in sorted(last)]
    velocity = np.array([e.velocity for e in kept], dtype=np.float64).reshape(-1, 3)
    P = np.array([e.covariance[:6, :6] for e in kept], dtype=np.float64).reshape(-1, 6, 6)
    speed = np.linalg.norm(velocity, axis=1)
    ahead = velocity / np.maximum(speed, 1e-6)[:, None]
    on_line = bool(kept) and all(e.chainage is not None for e in kept)
    trajectory = Trajectory(
        time_s=np.array([e.time_s for e in kept], dtype=np.float64),
        position=np.array([e.position for e in kept], dtype=np.float64).reshape(-1, 3),
        quaternion=np.array([e.quaternion for e in kept], dtype=np.float64).reshape(-1, 4),
        velocity=velocity,
        chainage=np.array([e.chainage for e in kept], dtype=np.float64) if on_line else None,
        speed=speed,
        covariance=P[:, :3, :3],
        sigma_along=np.array([e.sigma_along for e in kept], dtype=np.float64) if on_line else None,
        sigma_speed=np.sqrt(np.maximum(np.einsum('ni,nij,nj->n', ahead, P[:, 3:, 3:], ahead), 0.0)),
    )
    return trajectory, P[:, 3:, 3:]

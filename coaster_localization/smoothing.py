"""Whole-ride estimates: the filter run over a recording, then Rauch-Tung-Striebel smoothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coaster_localization.estimate import Estimate, Prediction
from coaster_localization.observation import MatchObservation
from coaster_localization.pipeline import CoasterEskf
from track_localization.estimation import eskf, so3
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.smoother import rts_smooth
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.line_table import LineTable

Array = NDArray[np.float64]


def run_filter(
    filter_: CoasterEskf, imu: ImuSeries, matches: Sequence[MatchObservation]
) -> list[Estimate]:
    """Run the filter over a recording, every match in its place in time."""
    estimates: list[Estimate] = []
    pending = sorted(matches, key=lambda m: m.time_s)
    done = 0
    for i in range(len(imu)):
        sample = imu.sample(i)
        # A match belongs to the latest sample that is not after it.
        while done < len(pending) and pending[done].time_s < sample.time_s:
            filter_.push(pending[done])
            done += 1
        estimates += filter_.push(sample)
    for match in pending[done:]:
        filter_.push(match)
    return estimates


def to_trajectory(
    time_s: Array, x: Array, P_position: Array, P_velocity: Array, line: LineTable
) -> Trajectory:
    """
    Return nominal states (N, 24) with position and velocity covariances (N, 3, 3) as a trajectory.

    The chainage is the projection on the line, followed from row to row.
    """
    position, velocity = x[:, 0:3], x[:, 3:6]
    chainage = line.follow(position, line.nearest(position[0]) if len(time_s) else 0.0)
    tangent = line.axes[[line.index(s) for s in chainage.tolist()], :, 0]
    speed = np.linalg.norm(velocity, axis=1)
    forward = velocity / np.maximum(speed, 1e-6)[:, None]
    return Trajectory(
        time_s=time_s,
        position=position,
        quaternion=so3.quat_from_matrix(x[:, 6:15].reshape(-1, 3, 3)),
        velocity=velocity,
        chainage=chainage,
        speed=speed,
        covariance=P_position,
        sigma_along=_quadratic(tangent, P_position),
        sigma_speed=_quadratic(forward, P_velocity),
    )


def _quadratic(direction: Array, P: Array) -> Array:
    """Return the standard deviation along unit vectors (N, 3) of covariances (N, 3, 3)."""
    variance = np.einsum('ni,nij,nj->n', direction, P, direction)
    sigma: Array = np.sqrt(np.maximum(variance, 0.0))
    return sigma


def estimates_to_trajectory(estimates: Sequence[Estimate], line: LineTable) -> Trajectory:
    """Return the filter's own estimates, one row per IMU epoch."""
    P = np.array([e.nav.P[0:6, 0:6] for e in estimates]).reshape(-1, 6, 6)
    x = np.array([e.nav.x for e in estimates]).reshape(-1, eskf.NOMINAL_STATES)
    time_s = np.array([e.time_s for e in estimates])
    return to_trajectory(time_s, x, P[:, 0:3, 0:3], P[:, 3:6, 3:6], line)


def smooth(filter_: CoasterEskf) -> Trajectory:
    """
    Smooth the ride that ``filter_`` has been through.

    Its history must reach back to the start (``history_s`` longer than the recording): the smoother
    needs every state after its updates.
    """
    times, x, P, steps = _epochs(filter_)

    def predict(k: int) -> tuple[Array, Array, Array]:
        step, q, _ = steps[k + 1]
        return eskf.predict(x[k], P[k], step.f, step.w, times[k + 1] - times[k], q)

    x_s, P_s = rts_smooth(x, P, predict, eskf.box_minus, eskf.box_plus)
    blocks = np.array([p[0:6, 0:6] for p in P_s]).reshape(-1, 6, 6)
    return to_trajectory(
        np.array(times), np.array(x_s), blocks[:, 0:3, 0:3], blocks[:, 3:6, 3:6], filter_.line
    )


def _epochs(
    filter_: CoasterEskf,
) -> tuple[list[float], list[Array], list[Array], list[Prediction]]:
    """Return stamps, states after all updates and steps, one entry per IMU epoch."""
    times: list[float] = []
    x: list[Array] = []
    P: list[Array] = []
    steps: list[Prediction] = []
    if filter_.history is None:
        return times, x, P, steps
    for time_s, measurement, state in filter_.history.entries():
        if isinstance(measurement, Prediction) and (not times or time_s > times[-1]):
            times.append(time_s)
            x.append(state.nav.x)
            P.append(state.nav.P)
            steps.append(measurement)
        elif times:
            x[-1], P[-1] = state.nav.x, state.nav.P
    return times, x, P, steps

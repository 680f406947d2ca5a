"""
Rides that the track filter comes to late: started at random times of the moving ride.

Each start is a filter that knows the line and nothing else, fed from that moment on. Only what it
says of the newest sample counts: what it finds out later of earlier ones is not known live.
"""

from __future__ import annotations

import dataclasses
import time
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_estimate import to_trajectory
from coaster_localization.track_filter import CoasterTrackFilter
from coaster_localization.track_map import line_map
from coaster_localization.track_states import TrackState
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.metrics import moving
from track_localization.sim.coaster import SimulatedRide
from track_localization.track.line_map import LineMap

Array = NDArray[np.float64]

TURNING_RADPS = 0.15
"""What the sensor turns faster than this is an element's doing [rad/s]."""
ELEMENT_RAD = 1.5
"""How far the sensor turns in one element [rad]; two of them tell the place."""
JUDGED_S = 5.0
"""How long after two elements the error's median is taken over [s]."""
NEAR_M = 1.0
"""An error up to this is no wrong answer [m]."""
CONFIDENT = 5.0
"""An error beyond so many sigmas is a confident wrong answer, if it is not near."""

BROKEN = (ArithmeticError, np.linalg.LinAlgError)
"""What a filter may break down with; an exam counts that and goes on."""

PREFIX = 'start_'


@dataclasses.dataclass(frozen=True)
class Answers:
    """
    What a filter said of the newest sample, while it said something, and how wrong it was.

    Attributes:
        time_s: (K,) stamps [s].
        error: (K,) distance from the truth [m].
        sigma: (K,) claimed along the line [m].
        cpu_s: processor time spent on the recording's rest [s].
        ride_s: duration of that rest [s].
        broken: what the filter broke down with; nothing was said after that.
    """

    time_s: Array
    error: Array
    sigma: Array
    cpu_s: float
    ride_s: float
    broken: str = ''


def names(count: int) -> tuple[str, ...]:
    """Return the names of a ride's first starts."""
    return tuple(f'{PREFIX}{k}' for k in range(count))


def run_starts(
    ride: SimulatedRide, track: str, seed: int, starts: Sequence[str], config: TrackFilterConfig
) -> dict[str, dict[str, float | str]]:
    """Return the figures of every start by name; which times they are depends on no other."""
    line = line_map(ride.design, config)
    start_m = float(ride.design.chainage[0])
    times = start_times(ride.truth, track, seed, len(starts))
    out: dict[str, dict[str, float | str]] = {}
    for name, begin_s in zip(starts, times, strict=True):
        imu = ride.imu[int(np.searchsorted(ride.imu.time_s, begin_s)) :]
        answers = listen(imu, ride.truth, line, start_m, config)
        told_s = time_turned(imu, 2.0 * ELEMENT_RAD)
        # Before this the filter waits for a rest and says nothing.
        spoken_s = float(imu.time_s[0]) + config.seek_after_s
        out[name] = {
            'begin_s': float(begin_s),
            **figures(answers, max(told_s, spoken_s), float(imu.time_s[-1])),
        }
    return out


def start_times(truth: Trajectory, track: str, seed: int, count: int) -> Array:
    """Return random stamps (count,) of the moving ride [s]; more starts keep the first ones."""
    rng = np.random.default_rng([seed, zlib.crc32(track.encode())])
    possible = truth.time_s[moving(truth)]
    return np.array([possible[rng.integers(len(possible))] for _ in range(count)])


def time_turned(imu: ImuSeries, angle: float) -> float:
    """Return when the sensor has turned by ``angle`` [rad], slow turning left out; inf if never."""
    rate = np.linalg.norm(imu.angular_rate, axis=1)
    steps = np.diff(imu.time_s, prepend=imu.time_s[0])
    turned = np.cumsum(np.where(rate > TURNING_RADPS, rate * steps, 0.0))
    k = int(np.searchsorted(turned, angle))
    return float(imu.time_s[k]) if k < len(turned) else float('inf')


def listen(
    imu: ImuSeries, truth: Trajectory, line: LineMap, start_m: float, config: TrackFilterConfig
) -> Answers:
    """Feed a new filter and hold what it says against the truth."""
    filter_ = CoasterTrackFilter(line, start_m, config)
    states: list[TrackState] = []
    broken = ''
    begin = time.process_time()
    try:
        for i in range(len(imu)):
            states += filter_.push(imu.sample(i))[-1:]
    except BROKEN as reason:
        broken = f'{type(reason).__name__}: {reason}'
    cpu_s = time.process_time() - begin
    ride_s = float(imu.time_s[-1] - imu.time_s[0])
    if not states:
        return Answers(np.empty(0), np.empty(0), np.empty(0), cpu_s, ride_s, broken)
    said = to_trajectory(
        np.array([s.time_s for s in states]),
        np.array([s.x for s in states]),
        np.array([s.P[0:2, 0:2] for s in states]),
        line,
        config.line_sigma_m,
    )
    error = np.linalg.norm(said.position - truth.position_at(said.time_s), axis=1)
    sigma = np.asarray(said.sigma_along)
    known = np.isfinite(error)
    return Answers(said.time_s[known], error[known], sigma[known], cpu_s, ride_s, broken)


def figures(answers: Answers, told_s: float, end_s: float) -> dict[str, float | str]:
    """
    Return the figures of one start.

    Args:
        answers: what the filter said.
        told_s: when two elements have told the place [s]; inf if never.
        end_s: the recording's end [s].

    ``told`` is 1 where that was ``JUDGED_S`` before the end, and only then ``error_m`` (median
    over that time, absent where the filter said nothing), ``near``, and ``wrong_after``, whether
    there was a confident wrong answer from then on. ``wrong_ever`` and ``wrong_s`` are of all the
    time, ``answered_s`` is how long the filter said something. A filter that broke down has
    ``broken``, and is not near.
    """
    wrong = (answers.error > CONFIDENT * answers.sigma) & (answers.error > NEAR_M)
    step = np.diff(answers.time_s, append=answers.time_s[-1:])
    told = told_s + JUDGED_S <= end_s
    out: dict[str, float | str] = {
        'told': float(told),
        'wrong_ever': float(wrong.any()),
        'wrong_s': float(step[wrong].sum()),
        'answered_s': float(step.sum()),
        'cpu_s': answers.cpu_s,
        'ride_s': answers.ride_s,
    }
    if answers.broken:
        out['broken'] = answers.broken
    if told:
        judged = (answers.time_s >= told_s) & (answers.time_s < told_s + JUDGED_S)
        median = float(np.median(answers.error[judged])) if judged.any() else float('inf')
        out |= {
            'told_s': told_s,
            'near': float(median <= NEAR_M and not answers.broken),
            'wrong_after': float(wrong[answers.time_s >= told_s].any()),
        }
        if np.isfinite(median):
            out['error_m'] = median
    return out

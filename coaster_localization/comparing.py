"""
Two rides of one track compared by chainage: speed, time, and the force that riders feel.

Both are smoothed on the same line, so an error of that line is in both alike and leaves their
difference. Shuttles and laps are compared pass by pass, in the order in which they are run.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from coaster_localization.ride_passes import Pass, SmoothedRide, split_passes
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.track.line_map import STRETCH

Array = NDArray[np.float64]

STEP_M = 0.5
"""Between rows of a comparison."""
FORCE_HZ = 5.0
"""Corner of the low-pass for riders' forces, as ride acceptance has it: 5 Hz, four poles."""
TWICE_FILTERED = (math.sqrt(2.0) - 1.0) ** 0.25
"""A two-pole Butterworth run forward and backward has its -3 dB here, as a share of its own."""
SLOWEST_RATE_HZ = 20.0
STANDS_MPS, MOVES_MPS = 0.3, 1.0
"""Slower than the first a train stands; faster than the second its clock can be compared."""
TWO_SIDED_95 = 1.96
UNRUN = 'not run by both'
"""Remark on an element of which less than half was run."""


@dataclasses.dataclass(frozen=True)
class Profile:
    """
    One pass of a ride on the grid of chainages, M rows; NaN where it did not pass.

    Attributes:
        time_s: (M,) when the train came by, or left after a stop there [s].
        speed: (M,) [m/s].
        sigma: (M,) standard deviation of the speed at this chainage [m/s].
        time_sigma: (M,) standard deviation of ``time_s`` [s].
        force: (M, 3) specific force along x, y, z of the body, low-passed [m/s^2].
    """

    time_s: Array
    speed: Array
    sigma: Array
    time_sigma: Array
    force: Array


@dataclasses.dataclass(frozen=True)
class Comparison:
    """
    A pass of ride A beside the same pass of ride B, on the stretch that both have run.

    Attributes:
        number: of the pass, from 1.
        forward: its direction.
        chainage: (M,) [m].
        a, b: the rides.
        time_difference: (M,) by how much B is behind A since both moved first [s].
    """

    number: int
    forward: bool
    chainage: Array
    a: Profile
    b: Profile
    time_difference: Array

    @property
    def speed_difference(self) -> Array:
        """Speed of B minus that of A (M,) [m/s]."""
        return self.b.speed - self.a.speed

    @property
    def sigma(self) -> Array:
        """Standard deviation (M,) of that difference [m/s]."""
        return np.hypot(self.a.sigma, self.b.sigma)


@dataclasses.dataclass(frozen=True)
class Element:
    """A named stretch of the track, chainages [m]."""

    name: str
    from_m: float
    to_m: float


@dataclasses.dataclass(frozen=True)
class Verdict:
    """
    What two rides did in an element; NaN where ``remark`` says why.

    ``half_width`` is that of the 95 % interval of the difference of the mean speeds (by chainage)
    [m/s]; ``time_difference`` is how much longer B took [s], ``time_half_width`` its interval.
    """

    element: Element
    speed_a: float
    speed_b: float
    half_width: float
    time_difference: float
    time_half_width: float
    remark: str

    @property
    def difference(self) -> float:
        """Mean speed of B minus that of A [m/s]."""
        return self.speed_b - self.speed_a

    @property
    def significant(self) -> bool:
        """Whether the interval leaves zero out."""
        return abs(self.difference) > self.half_width


def rider_force(ride: SmoothedRide, imu: ImuSeries) -> Array:
    """
    Return the specific force (N, 3) at the sensor, in body axes, low-passed at 5 Hz [m/s^2].

    Four poles in all, run forward and backward: no delay. Mount and bias are the filter's.
    Raise DataError where the recording is too slow for it.
    """
    if not imu.rate_hz >= SLOWEST_RATE_HZ:
        raise DataError(
            f'{imu.rate_hz:.1f} samples a second are too few for forces up to {FORCE_HZ:g} Hz; '
            f'record at {SLOWEST_RATE_HZ:g} Hz at least'
        )
    k = np.clip(np.searchsorted(ride.time_s, imu.time_s), 0, len(ride.time_s) - 1)
    M = ride.x[k, 11:20].reshape(-1, 3, 3)
    body = np.einsum('nij,nj->ni', M, imu.specific_force - ride.x[k, 26:29])
    count = round((imu.time_s[-1] - imu.time_s[0]) * imu.rate_hz) + 1
    even = np.linspace(imu.time_s[0], imu.time_s[-1], count)
    sos = butter(2, FORCE_HZ / TWICE_FILTERED, fs=imu.rate_hz, output='sos')
    columns = []
    for values in body.T:
        smooth = sosfiltfilt(sos, np.interp(even, imu.time_s, values))
        columns.append(np.interp(imu.time_s, even, smooth))
    return np.stack(columns, axis=1)


def compare(
    a: tuple[SmoothedRide, ImuSeries], b: tuple[SmoothedRide, ImuSeries]
) -> tuple[list[Comparison], list[str]]:
    """
    Compare two rides on one line, each with its own recording.

    Return a comparison for each pass that both have run, and what the user should know. Raise
    DataError where they have nothing in common.
    """
    line = a[0].line
    grid = np.linspace(0.0, line.length, max(2, round(line.length / STEP_M) + 1))
    runs = [split_passes(ride.chainage, line) for ride, _ in (a, b)]
    forces = [rider_force(*pair) for pair in (a, b)]
    notes: list[str] = []
    if len(runs[0]) != len(runs[1]):
        notes.append(
            f'A has {len(runs[0])} passes of the line, B {len(runs[1])}: the first '
            f'{min(map(len, runs))} are compared'
        )
    found: list[Comparison] = []
    origin = math.nan
    for number, (one, other) in enumerate(zip(*runs, strict=False), 1):
        if one.forward != other.forward:
            notes.append(f'pass {number}: A and B run in opposite directions; left out from here')
            break
        first = _profile(*a, one, grid, forces[0])
        second = _profile(*b, other, grid, forces[1])
        both = np.isfinite(first.speed + second.speed)
        if both.sum() < 2:
            notes.append(f'pass {number}: A and B have no stretch in common; left out')
            continue
        notes += _missing(number, grid, first.speed, second.speed)
        delay = second.time_s - first.time_s
        if not math.isfinite(origin):
            moves = both & (np.minimum(first.speed, second.speed) > MOVES_MPS)
            rows = np.flatnonzero(moves if moves.any() else both)
            origin = float(delay[rows[0] if one.forward else rows[-1]])
        rows = np.flatnonzero(both)
        span = slice(rows[0], rows[-1] + 1)
        cut_a, cut_b = _cut(first, span), _cut(second, span)
        late = (delay - origin)[span]
        found.append(Comparison(number, one.forward, grid[span], cut_a, cut_b, late))
    if not found:
        raise DataError(
            'the rides have no stretch of track in common'
            + (f' ({"; ".join(notes)})' if notes else '')
            + '; compare rides that were recorded from the same start'
        )
    return found, notes


def judge(comparison: Comparison, elements: Sequence[Element]) -> list[Verdict]:
    """
    Return what the rides did in each element.

    The error of a mean speed is no more than that of the time between an element's ends makes it
    at the highest speed, and no more than the speed's own, were it the same all the way.
    """
    return [_verdict(comparison, element) for element in elements]


def equal_stretches(length: float, count: int = 10) -> list[Element]:
    """Return a line of ``length`` [m] cut into stretches of equal length."""
    edges = np.linspace(0.0, length, count + 1).tolist()
    return [
        Element(f'{begin:.0f}-{end:.0f} m', begin, end) for begin, end in itertools.pairwise(edges)
    ]


def between_places(
    names: Sequence[str], chainage: Array, length: float, least_m: float = 15.0
) -> list[Element]:
    """Return the stretches from place to place (K,) [m]; one too near the last is passed over."""
    edges = [('start', 0.0)]
    for k in np.argsort(chainage):
        if chainage[k] - edges[-1][1] >= least_m and length - chainage[k] >= least_m:
            edges.append((names[k], float(chainage[k])))
    edges.append(('end', length))
    return [
        Element(f'{first} to {second}', begin, end)
        for (first, begin), (second, end) in itertools.pairwise(edges)
    ]


def _profile(ride: SmoothedRide, imu: ImuSeries, part: Pass, grid: Array, force: Array) -> Profile:
    speed = part.on(grid, np.abs(ride.speed))
    time_s = part.on(grid, ride.time_s)
    variance = part.on(grid, np.stack([ride.P[:, 0, 0], ride.P[:, 0, 1], ride.P[:, 1, 1]], axis=1))
    stretch = np.interp(grid, ride.line.chainage, ride.line.rows[:, STRETCH])
    # The speed at a place errs by the speed's own error and by that of the place.
    with np.errstate(invalid='ignore'):
        slope = np.gradient(speed / stretch, grid) * (1.0 if part.forward else -1.0)
        slope = np.where(np.isfinite(slope), slope, 0.0)
        square = variance[:, 2] - 2.0 * slope * variance[:, 1] + slope**2 * variance[:, 0]
        sigma = stretch * np.sqrt(np.maximum(square, 0.0))
    felt = [np.interp(time_s, imu.time_s, column) for column in force.T]
    time_sigma = stretch * np.sqrt(variance[:, 0]) / np.maximum(speed, 0.1)
    return Profile(time_s, speed, sigma, time_sigma, np.stack(felt, axis=1))


def _cut(profile: Profile, span: slice) -> Profile:
    """Return a part of a profile's rows."""
    parts = {f.name: getattr(profile, f.name)[span] for f in dataclasses.fields(Profile)}
    return Profile(**parts)


def _missing(number: int, grid: Array, a: Array, b: Array) -> list[str]:
    """Say where only one of the rides has run, if that is more than the start's scatter."""
    notes = []
    for name, own, other in (('A', a, b), ('B', b, a)):
        lacking = np.flatnonzero(np.isfinite(other) & ~np.isfinite(own))
        if len(lacking) * STEP_M > 5.0:
            notes.append(
                f'pass {number}: ride {name} is missing on {len(lacking) * STEP_M:.0f} m between '
                f'{grid[lacking[0]]:.0f} and {grid[lacking[-1]]:.0f} m; compared without them'
            )
    return notes


def _verdict(comparison: Comparison, element: Element) -> Verdict:
    s = comparison.chainage
    inside = (s >= element.from_m) & (s <= element.to_m)
    step = float(s[1] - s[0])
    if inside.sum() * step < 0.5 * (element.to_m - element.from_m) or inside.sum() < 2:
        unknown = math.nan
        return Verdict(element, unknown, unknown, unknown, unknown, unknown, UNRUN)
    late = comparison.time_difference[inside]
    longer = float(late[-1] - late[0]) * (1.0 if comparison.forward else -1.0)
    stands = []
    for name, ride in (('A', comparison.a), ('B', comparison.b)):
        if float(ride.speed[inside].min()) < STANDS_MPS:
            stands.append(name)
    rides = [_cut(ride, slice(*_ends(inside))) for ride in (comparison.a, comparison.b)]
    error = math.hypot(*(_mean_speed_sigma(ride, inside.sum() * step) for ride in rides))
    time_error = math.hypot(*(_transit_sigma(ride) for ride in rides))
    return Verdict(
        element,
        float(rides[0].speed.mean()),
        float(rides[1].speed.mean()),
        TWO_SIDED_95 * error,
        longer,
        TWO_SIDED_95 * time_error,
        f'{" and ".join(stands)} stood here' if stands else '',
    )


def _ends(inside: NDArray[np.bool_]) -> tuple[int, int]:
    rows = np.flatnonzero(inside)
    return int(rows[0]), int(rows[-1]) + 1


def _transit_sigma(ride: Profile) -> float:
    """Return the standard deviation of the time between the ends of ``ride`` [s]."""
    return math.hypot(float(ride.time_sigma[0]), float(ride.time_sigma[-1]))


def _mean_speed_sigma(ride: Profile, length: float) -> float:
    """Return the standard deviation of the mean speed over a stretch of ``length`` [m/s]."""
    by_time = float(ride.speed.max()) ** 2 / length * _transit_sigma(ride)
    return min(float(ride.sigma.mean()), by_time)

"""
The measured ride turned into the vehicle's axes: levelled, bias-free, with attitude.

What is known without any track: while the train rests in the station gravity tells how the sensor
is tilted, and the gyro its bias. Everything else of the mount (its heading) is left as it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from coaster_localization.station import Station
from track_localization.errors import DataError
from track_localization.estimation import so3, strapdown
from track_localization.estimation.imu import ImuSeries, clean
from track_localization.track.design_ride import DesignRide

Array = NDArray[np.float64]

AT_THE_END_S = 3.0
"""A rest this close to the recording's begin or end is the one before or after the ride."""
DESIGN_REST_MPS = 0.05
SMOOTH = 40.0
"""
A ride that shakes at most so many times as strongly as a rest, in power: a train rolls through the
transfer track at a fifth of its usual speed, and shakes there a fifth as much.
"""
LEVEL_AS_IN_STATION = np.cos(np.deg2rad(5.0))


@dataclasses.dataclass(frozen=True)
class Motion:
    """
    What a body felt, in body axes; measured or by design.

    Attributes:
        time_s: (N,) strictly increasing [s].
        force: (N, 3) specific force [m/s^2].
        rate: (N, 3) angular rate [rad/s]; NaN without a gyro.
        R_nb: (N, 3, 3) attitude; NaN without a gyro.
        held: (N,) bool, stands still.
        start_s: when the ride begins, the last of the rest before it [s].
        end_s: when it ends [s].
        rests: whether a rest was seen before and after the ride.
        notes: what a reader should know.
    """

    time_s: Array
    force: Array
    rate: Array
    R_nb: Array
    held: NDArray[np.bool_]
    start_s: float
    end_s: float
    rests: tuple[bool, bool]
    notes: tuple[str, ...] = ()

    @property
    def has_gyro(self) -> bool:
        """Whether rates and attitude are there."""
        return bool(np.isfinite(self.rate).all())

    def turned(self, heading: float) -> Motion:
        """
        Return the motion with the sensor turned by ``heading`` [rad] about its z axis.

        The attitude keeps its place at the ride's begin: it was taken from the design's there.
        """
        c, s = np.cos(heading), np.sin(heading)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return dataclasses.replace(
            self,
            force=self.force @ turn.T,
            rate=self.rate @ turn.T,
            R_nb=turn @ self.R_nb @ turn.T,
        )


def design_motion(design: DesignRide) -> Motion:
    """Return the design ride as a Motion."""
    moving = np.flatnonzero(design.speed > DESIGN_REST_MPS)
    if len(moving) < 2:
        raise DataError('design ride: never faster than 0.05 m/s; export the whole ride')
    first, last = int(moving[0]), int(moving[-1])
    return Motion(
        time_s=design.time_s,
        force=design.specific_force,
        rate=design.angular_rate,
        R_nb=so3.matrix_from_quat(design.quaternion),
        held=design.speed <= DESIGN_REST_MPS,
        start_s=float(design.time_s[max(first - 1, 0)]),
        end_s=float(design.time_s[min(last + 1, len(design) - 1)]),
        rests=(first > 0, last < len(design) - 1),
    )


def measured_motion(imu: ImuSeries, design: DesignRide) -> Motion:
    """
    Return the recording levelled to the design's attitude in the station.

    Gravity and gyro bias come from the rest before the ride, or from the one after it. Raise
    DataError when there is next to nothing to use.
    """
    imu, dropped = clean(imu)
    if len(imu) < 10:
        raise DataError(f'recording: {len(imu)} usable samples ({dropped}); record a whole ride')
    notes = [f'{n} samples dropped: {reason}' for reason, n in dropped.items()]
    before, after = _end_rests(imu)
    if before and Station(design).is_elsewhere(imu.specific_force[before].mean(axis=0)):
        before = None
        notes.append('begins on a stretch as quiet as the station, and tilted: not taken for it')
    R_bm = np.eye(3)
    rest, row = (before, 0) if before else (after, -1)
    if rest:
        gravity = imu.specific_force[rest].mean(axis=0)
        R_bm = shortest_turn(gravity, so3.matrix_from_quat(design.quaternion[row])[2])
        held = _held(imu, (before, after), gravity)
        if not before:
            notes.append('no rest before the ride: levelled at the one after it')
    else:
        held = np.zeros(len(imu), dtype=bool)
        notes.append('no rest before or after the ride: sensor taken as level, gyro as bias-free')
    rate = imu.angular_rate - _gyro_bias(imu, before, after)
    body = ImuSeries(imu.time_s, imu.specific_force @ R_bm.T, rate @ R_bm.T)
    if imu.has_gyro:
        R_nb = _attitude(body, design, backward=after is not None and before is None)
    else:
        R_nb = np.full((len(imu), 3, 3), np.nan)
        notes.append('no gyro: nothing but forces can be matched')
    moving = np.flatnonzero(~held)
    moving = moving[moving >= (before.start if before else 0)]
    moving = moving[moving < (after.stop if after else len(imu))]
    if len(moving) < 2:
        raise DataError('recording: the sensor never moves; record the ride')
    first, last = int(moving[0]), int(moving[-1])
    return Motion(
        time_s=imu.time_s,
        force=body.specific_force,
        rate=body.angular_rate,
        R_nb=R_nb,
        held=held,
        start_s=float(imu.time_s[first if before else 0]),
        end_s=float(imu.time_s[last if after else -1]),
        rests=(before is not None, after is not None),
        notes=tuple(notes),
    )


def shortest_turn(from_: Array, to: Array) -> Array:
    """Return the rotation (3, 3) by the least angle that takes one direction to another."""
    a, b = from_ / np.linalg.norm(from_), to / np.linalg.norm(to)
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1.0 + 1e-9:
        other = np.eye(3)[int(np.argmin(np.abs(a)))]
        axis = np.cross(a, other)
        return so3.exp(np.pi * axis / np.linalg.norm(axis))
    K = so3.hat(axis)
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + cosine))


def _end_rests(imu: ImuSeries) -> tuple[slice | None, slice | None]:
    """Return the rests at the recording's begin and end, None where it does not rest."""
    edge = AT_THE_END_S * imu.rate_hz
    found = [_first_rest(imu, edge), _first_rest(_reversed(imu), edge)]
    before = slice(*found[0]) if found[0] else None
    after = slice(len(imu) - found[1][1], len(imu) - found[1][0]) if found[1] else None
    if before and after and after.start < before.stop:
        raise DataError('recording: the sensor rests from begin to end; record the ride')
    return before, after


def _first_rest(imu: ImuSeries, edge: float) -> tuple[int, int] | None:
    intervals = strapdown.find_rest(imu)
    return intervals[0] if intervals and intervals[0][0] <= edge else None


def _reversed(imu: ImuSeries) -> ImuSeries:
    """Return the recording as it would be if time ran backward."""
    return ImuSeries(-imu.time_s[::-1], imu.specific_force[::-1], -imu.angular_rate[::-1])


def _gyro_bias(imu: ImuSeries, before: slice | None, after: slice | None) -> Array:
    """Return the bias (N, 3) or (3,): that of the rests, drifting evenly between them."""
    rests = [r for r in (before, after) if r is not None]
    if not rests or not imu.has_gyro:
        return np.zeros(3)
    times = [float(imu.time_s[r].mean()) for r in rests]
    means = np.array([imu.angular_rate[r].mean(axis=0) for r in rests])
    return np.stack([np.interp(imu.time_s, times, means[:, k]) for k in range(3)], axis=-1)


def _attitude(body: ImuSeries, design: DesignRide, backward: bool) -> Array:
    """Integrate the rates from the design's first attitude, or backward from its last."""
    first, last = so3.matrix_from_quat(design.quaternion[[0, -1]])
    if not backward:
        return strapdown.integrate_attitude(body, first, np.zeros(3))
    return strapdown.integrate_attitude(_reversed(body), last, np.zeros(3))[::-1]


def _held(
    imu: ImuSeries, rests: tuple[slice | None, slice | None], gravity: Array
) -> NDArray[np.bool_]:
    """
    Return where the train stands: shaken as little as in the rests, and level as there.

    A slow train on a smooth transfer track or lift is nearly as quiet as a standing one, so the
    rest of this very recording is the yardstick. A train that shakes hardly more at speed is as
    quiet wherever it rolls: it stands in the rests at the ends alone.
    """
    known = [rest for rest in rests if rest is not None]
    if _is_smooth(imu, known):
        held = np.zeros(len(imu), dtype=bool)
        for rest in known:
            held[rest] = True
        return held
    size = max(3, round(imu.rate_hz))
    shake = _shake(imu.specific_force, size)
    still = shake < 1.25 * float(np.median(shake[known[0]])) + 0.002
    if imu.has_gyro:
        shake = _shake(imu.angular_rate, size)
        still &= shake < 1.25 * float(np.median(shake[known[0]])) + 0.0002
    mean = uniform_filter1d(imu.specific_force, size, axis=0, mode='nearest')
    cosine = mean @ gravity / (np.linalg.norm(mean, axis=1) * np.linalg.norm(gravity) + 1e-9)
    still &= cosine > LEVEL_AS_IN_STATION
    return np.asarray(minimum_filter1d(maximum_filter1d(still, size), size))


def _is_smooth(imu: ImuSeries, rests: Sequence[slice]) -> bool:
    """Return whether the ride shakes hardly more than the rests, above what its motion makes."""
    moves = np.ones(len(imu), dtype=bool)
    for rest in rests:
        moves[rest] = False
    change = np.zeros(len(imu))
    change[1:-1] = (np.diff(imu.specific_force, 2, axis=0) ** 2).sum(axis=1)
    return bool(np.median(change[moves]) < SMOOTH * np.median(change[~moves]))


def _shake(values: Array, size: int) -> Array:
    """Return the rms (N,) over a window of all axes' differences between samples."""
    square = (np.diff(values, axis=0, prepend=values[:1]) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(uniform_filter1d(square, size, mode='nearest'), 0.0)))

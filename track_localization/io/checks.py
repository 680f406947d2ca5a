"""What is wrong with an IMU recording, what to do about it, and what still works."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.so3 import euler_zyx
from track_localization.estimation.strapdown import level

Array = NDArray[np.float64]
Severity = Literal['error', 'warning', 'info']

UNITS = {
    'si': (1.0, 1.0),
    'g': (GRAVITY, 1.0),
    'deg': (1.0, np.pi / 180.0),
    'g_deg': (GRAVITY, np.pi / 180.0),
}
"""Factors to m/s^2 and rad/s by the name of the units; ``deg`` means deg/s."""

SLOW_HZ = 45.0
"""Below this the integration of coaster turns suffers; the papers sample at 50-100 Hz."""
TOO_SLOW_HZ = 8.0
"""Below this the low-pass of the matcher (1.25 Hz and its shoulders) has too little to work on."""
FASTEST_TURN = 12.0
"""No ride turns faster [rad/s]; a rate above it all the time is in deg/s."""
REST_SHARE = 0.015
"""Of the strongest tenth's force: what still counts as noise at rest, 0.15 to 0.3 m/s^2."""
AXES = 'xyz'


class Finding(NamedTuple):
    """
    One observation: severity, what it is, and what can be done or still works.

    ``spoils`` tells what of the recording cannot be used at all.
    """

    severity: Severity
    what: str
    remedy: str
    spoils: Literal['', 'force', 'rate'] = ''

    def __str__(self) -> str:
        return f'{self.severity}: {self.what}. {self.remedy}.'


REJECTIONS: dict[str, tuple[Severity, str, str]] = {
    'not_finite': ('warning', 'samples with NaN or infinite numbers', 'They are left out'),
    'repeated_time': (
        'warning',
        'samples repeat a stamp',
        'The first of each is kept; check that one driver publishes, and only once',
    ),
    'backward_time': (
        'warning',
        'samples are stamped earlier than one before them',
        'They are left out; one stamp far ahead takes all that follow with it: look for a clock '
        'that was set during the recording',
    ),
    'unreadable': (
        'warning',
        'or more messages of a damaged file are lost',
        'The rest is used; copy the recording again if a better copy exists',
    ),
    'undecodable': ('warning', 'messages cannot be decoded', 'They are left out'),
    'no_header_stamp': (
        'warning',
        'samples have no header stamp',
        'The times of logging stand in, late by the transport; have the driver stamp its messages',
    ),
    'gyro_missing': (
        'warning',
        'samples have no gyro sample around them',
        'They are left out; start all sensors together',
    ),
    'gravity_missing': (
        'warning',
        'samples have no gravity sample around them',
        'They are left out; start all sensors together',
    ),
}


def inspect_imu(imu: ImuSeries, rejected: Mapping[str, int] | None = None) -> list[Finding]:
    """
    Return what a user should know about a cleaned recording, the gravest first.

    Args:
        imu: the samples in SI units, as far as one knows, in the sensor's axes.
        rejected: counts of what reading and cleaning dropped.
    """
    findings = list(_rejections(rejected or {}, len(imu)))
    if len(imu) < 2:
        findings.append(Finding('error', f'{len(imu)} samples', 'Record a whole ride'))
        return findings
    findings += [*_clock(imu), *_gyro(imu), *_channels(imu), *_force(imu)]
    order = ('error', 'warning', 'info')
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def to_si(imu: ImuSeries, units: str = 'auto') -> tuple[ImuSeries, list[Finding]]:
    """
    Return the series in m/s^2 and rad/s, and a finding if that changed it.

    ``auto`` converts forces only where the rest shows 1 g and so does the whole; never rates,
    whose unit a recording cannot prove. Raise DataError for an unknown name.
    """
    if units != 'auto' and units not in UNITS:
        raise DataError(f'units: {units!r} is not one of auto, {", ".join(UNITS)}')
    asked = units != 'auto'
    if not asked:
        units = 'g' if _in_g(imu) else 'si'
    force, rate = UNITS[units]
    if units == 'si':
        return imu, []
    converted = ImuSeries(imu.time_s, imu.specific_force * force, imu.angular_rate * rate)
    return converted, [conversion(units, asked)]


def conversion(units: str, asked: bool) -> Finding:
    """Return the finding that a recording was converted from ``units``."""
    what = 'specific force is in g' if units == 'g' else f'units are {units}'
    remedy = 'Converted to m/s^2; set units to si if that is wrong'
    return Finding('info', what, 'Converted as asked' if asked else remedy)


def _in_g(imu: ImuSeries) -> bool:
    rest = quiet_force(imu)
    lengths = np.linalg.norm(imu.specific_force, axis=1)
    return (
        rest is not None
        and 0.9 < float(np.linalg.norm(rest)) < 1.1
        and 0.7 < float(np.median(lengths)) < 1.8
    )


def quiet_force(imu: ImuSeries, window_s: float = 1.0) -> Array | None:
    """
    Return the mean force (3,) at rest, in the recording's own units.

    Rest is the first window that varies at most twice as much as the quietest one. None when even
    there the force varies by more than ``REST_SHARE`` of the ride's strong forces, or the sensor
    turns, or when the recording is shorter than three windows.
    """
    step = float(np.median(np.diff(imu.time_s))) if len(imu) > 1 else np.inf
    size = max(3, round(window_s / step)) if step > 0.0 and np.isfinite(step) else 3
    n = len(imu) // size
    if n < 3:
        return None
    windows = imu.specific_force[: n * size].reshape(n, size, 3)
    spread = windows.std(axis=1).max(axis=1)
    first = int(np.argmax(spread <= 2.0 * spread.min()))
    if spread[first] > REST_SHARE * _strong(imu.specific_force):
        return None
    rate = imu.angular_rate[first * size : (first + 1) * size].mean(axis=0)
    if imu.has_gyro and np.linalg.norm(rate) > max(0.05, 0.05 * _strong(imu.angular_rate)):
        return None
    mean: Array = windows[first].mean(axis=0)
    return mean


def _strong(values: Array) -> float:
    """Return the length that a tenth of the vectors (N, 3) exceed."""
    return float(np.percentile(np.linalg.norm(values, axis=1), 90))


def _rejections(rejected: Mapping[str, int], kept: int) -> Iterator[Finding]:
    for reason, n in rejected.items():
        severity, what, remedy = REJECTIONS.get(
            reason, ('warning', f'samples rejected: {reason}', 'They are left out')
        )
        most = reason != 'no_header_stamp' and n > kept
        yield Finding('error' if most else severity, f'{n} {what}', remedy)


def _clock(imu: ImuSeries) -> Iterator[Finding]:
    step = np.diff(imu.time_s)
    usual = float(np.median(step))
    if usual >= 0.9:
        unit, factor = next(
            ((u, f) for u, f in (('ms', 1e3), ('us', 1e6), ('ns', 1e9)) if usual < 0.9 * f),
            ('ns', 1e9),
        )
        yield Finding(
            'error',
            f'one sample every {usual:.3g} s: stamps look like {unit} taken for s',
            f'Divide the stamps by {factor:.0e} before writing the recording',
        )
        return
    rate = 1.0 / usual
    if rate < TOO_SLOW_HZ:
        yield Finding(
            'error', f'{rate:.3g} Hz is too slow for any method here', 'Record at 50 Hz or more'
        )
    elif rate < SLOW_HZ:
        yield Finding(
            'warning',
            f'{rate:.3g} Hz is slow',
            'Matching on z still works, as it filters to about 1 Hz; attitude from the gyro, the '
            'other channels and the ESKF lose accuracy in fast turns: record at 50 Hz or more',
        )
    holes = np.flatnonzero(step > max(0.1, 4.0 * usual))
    if len(holes):
        shown = ', '.join(f'{step[k]:.3g} s at {imu.time_s[k]:.3f} s' for k in holes[:5])
        rest = f' and {len(holes) - 5} more' if len(holes) > 5 else ''
        lost = float(step[holes].sum() / (imu.time_s[-1] - imu.time_s[0]))
        yield Finding(
            'error' if lost > 0.5 else 'warning',
            f'{len(holes)} gaps, {100.0 * lost:.2g} % of the time: {shown}{rest}',
            'Matching bridges short ones; the attitude is unknown after a long one in a turn, so '
            'distrust results behind it',
        )
    if imu.time_s[-1] - imu.time_s[0] < 10.0:
        yield Finding('warning', 'shorter than 10 s', 'Record a whole ride, from rest to rest')


def _gyro(imu: ImuSeries) -> Iterator[Finding]:
    plain = 'Matching on z works (srdtw_paper, dtw_z, srdtw_z)'
    if not imu.has_gyro:
        yield Finding(
            'warning',
            'no gyroscope',
            f'{plain}; pitch, yaw, roll, multi, the ESKF and the track filter need one',
            'rate',
        )
        return
    rate = imu.angular_rate
    if not rate.any():
        yield Finding(
            'error',
            'the gyroscope sends zeros',
            f'{plain}; mend the driver for the other methods',
            'rate',
        )
        return
    usual = _strong(rate)
    if usual > FASTEST_TURN:
        yield Finding(
            'error',
            f'a tenth of the time it turns faster than {usual:.3g} rad/s: the rates are in deg/s',
            'Set units to deg (or g_deg if the forces are in g)',
            'rate',
        )


def _channels(imu: ImuSeries) -> Iterator[Finding]:
    for kind, values, least in (
        ('force', imu.specific_force, 1.5 * GRAVITY),
        ('rate', imu.angular_rate, 3.0),
    ):
        if not np.isfinite(values).any() or (kind == 'rate' and not values.any()):
            continue
        for k, axis in enumerate(AXES):
            column = values[:, k]
            if np.ptp(column) == 0.0:
                yield Finding(
                    'error',
                    f'{kind} {axis} never changes from {column[0]:.3g}',
                    'This channel is dead or was not recorded; record again',
                )
                continue
            at = _clipped_at(column, least)
            if at is not None:
                yield Finding(
                    'warning',
                    f'{kind} {axis} stays at {at:.4g} for samples on end: clipped by the range',
                    "Set the sensor's range higher; peaks beyond it are lost and the speed drifts",
                )


def _clipped_at(column: Array, least: float) -> float | None:
    """Return the extreme value at which a channel stays for three samples, five in all."""
    for extreme in (float(column.max()), float(column.min())):
        at = column == extreme
        if abs(extreme) >= least and at.sum() >= 5 and (at[2:] & at[1:-1] & at[:-2]).any():
            return extreme
    return None


def _force(imu: ImuSeries) -> Iterator[Finding]:
    rest = quiet_force(imu)
    if rest is None:
        yield Finding(
            'warning',
            'no second at rest',
            'Units and mount cannot be checked and levelling starts poorly: record a few seconds '
            'in the station before and after the ride',
        )
        return
    length = float(np.linalg.norm(rest))
    if 0.9 < length < 1.1:
        what = f'{length:.3f} at rest: specific force is in g'
        yield Finding('error', what, 'Set units to g', 'force')
    elif length < 2.0:
        yield Finding(
            'error',
            f'{length:.2g} m/s^2 at rest: gravity was removed',
            'Record the accelerometer with gravity (TotalAcceleration; Accelerometer and Gravity)',
            'force',
        )
    elif not 0.95 * GRAVITY < length < 1.05 * GRAVITY:
        yield Finding(
            'error',
            f'{length:.4g} m/s^2 at rest instead of {GRAVITY:.4g}',
            'Unit or scale unknown: calibrate the sensor, or convert to m/s^2',
            'force',
        )
        return
    if length >= 0.9:
        yield from _mount(rest / length)


def _mount(up: Array) -> Iterator[Finding]:
    """Tell how far the sensor's z is from up, and which mount would level it."""
    tilt = np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0)))
    if tilt < 5.0:
        return
    _, pitch, roll = np.degrees(np.array(euler_zyx(level(up))))
    k = int(np.argmax(np.abs(up)))
    where = f'{"-" if up[k] < 0 else ""}{AXES[k]}'
    yield Finding(
        'warning' if tilt > 30.0 else 'info',
        f'at rest gravity is felt on {where}, {tilt:.0f} deg from z',
        f'Set mount_rpy_deg to [{round(roll)}, {round(pitch)}, YAW], YAW being the turn about the '
        'vertical that rest cannot show',
    )

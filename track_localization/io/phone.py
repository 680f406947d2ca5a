"""
Sensor Logger exports (the phone app of Kelvin Choi): a folder or zip of CSV files.

The app documents its conventions in ``COORDINATES.md``, ``UNITS.md`` and ``CROSSPLATFORM.md`` of
https://github.com/tszheichoi/awesome-sensor-logger: Android logs specific force (lying face up,
+9.81 on z), iOS the opposite sign on all three axes; with *Standardise Units & Frames* switched on
iOS follows Android. Gyroscopes agree. ``time`` is nanoseconds since the epoch.

Axes: x to the right of the screen, y up along it, z out of it. The mount turns them into the body.
"""

from __future__ import annotations

import zipfile
from collections import Counter
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries, clean
from track_localization.io.tables import parse_table

Array = NDArray[np.float64]

PLATFORMS = ('auto', 'ios', 'android')
SCALES = {'si': 1.0, 'g': GRAVITY}
"""Factors to m/s^2 by the name of the units."""
UNITS = ('auto', *SCALES)
TOTAL, LINEAR, GRAVITY_FILE = 'totalacceleration', 'accelerometer', 'gravity'
RAW_FORCE, RATE, RAW_RATE = 'accelerometeruncalibrated', 'gyroscope', 'gyroscopeuncalibrated'
METADATA = 'metadata'
FORCE_FILES = (TOTAL, LINEAR, RAW_FORCE)
LONGEST_HOLE_S = 0.1
"""Between samples further apart than this a second sensor is not interpolated."""


class Stamped(NamedTuple):
    """One sensor's file: stamps (N,) [s], strictly increasing, and values (N, 3)."""

    time_s: Array
    values: Array


def is_phone_export(path: str | Path) -> bool:
    """Whether ``path`` is a zip, or a folder, with an acceleration file of Sensor Logger in it."""
    try:
        return any(name in FORCE_FILES for name in _files(Path(path)))
    except DataError:
        return False


def read_phone(
    path: str | Path, platform: str = 'auto', units: str = 'auto'
) -> tuple[ImuSeries, dict[str, int], str]:
    """
    Return an export's specific force and angular rate in the phone's axes, rejected counts, units.

    Android: ``TotalAcceleration.csv``; iOS: -(``Accelerometer`` + ``Gravity``). Where these are
    missing ``AccelerometerUncalibrated`` stands in, and ``GyroscopeUncalibrated`` for the gyro.
    The gyro is brought to the accelerometer's stamps: interpolated, or averaged over each sample's
    interval where it is faster; never extrapolated. Rates are NaN where there is no gyro at all.

    Args:
        path: folder or zip.
        platform: ``ios`` or ``android``, for signs; ``auto`` takes it from ``Metadata.csv``.
            Whether *Standardise Units & Frames* was on is always taken from there; without that
            file, ``android`` is right for a standardised iOS export.
        units: of accelerations: ``si`` or ``g``; ``auto`` tells them by gravity's length.

    Returns:
        The cleaned series and counts by reason: those of ``clean`` for the accelerometer,
        ``gyro_missing`` for samples without gyro around them, ``gravity_missing`` likewise; and
        the units that the accelerations were in, ``si`` or ``g``. The series is in SI units.

    Raises:
        DataError: no export, unreadable files, or a convention that cannot be told; it names the
            parameter that settles it.
    """
    path = Path(path)
    _check_choice('platform', platform, PLATFORMS)
    _check_choice('units', units, UNITS)
    files = _files(path)
    if not any(name in files for name in FORCE_FILES):
        raise DataError(
            f'{path}: no acceleration file of Sensor Logger (TotalAcceleration.csv, or '
            'Accelerometer.csv with Gravity.csv); record these sensors and export as CSV'
        )
    counts: Counter[str] = Counter()
    sign = _sign(path, files, platform)
    time_s, force, units = _force(path, files, sign, units, counts)
    rate = np.full_like(force, np.nan)
    name = RATE if RATE in files else RAW_RATE
    if name in files:
        gyro = _sensor(path, files, name, Counter())
        rate = _resample(gyro, time_s)
        covered = np.isfinite(rate).all(axis=1)
        if not covered.any():
            raise DataError(f'{path}: {name} shares no time with the accelerometer; export again')
        counts['gyro_missing'] += int((~covered).sum())
        time_s, force, rate = time_s[covered], force[covered], rate[covered]
    series, dropped = clean(ImuSeries(time_s, force, rate))
    counts.update(dropped)
    if not len(series):
        raise DataError(f'{path}: no usable sample ({dict(counts)})')
    return series, {k: n for k, n in counts.items() if n}, units


def _force(
    path: Path, files: dict[str, bytes], sign: float, units: str, counts: Counter[str]
) -> tuple[Array, Array, str]:
    """Return stamps (N,), specific force (N, 3) [m/s^2] of the best files, and their units."""
    pair = LINEAR in files and GRAVITY_FILE in files
    if TOTAL in files and not (sign < 0.0 and pair):
        total = _sensor(path, files, TOTAL, counts)
        units = _units(path, units, total.values)
        return total.time_s, sign * total.values * SCALES[units], units
    if pair:
        linear = _sensor(path, files, LINEAR, counts)
        gravity = _sensor(path, files, GRAVITY_FILE, Counter())
        units = _units(path, units, gravity.values)
        at = _resample(gravity, linear.time_s)
        covered = np.isfinite(at).all(axis=1)
        counts['gravity_missing'] += int((~covered).sum())
        force = sign * (linear.values + at)[covered] * SCALES[units]
        return linear.time_s[covered], force, units
    if RAW_FORCE in files:
        raw = _sensor(path, files, RAW_FORCE, counts)
        units = _units(path, units, raw.values)
        return raw.time_s, sign * raw.values * SCALES[units], units
    raise DataError(
        f'{path}: Accelerometer.csv is without gravity and Gravity.csv is missing; record Gravity '
        'too (on Android: TotalAcceleration)'
    )


def _units(path: Path, units: str, values: Array) -> str:
    """Return the name of the units; gravity's length tells g from m/s^2."""
    if units != 'auto':
        return units
    length = float(np.median(np.linalg.norm(values, axis=1)))
    if 0.5 < length < 2.0:
        return 'g'
    if 5.0 < length < 20.0:
        return 'si'
    raise DataError(
        f'{path}: accelerations of {length:.3g} are neither g nor m/s^2; set units to si or g'
    )


def _sign(path: Path, files: dict[str, bytes], platform: str) -> float:
    """Return +1 where files hold specific force (Android, standardised iOS), -1 for plain iOS."""
    known = _metadata(path, files)
    system = known.get('platform', '') if platform == 'auto' else platform
    if system.startswith('android') or (not system and TOTAL in files):
        return 1.0
    if system.startswith(('ios', 'iphone', 'ipados')):
        return 1.0 if known.get('standardisation') in ('true', '1') else -1.0
    found = f'says {system!r}' if system else 'is missing or does not say'
    raise DataError(
        f'{path}: which phone was this? Metadata.csv {found}; set platform to ios or android'
    )


def _metadata(path: Path, files: dict[str, bytes]) -> dict[str, str]:
    """Return platform and standardisation, lower case, as far as Metadata.csv has them."""
    columns = ('platform', 'standardisation')
    try:
        table = parse_table(f'{path}: metadata', files[METADATA], (), columns, text=columns)
    except (KeyError, DataError):
        return {}
    return {name: cells[0].lower() for name, cells in table.texts.items()}


def _sensor(path: Path, files: dict[str, bytes], name: str, counts: Counter[str]) -> Stamped:
    """Return one sensor's samples, cleaned and counted; columns go by name, not by place."""
    n = parse_table(
        f'{path}: {name}.csv', files[name], ('z', 'y', 'x'), ('time', 'seconds_elapsed'), blank=True
    ).numbers
    if 'time' in n:
        time_s = n['time'] / 1e9
    elif 'seconds_elapsed' in n:
        time_s = n['seconds_elapsed']
    else:
        raise DataError(f'{path}: {name}.csv has no column time or seconds_elapsed')
    values = np.stack([n['x'], n['y'], n['z']], axis=1)
    kept, dropped = clean(ImuSeries(time_s, values, np.full_like(values, np.nan)))
    counts.update(dropped)
    if not len(kept):
        raise DataError(f'{path}: {name}.csv has no usable row')
    return Stamped(kept.time_s, kept.specific_force)


def _resample(sensor: Stamped, time_s: Array) -> Array:
    """
    Return a sensor's values (M, 3) at other stamps (M,); NaN outside its span and in its holes.

    Linear interpolation; but the mean over the interval around each stamp (from the integral, so
    that no turning is lost) where the sensor is more than 1.5 times as fast.
    """
    t, values = sensor
    if len(t) < 2 or len(time_s) < 2:
        return np.full((len(time_s), 3), np.nan)
    step, own = float(np.median(np.diff(time_s))), float(np.median(np.diff(t)))
    if step > 1.5 * own:
        areas = 0.5 * (values[1:] + values[:-1]) * np.diff(t)[:, None]
        integral = np.vstack([np.zeros((1, 3)), np.cumsum(areas, axis=0)])
        low = np.clip(time_s - 0.5 * step, t[0], t[-1])
        high = np.clip(time_s + 0.5 * step, t[0], t[-1])
        width = np.where(high > low, high - low, np.nan)[:, None]
        out = (_interpolate(high, t, integral) - _interpolate(low, t, integral)) / width
    else:
        out = _interpolate(time_s, t, values)
    after = np.clip(np.searchsorted(t, time_s), 1, len(t) - 1)
    hole = (t[after] - t[after - 1] > max(LONGEST_HOLE_S, 3.0 * own)) & ~np.isin(time_s, t)
    out[hole | (time_s < t[0]) | (time_s > t[-1])] = np.nan
    return out


def _interpolate(at: Array, t: Array, values: Array) -> Array:
    return np.stack([np.interp(at, t, values[:, k]) for k in range(3)], axis=1)


def _files(path: Path) -> dict[str, bytes]:
    """
    Return {lower-case stem: content} of the export's CSV files.

    Raise DataError for what is neither a folder nor a readable zip, or holds several recordings.
    """
    try:
        if path.is_dir():
            return {p.stem.lower(): p.read_bytes() for p in path.iterdir() if _is_csv(p.name)}
        with zipfile.ZipFile(path) as archive:
            inside = [PurePosixPath(name) for name in archive.namelist()]
            places = sorted({str(p.parent) for p in inside if p.stem.lower() in FORCE_FILES})
            if len(places) > 1:
                raise DataError(
                    f'{path}: several recordings ({", ".join(places)}); unzip it and name one'
                )
            here = [p for p in inside if _is_csv(p.name) and places == [str(p.parent)]]
            return {p.stem.lower(): archive.read(str(p)) for p in here}
    except FileNotFoundError:
        raise DataError(f'{path}: no such file or folder') from None
    except (OSError, zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(
            f'{path}: not a folder or readable zip of CSV files ({error}); export from Sensor '
            'Logger as zipped CSV'
        ) from None


def _is_csv(name: str) -> bool:
    return name.lower().endswith('.csv') and not name.startswith('.')


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise DataError(f'{name}: {value!r} is not one of {", ".join(choices)}')

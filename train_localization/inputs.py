"""What a live system is given at its start: the line, its origin, and a run to practise with."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from track_localization.geodesy import Datum, geodetic_from_enu
from track_localization.settings import load_yaml
from track_localization.track.centreline import Centreline
from track_localization.track.track_file import read_track
from train_localization.measurements import GnssFix, GnssQuality, Measurement, WheelSpeed

Array = NDArray[np.float64]

SOMEWHERE = Datum(0.7, 0.2, 100.0)
"""Where the practice is, when no datum is given."""
REST_S, RUN_S, STOP_S, GAIN, GRAVITY = 4.0, 40.0, 48.0, 1.0, 9.81
"""Of the run that is practised: standing until, braking from, standing from [s]; [m/s^2]."""
BEGIN_S, RATE_HZ = 1000.0, 100


def read_line(path: str) -> Centreline:
    """Read the surveyed line; raise DataError when it cannot be."""
    return Centreline.from_track(read_track(path))


def read_datum(path: str) -> Datum:
    """Read ``datum.yaml``; raise DataError where it cannot be used."""
    content = load_yaml(Path(path))
    values = []
    for name in ('latitude_deg', 'longitude_deg', 'height_m'):
        value = content.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise DataError(f'{path}: {name} is {value!r}; give a number')
        values.append(float(value))
    return datum_of(values[0], values[1], values[2], path)


def datum_of(latitude_deg: float, longitude_deg: float, height_m: float, where: str) -> Datum:
    """Return a datum; raise DataError that names ``where`` it stands when it is not on Earth."""
    for name, value, limit in (
        ('latitude_deg', latitude_deg, 90.0),
        ('longitude_deg', longitude_deg, 360.0),
        ('height_m', height_m, 2e4),
    ):
        if not abs(value) <= limit:
            raise DataError(f'{where}: {name} is {value}; it must lie within {limit:g}')
    return Datum(math.radians(latitude_deg), math.radians(longitude_deg), height_m)


def practice(line: Centreline | None, datum: Datum) -> Iterator[Measurement]:
    """
    Yield a minute of a run along ``line``, or to the east: what makes every part of a core compile.

    Standing, departure, travel, fixes of four, three and two satellites, one of no covariance and
    one far off, a late speed, wheels that slip and that lock, a gap of the IMU, and a stop.
    """
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    gain = GAIN * ((time_s > REST_S) & (time_s < 24.0)) - 2.5 * GAIN * (
        (time_s > RUN_S) & (time_s < STOP_S)
    )
    speed = np.maximum(np.cumsum(gain) / RATE_HZ, 0.0)
    geodetic, force, rate = _motion(line, datum, speed, gain)
    force += rng.normal(0.0, 0.003, force.shape)
    rate += rng.normal(0.0, 1e-4, rate.shape)
    for k, stamp in enumerate((BEGIN_S + time_s).tolist()):
        if not 3300 <= k < 3400:
            yield ImuSample(stamp, force[k], rate[k])
        if k % 10 == 0:
            slip = 1.4 if 2800 <= k < 2850 else 0.0 if 2900 <= k < 2950 else 1.0
            late = 0.43 if k % 200 == 0 else 0.0
            then = float(speed[k - round(late * RATE_HZ)]) if k else 0.0
            yield WheelSpeed(stamp - late, slip * then, 0.01)
        if k % RATE_HZ == 0:
            yield from _fix(stamp, k // RATE_HZ, geodetic[k] + rng.normal(0.0, 5e-8, 3))


def practised_start(line: Centreline | None) -> tuple[float, Array, Array, Array]:
    """Return where the run that is practised begins, as ``TrainPipeline.set_start`` takes it."""
    covariance = np.diag([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
    if line is None:
        return BEGIN_S, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), covariance
    return BEGIN_S, line.position(0.0), line.quaternion(0.0), covariance


def _motion(
    line: Centreline | None, datum: Datum, speed: Array, gain: Array
) -> tuple[Array, Array, Array]:
    """Return geodetic places, specific forces and angular rates (N, 3) of a run."""
    s = np.cumsum(speed) / RATE_HZ
    force, rate = np.zeros((len(s), 3)), np.zeros((len(s), 3))
    if line is None:
        place = np.stack([s, 0.0 * s, 0.0 * s], axis=1)
        force[:, 2] = GRAVITY
    else:
        inside = np.minimum(s, line.length - 1e-3)
        place, rate = line.position(inside), line.curvature(inside) * speed[:, None]
        up = np.array([so3.matrix_from_quat(q)[2] for q in line.quaternion(inside)])
        force = GRAVITY * up + np.cross(rate, speed[:, None] * [1.0, 0.0, 0.0])
    force[:, 0] += gain
    return geodetic_from_enu(place, datum), force, rate


def _fix(time_s: float, second: int, geodetic: Array) -> Iterator[Measurement]:
    """Yield a fix and its quality, with the faults of that second."""
    latitude, longitude, height = geodetic.tolist()
    satellites = 2 if second in (20, 21, 22) else 3 if second in (26, 27) else 9
    covariance = np.full((3, 3), np.nan) if second == 30 else np.diag([0.25, 0.25, 1.0])
    aside = 2e-5 if second == 18 else 0.0
    yield GnssQuality(time_s, satellites, 9.0 if second == 31 else 1.0)
    yield GnssFix(time_s, latitude + aside, longitude, height, covariance)

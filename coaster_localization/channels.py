"""
Series that can be compared: channels of a motion, smoothed, on a common grid.

Measured ride and design go through the same formulas and the same zero-phase low-pass, so what
the filter takes from one it takes from the other.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from coaster_localization.sensed import Motion
from track_localization.errors import DataError

Array = NDArray[np.float64]

UNITS = {
    'multi': np.array([5.0, 5.0, 5.0, 0.5, 0.5, 0.5, 0.5, 0.5]),
    'heading_free': np.array([5.0, 5.0, 0.5, 0.5, 0.5, 0.5]),
}
"""Scales: forces [m/s^2], components of the vertical, angular rates [rad/s]."""
ACROSS_FORCE = 10.0
"""Force [m/s^2] that weighs as much as a rate of 1 rad/s where the heading is sought."""


@dataclasses.dataclass(frozen=True)
class Grid:
    """
    A motion's channels on a uniform grid, from rest to rest.

    Attributes:
        time_s: (N,) of the motion's clock [s].
        values: (N, C) smoothed channels in their units.
        held: (N,) bool, stands still, in the station or on the way.
        standing: (N,) bool, stands in the station.
    """

    time_s: Array
    values: Array
    held: NDArray[np.bool_]
    standing: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time_s)


def sample_channels(
    motion: Motion, channel: str, rate_hz: float, low_pass_hz: float, rest_s: float
) -> Grid:
    """
    Return ``channel`` of a motion at ``rate_hz``, ``rest_s`` of the rests kept at both ends.

    Raise DataError when the channel needs a gyro and there is none, or the ride is too short.
    """
    if channel != 'z' and not motion.has_gyro:
        raise DataError(f'recording: no gyro, so {channel!r} cannot be had; match channel z')
    native = 1.0 / float(np.median(np.diff(motion.time_s)))
    finer = max(1, int(np.ceil(native / rate_hz - 0.01)))
    start = max(motion.time_s[0], motion.start_s - rest_s)
    end = min(motion.time_s[-1], motion.end_s + rest_s)
    count = int(np.floor((end - start) * rate_hz + 1e-9)) + 1
    if count < 8:
        raise DataError(f'a ride of {end - start:.2f} s has nothing to match')
    lead = int(np.floor((start - motion.time_s[0]) * rate_hz * finer + 1e-9))
    fine = start + np.arange(-lead, (count - 1) * finer + 1) / (rate_hz * finer)
    tail = np.arange(fine[-1] + 1.0 / (rate_hz * finer), motion.time_s[-1], 1.0 / (rate_hz * finer))
    fine = np.concatenate([fine, tail])
    raw = channel_values(motion, channel)
    on_fine = np.stack([np.interp(fine, motion.time_s, c) for c in raw.T], axis=-1)
    smooth = low_pass(on_fine, rate_hz * finer, low_pass_hz)
    rows = lead + finer * np.arange(count)
    time_s = fine[rows]
    nearest = np.searchsorted(motion.time_s, time_s, side='right') - 1
    standing = (time_s < motion.start_s) | (time_s > motion.end_s)
    return Grid(time_s, smooth[rows], motion.held[np.clip(nearest, 0, None)], standing)


def channel_values(motion: Motion, channel: str) -> Array:
    """
    Return the raw channel(s) (N, C) of a motion at its own stamps.

    Beside those of CHANNELS: ``heading_free``, what a turn of the sensor about the body's z axis
    does not change, and ``across``, x and y of the angular rate and of the force, which it turns.
    """
    force, rate, vertical = motion.force, motion.rate, motion.R_nb[:, 2, :]
    if channel == 'z':
        return force[:, 2:3]
    if channel in ('pitch', 'yaw', 'roll'):
        return euler_channel(motion.R_nb, channel)[:, None]
    if channel == 'multi':
        return np.hstack([force[:, [2, 1, 0]], vertical, rate[:, 1:3]])
    if channel == 'heading_free':
        across = [np.linalg.norm(v[:, :2], axis=1)[:, None] for v in (force, vertical, rate)]
        return np.hstack(
            [force[:, 2:], across[0], vertical[:, 2:], across[1], across[2], rate[:, 2:]]
        )
    if channel == 'across':
        return np.hstack([rate[:, :2], force[:, :2] / ACROSS_FORCE])
    raise DataError(f'unknown channel {channel!r}')


def comparable(measured: Array, design: Array, channel: str) -> tuple[Array, Array]:
    """
    Return both series (N, C), (M, C) scaled alike.

    A single channel is z-scored with the design's mean and deviation: both are in SI units, and a
    recording that is cut off has others of its own. Several are divided by the size of what
    separates places, so that they weigh alike.
    """
    if channel in UNITS:
        return measured / UNITS[channel], design / UNITS[channel]
    centre, deviation = design.mean(axis=0), design.std(axis=0)
    deviation = np.where(deviation > 1e-9, deviation, 1.0)
    return (measured - centre) / deviation, (design - centre) / deviation


def mount_heading(measured: Array, design: Array) -> float:
    """
    Return the turn about the body's z axis that takes ``measured`` to ``design`` best [rad].

    Both are (L, 4), matched rows of ``across``: the closed form of the plane's Wahba problem.
    """
    m, d = (v[:, 0::2] + 1j * v[:, 1::2] for v in (measured, design))
    return float(np.angle((np.conj(m) * d).sum()))


def euler_channel(R_nb: Array, channel: str) -> Array:
    """
    Return yaw, pitch or roll (N,) [rad] of attitudes (N, 3, 3), continuous in time.

    Every attitude has two sets of ZYX angles: (yaw, pitch, roll) and (yaw + pi, pi - pitch,
    roll + pi). Of the two, and of their whole turns, each sample takes the one nearest to the
    sample before, so a loop is a pitch that goes on past 90 degrees while yaw and roll stay.
    """
    yaw = np.arctan2(R_nb[:, 1, 0], R_nb[:, 0, 0])
    pitch = -np.arcsin(np.clip(R_nb[:, 2, 0], -1.0, 1.0))
    roll = np.arctan2(R_nb[:, 2, 1], R_nb[:, 2, 2])
    one = np.stack([yaw, pitch, roll], axis=-1)
    two = np.stack([yaw + np.pi, np.pi - pitch, roll + np.pi], axis=-1)
    angles = one.copy()
    turn = 2.0 * np.pi
    for k in range(1, len(one)):
        before = angles[k - 1]
        a, b = (x + turn * np.round((before - x) / turn) for x in (one[k], two[k]))
        nearer = ((a - before) ** 2).sum() <= ((b - before) ** 2).sum()
        angles[k] = a if nearer else b
    return angles[:, ('yaw', 'pitch', 'roll').index(channel)]


def low_pass(values: Array, rate_hz: float, cut_hz: float) -> Array:
    """Return (N, C) without what is faster than ``cut_hz`` (-6 dB), no delay, ends held."""
    if cut_hz >= 0.45 * rate_hz:
        return values
    sos = butter(2, cut_hz, fs=rate_hz, output='sos')
    pad = min(len(values) - 1, int(np.ceil(3.0 * rate_hz / cut_hz)))
    return np.asarray(sosfiltfilt(sos, values, axis=0, padtype='constant', padlen=pad))

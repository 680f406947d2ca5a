"""Vibration of the car: grows with speed, rings at the car's own frequencies and at rail joints."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

JOINT_RING_HZ = 18.0
JOINT_DAMPING = 0.08
RESONANCE_DAMPING = 0.06
FULL_SPEED = 20.0


def vibrate(
    rng: Generator,
    speed: Array,
    chainage: Array,
    rate_hz: float,
    rms: float,
    resonance_hz: tuple[float, float],
    joint_spacing: float,
    wheelbase: float,
) -> Array:
    """
    Return vibration (N, 3) whose rms on each axis is ``rms * speed / 20 m/s``.

    A third of its power is white, a third a resonance drawn between ``resonance_hz`` for each
    axis, and a third hits at rail joints ``joint_spacing`` apart [m], by both bogies, that ring
    at 18 Hz.

    Args:
        rng: of this run.
        speed: (N,) at each sample [m/s].
        chainage: (N,) of row 1 [m].
        rate_hz: sampling rate.
        rms: at 20 m/s [unit of the result].
        resonance_hz: lowest and highest of the axes' resonances.
        joint_spacing: between rail joints [m].
        wheelbase: between the bogies [m].
    """
    count = len(speed)
    level = np.abs(speed) / FULL_SPEED
    out = np.empty((count, 3))
    for axis in range(3):
        white = rng.standard_normal(count)
        tone = _resonance(rng.standard_normal(count), rng.uniform(*resonance_hz), rate_hz)
        hits = _joint_hits(rng, speed, chainage, joint_spacing, wheelbase, rate_hz)
        out[:, axis] = rms / np.sqrt(3.0) * (level * (white + tone) + hits)
    return out


def _resonance(white: Array, frequency: float, rate_hz: float) -> Array:
    """Filter white noise to a narrow band, unit variance."""
    radius = np.exp(-2.0 * np.pi * frequency * RESONANCE_DAMPING / rate_hz)
    poles = np.array([1.0, -2.0 * radius * np.cos(2.0 * np.pi * frequency / rate_hz), radius**2])
    impulse = lfilter([1.0], poles, np.concatenate([[1.0], np.zeros(int(4.0 * rate_hz))]))
    gain = 1.0 / np.sqrt(np.sum(np.asarray(impulse) ** 2))
    return np.asarray(lfilter([gain], poles, white))


def _joint_hits(
    rng: Generator, speed: Array, chainage: Array, spacing: float, wheelbase: float, rate_hz: float
) -> Array:
    """
    Return ringing (N,) after each joint, with an rms of speed / 20 m/s.

    Each joint has a step of random height and sign, the same for both bogies. Hits come at a rate
    that grows with speed, so each grows with the root of it.
    """
    ring = 2.0 * np.pi * JOINT_RING_HZ
    decay = JOINT_DAMPING * ring
    times = np.arange(len(speed)) / rate_hz
    kick = np.zeros((len(speed), 2))
    low, high = float(chainage.min()) - 2.0 * wheelbase, float(chainage.max())
    joints = np.arange(np.floor(low / spacing), np.ceil(high / spacing) + 1.0)
    steps = rng.standard_normal(len(joints))
    places = (joints + rng.uniform(-0.1, 0.1, len(joints))) * spacing
    for behind in (-0.5 * wheelbase, 0.5 * wheelbase):
        which = np.searchsorted(places, chainage - behind)
        crossed = np.flatnonzero(np.diff(which) != 0)
        for i in crossed:
            joint = min(which[i], which[i + 1])
            x0, x1 = chainage[i] - behind, chainage[i + 1] - behind
            share = (places[joint] - x0) / (x1 - x0)
            late = (1.0 - share) / rate_hz
            size = steps[joint] * np.sqrt(abs(speed[i + 1]) / FULL_SPEED) * np.exp(-decay * late)
            kick[i + 1] += size * np.array([np.sin(ring * late), np.cos(ring * late)])
    if len(times) == 0:
        return np.zeros(0)
    radius, angle = np.exp(-decay / rate_hz), ring / rate_hz
    b_sin = [0.0, radius * np.sin(angle)]
    b_cos = [1.0, -radius * np.cos(angle)]
    poles = [1.0, -2.0 * radius * np.cos(angle), radius**2]
    ringing = lfilter(b_sin, poles, kick[:, 1]) + lfilter(b_cos, poles, kick[:, 0])
    power = 2.0 * FULL_SPEED / spacing / (4.0 * decay)
    return np.asarray(ringing / np.sqrt(power))

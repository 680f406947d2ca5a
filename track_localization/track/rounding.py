"""
Track files with few decimals: the rounding told from the shape, and taken out.

A millimetre of rounding every half metre looks like 1 m/s^2 of shaking at 25 m/s once it has been
differentiated twice. Shape varies over metres, rounding from row to row.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags_array, eye_array
from scipy.sparse.linalg import spsolve

from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

WORTH_SMOOTHING = 1e-5
"""Noise of positions [m] or unit vectors above which rows are smoothed."""

CUTOFF_M = 4.0
"""Wavelength halved by the smoothing [m]; 15 m passes to 0.04 %, and coasters bend no faster."""


def row_noise(values: Array) -> float:
    """Return the rms (white from row to row) of columns (N, K), told by sixth differences."""
    if len(values) < 20:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 6, axis=0))) / 0.6745 / np.sqrt(924.0))


def without_rounding(track: TrackFile, closed: bool) -> TrackFile:
    """
    Return the track with its rounding smoothed out; itself where there is none to speak of.

    Rows that are not about evenly spaced are left alone.
    """
    spacing = np.linalg.norm(np.diff(track.position, axis=0), axis=1)
    even = float(spacing.max()) < 1.6 * float(np.median(spacing))
    axes = np.concatenate([track.front, track.left, track.up], axis=1)
    noise = max(row_noise(track.position), row_noise(axes))
    if not even or noise < WORTH_SMOOTHING:
        return track
    step = float(np.median(spacing))
    position = smooth(track.position, step, closed)
    u, _, vt = np.linalg.svd(smooth(axes, step, closed).reshape(-1, 3, 3))
    front, left, up = np.moveaxis(u @ vt, 1, 0)
    return TrackFile(position, front, left, up)


def smooth(values: Array, step: float, closed: bool) -> Array:
    """Return columns (N, K) with wavelengths below CUTOFF_M taken out (Whittaker's smoother)."""
    pad = min(60, len(values) - 1) if closed else 0
    padded = np.concatenate([values[len(values) - pad :], values, values[:pad]])
    count = len(padded)
    third = diags_array([-1.0, 3.0, -3.0, 1.0], offsets=[0, 1, 2, 3], shape=(count - 3, count))
    weight = (CUTOFF_M / (2.0 * np.pi * step)) ** 6
    out = np.asarray(spsolve((eye_array(count) + weight * third.T @ third).tocsc(), padded))
    return out[pad : pad + len(values)]

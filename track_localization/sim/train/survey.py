"""The line as surveyed: rows of ``track.csv`` that lie a little beside the line."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from track_localization.estimation import so3
from track_localization.geodesy import enu_from_geodetic
from track_localization.sim.train.config import Survey
from track_localization.sim.train.route import Route, axes_in_map
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

KNOTS_PER_LENGTH = 2.0
"""Knots of the smooth error in a correlation length."""


def survey(rng: Generator, config: Survey, route: Route) -> tuple[TrackFile, dict[str, Any]]:
    """Return the rows, and the rms of their errors as drawn."""
    length = route.alignment.length
    s = np.linspace(0.0, length, max(round(length / config.row_m), 8) + 1)
    cross, height = float(rng.uniform(*config.cross_m)), float(rng.uniform(*config.height_m))
    beside = cross * _smooth(rng, config.correlation_m, s)
    above = height * _smooth(rng, config.correlation_m, s)
    latitude, longitude, h = route.place(s)
    local = axes_in_map(latitude, longitude, route.datum)
    R, up = local @ route.pose(s, np.zeros_like(s)).attitude, local[:, :, 2]
    left = np.cross(up, R[:, :, 0])
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    position = enu_from_geodetic(latitude, longitude, h, route.datum)
    position += (config.aside_m + beside)[:, None] * left + above[:, None] * up
    away = np.gradient(beside, s)[:, None] * left + np.gradient(above, s)[:, None] * up
    R = so3.exp(np.cross(R[:, :, 0], away)) @ R
    track = TrackFile(position, R[:, :, 0], R[:, :, 1], R[:, :, 2])
    return track, {'cross_m': cross, 'height_m': height, 'aside_m': config.aside_m}


def _smooth(rng: Generator, correlation: float, s: Array) -> Array:
    """Return a smooth process (N,) by chainage, of zero mean and unit rms over the line."""
    knots = max(int(np.ceil(KNOTS_PER_LENGTH * s[-1] / correlation)), 3) + 1
    values = CubicSpline(np.linspace(0.0, s[-1], knots), rng.standard_normal(knots))(s)
    values = values - values.mean()
    return np.asarray(values / np.sqrt(np.mean(values**2)))

"""Pictures of errors: along the track, as a distribution, at each marker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.evaluation.metrics import RideErrors
from track_localization.evaluation.plots_style import (
    colour,
    dress,
    new_figure,
    plain_log,
    save,
)

Array = NDArray[np.float64]

FLOOR_M = 0.01
"""Errors smaller than this are drawn at it, where an axis is logarithmic [m]."""


def error_along_track(
    file: Path,
    errors: Mapping[str, RideErrors],
    markers: Mapping[str, float],
    called: str = 'markers',
) -> Path:
    """
    Draw each method's error along the track by true chainage, with the band of 2 sigma.

    Args:
        file: the PNG to write.
        errors: by method; one panel each.
        markers: chainage [m] by name, drawn as ticks.
        called: what the ticks are.
    """
    count = max(1, len(errors))
    figure = new_figure(11.0, 1.2 + 2.3 * count)
    panels = np.atleast_1d(figure.subplots(count, 1, sharex=True))
    for axes, (name, ride) in zip(panels, errors.items(), strict=False):
        s, along, sigma = (_gaps(ride, v) for v in (ride.chainage, ride.along, ride.sigma_along))
        axes.fill_between(
            s, -2.0 * sigma, 2.0 * sigma, color=colour(name), alpha=0.2, lw=0, label='2 sigma'
        )
        axes.plot(s, along, color=colour(name), lw=0.9, label=name)
        limit = max(0.2, 1.4 * _most(along, 99.5), 2.4 * _most(sigma, 80.0))
        axes.set_ylim(-limit, limit)
        for at in markers.values():
            axes.axvline(at, ymax=0.05, color='#d55e00', lw=1.2)
        axes.legend(frameon=False, loc='upper left', ncols=2, fontsize='small')
        dress(axes, '', 'error [m]')
    panels[0].set_title(
        f'error along the track, positive ahead; orange ticks are {called}',
        loc='left',
        fontsize='medium',
    )
    panels[-1].set_xlabel('true distance along the track [m]')
    panels[-1].margins(x=0.01)
    return save(figure, file)


def error_distribution(file: Path, errors: Mapping[str, RideErrors]) -> Path:
    """Draw, for each method, the share of the moving ride with an error below x."""
    figure = new_figure(9.0, 4.8)
    axes = figure.subplots()
    for name, ride in errors.items():
        distance = np.sort(np.maximum(ride.distance, FLOOR_M))
        if len(distance):
            share = np.arange(1, len(distance) + 1) / len(distance)
            axes.plot(distance, share, color=colour(name), lw=1.6, label=name)
    axes.set_xscale('log')
    axes.set_xlim(left=FLOOR_M)
    axes.set_ylim(0.0, 1.0)
    plain_log(axes.xaxis, (1.0,))
    axes.legend(frameon=False, loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize='small')
    dress(
        axes, 'position error [m]', 'share of the moving ride', 'how often the error stays below x'
    )
    return save(figure, file)


def error_at_markers(file: Path, names: Sequence[str], errors: Mapping[str, Array]) -> Path:
    """Draw each method's distance (K,) [m] from the design position at the K named markers."""
    figure = new_figure(11.0, 4.6)
    axes = figure.subplots()
    for name, distance in errors.items():
        axes.plot(
            range(len(names)),
            np.maximum(distance, FLOOR_M),
            'o-',
            ms=4,
            lw=0.8,
            color=colour(name),
            label=f'{name} (mean {np.nanmean(distance):.2f} m)'
            if np.isfinite(distance).any()
            else name,
        )
    axes.set_yscale('log')
    plain_log(axes.yaxis, (1.0,))
    axes.set_xticks(range(len(names)), names, rotation=45, ha='right')
    axes.legend(frameon=False, loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize='small')
    dress(axes, '', 'error [m]', 'distance from the design position at each marker')
    return save(figure, file)


def _gaps(ride: RideErrors, values: Array) -> Array:
    """Return ``values`` with NaN where the truth stood still or the chainage wrapped."""
    out = values.astype(np.float64).copy()
    if len(out) > 2:
        broken = np.diff(ride.time_s) > 1.0
        broken |= np.diff(ride.chainage) < -1.0
        out[1:][broken] = np.nan
    return out


def _most(values: Array, percent: float) -> float:
    magnitude = np.abs(values[np.isfinite(values)])
    return float(np.percentile(magnitude, percent)) if len(magnitude) else 0.0

"""The train paper's Figures 3 to 6: the way, its increments with an outage, the errors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import at_times
from track_localization.evaluation.navigation_metrics import NavigationErrors
from track_localization.evaluation.plots_navigation import EAST, NORTH, shade
from track_localization.evaluation.plots_style import colour, dress, new_figure, save

OUTAGE = '#e69f00'
LIMIT_M = 10.0
"""What the paper says of its SINS/DR."""
AROUND_S = 5.0

Span = tuple[float, float]


def line(file: Path, truth: Trajectory, outage: Span) -> Path:
    """Draw the true way with its start and end, and those of the outage (Fig. 3)."""
    figure = new_figure(7.5, 6.0)
    axes = figure.subplots()
    _draw_truth(axes, truth, outage)
    named = {
        'start': truth.time_s[0],
        'end': truth.time_s[-1],
        'satellites lost': outage[0],
        'and back': outage[1],
    }
    for (name, when), mark in zip(named.items(), ('o', 's', 'v', '^'), strict=True):
        place = at_times(truth, np.array([when])).position[0] - truth.position[0]
        axes.plot(*place[:2], mark, ms=8, label=name)
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend(frameon=False)
    dress(axes, EAST, NORTH, 'Fig. 3: the way and where satellites are lost')
    return save(figure, file)


def increments(
    file: Path, tracks: Mapping[str, Trajectory], truth: Trajectory, outage: Span, title: str
) -> Path:
    """Draw estimates and truth as increments from the start, whole and where the outage ends."""
    figure = new_figure(11.5, 5.4)
    whole, near = figure.subplots(1, 2)
    origin = truth.position[0]
    end = at_times(truth, np.array([outage[1]])).position[0] - origin
    for axes in (whole, near):
        _draw_truth(axes, truth, outage)
        for name, estimate in tracks.items():
            x, y = (estimate.position - origin)[:, :2].T
            axes.plot(x, y, color=colour(name), lw=1.1, label=name)
    last = np.array([outage[1] - 0.05])
    places = {n: at_times(t, last).position[0] - origin for n, t in tracks.items()}
    true = at_times(truth, last).position[0] - origin
    near.plot(*true[:2], 'x', color=colour('truth'), ms=9)
    for name, place in places.items():
        near.plot(*place[:2], 'o', color=colour(name), ms=6)
    off = [float(np.hypot(*(place - true)[:2])) for place in places.values()]
    reach = 1.4 * float(np.clip(max((d for d in off if np.isfinite(d)), default=3.0), 3.0, 100.0))
    near.set_xlim(end[0] - reach, end[0] + reach)
    near.set_ylim(end[1] - reach, end[1] + reach)
    whole.set_aspect('equal', adjustable='datalim')
    near.set_aspect('equal', adjustable='box')
    whole.legend(frameon=False, fontsize='small')
    dress(whole, EAST, NORTH, title)
    dress(near, EAST, NORTH, 'where the outage ends; dots: at that moment')
    return save(figure, file)


def errors(file: Path, runs: Mapping[str, NavigationErrors], outage: Span, begin_s: float) -> Path:
    """Draw north and east errors by time (Fig. 6), around the outage; the paper's 10 m dashed."""
    figure = new_figure(11.5, 6.4)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (k, side) in zip(panels, ((1, 'north'), (0, 'east')), strict=True):
        shade(axes, [outage], begin_s)
        for limit in (-LIMIT_M, LIMIT_M):
            axes.axhline(limit, color='#222222', ls='--', lw=0.9)
        for name, run in runs.items():
            axes.plot(
                run.time_s - begin_s, run.position[:, k], color=colour(name), lw=1.1, label=name
            )
        most = max((_within(run, outage, k) for run in runs.values()), default=0.0)
        reach = 1.2 * float(np.clip(most, 1.05 * LIMIT_M, 60.0))
        axes.set_ylim(-reach, reach)
        dress(axes, '', f'{side} error [m]')
    panels[0].set_title(
        "Fig. 6: errors; shaded: no satellites; dashed: the paper's 10 m",
        loc='left',
        fontsize='medium',
    )
    panels[0].legend(frameon=False, ncols=4, fontsize='small', loc='upper left')
    panels[1].set_xlabel('time [s]')
    panels[1].margins(x=0.01)
    return save(figure, file)


def _within(run: NavigationErrors, outage: Span, k: int) -> float:
    """Return the greatest error of an axis from the outage's begin to a little after its end."""
    inside = run.within([(outage[0], outage[1] + AROUND_S)])
    return float(np.abs(run.position[inside, k]).max()) if inside.any() else 0.0


def _draw_truth(axes: Axes, truth: Trajectory, outage: Span) -> None:
    x, y = (truth.position - truth.position[0])[:, :2].T
    axes.plot(x, y, color=colour('truth'), lw=1.2, ls='--', label='truth')
    inside = (truth.time_s >= outage[0]) & (truth.time_s <= outage[1])
    axes.plot(x[inside], y[inside], color=OUTAGE, lw=6.0, alpha=0.35, label='outage')

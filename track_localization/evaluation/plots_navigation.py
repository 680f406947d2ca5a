"""Pictures of a vehicle that navigates by satellites: the way, errors by time, modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import at_times
from track_localization.evaluation.navigation_metrics import NavigationErrors, Spans
from track_localization.evaluation.plots_style import colour, dress, new_figure, save

Array = NDArray[np.float64]

SHADE = '#f0e0c8'
"""Of outages."""
MODE_COLOURS: Mapping[str, str] = {
    'aligning': '#deebf7',
    'BDS/SINS': '#a6dba0',
    'height-aided': '#ffe08a',
    'SINS/DR': '#9ecae1',
    'SINS': '#b2182b',
}
OTHER_MODES = ('#969696', '#cc79a7', '#56b4e9')
EAST, NORTH = 'east of the start [m]', 'north of the start [m]'


def way(
    file: Path,
    tracks: Mapping[str, Trajectory],
    truth: Trajectory | None,
    outages: Spans,
    track: Array | None = None,
) -> Path:
    """
    Draw the way as increments from its start (paper, Figs. 3 to 5), and the longest outage's end.

    Args:
        file: the PNG to write.
        tracks: estimates by method.
        truth: the true motion, if it is known.
        outages: from and to of each [s].
        track: (K, 3) points of the surveyed line, if there is one.
    """
    figure = new_figure(11.5, 5.6)
    whole, near = figure.subplots(1, 2)
    known = next(iter(tracks.values())) if truth is None else truth
    origin = known.position[0]
    for axes in (whole, near):
        if track is not None:
            x, y = (track - origin)[:, :2].T
            axes.plot(x, y, color=colour('design'), lw=4.0, alpha=0.35, label='track.csv')
        for name, estimate in tracks.items():
            x, y = (estimate.position - origin)[:, :2].T
            axes.plot(x, y, color=colour(name), lw=1.1, label=name)
        if truth is not None:
            x, y = (truth.position - origin)[:, :2].T
            axes.plot(x, y, color=colour('truth'), lw=1.0, ls='--', label='truth')
    whole.set_aspect('equal', adjustable='datalim')
    near.set_aspect('equal', adjustable='box')
    _mark(whole, known, outages, origin)
    dress(whole, EAST, NORTH, 'the way; orange: no satellites')
    _look_at_end(near, known, tracks, outages, origin)
    whole.legend(frameon=False, fontsize='small')
    return save(figure, file)


def _mark(axes: Axes, known: Trajectory, outages: Spans, origin: Array) -> None:
    """Draw start, end and outages over a way."""
    for begin, end in outages:
        inside = (known.time_s >= begin) & (known.time_s <= end)
        x, y = (known.position[inside] - origin)[:, :2].T
        axes.plot(x, y, color='#e69f00', lw=6.0, alpha=0.4)
    for row, mark in ((0, 'o'), (-1, 's')):
        axes.plot(*(known.position[row] - origin)[:2], mark, color='#222222', ms=5)


def _look_at_end(
    axes: Axes, known: Trajectory, tracks: Mapping[str, Trajectory], outages: Spans, origin: Array
) -> None:
    """Show what is around the end of the longest outage, or of the way."""
    ends_s = max(outages, key=lambda span: span[1] - span[0])[1] if outages else known.time_s[-1]
    when = np.array([ends_s - 1e-3])
    centre = at_times(known, when).position[0] - origin
    if not np.isfinite(centre).all():
        centre = known.position[-1] - origin
    places = {name: at_times(t, when).position[0] - origin for name, t in tracks.items()}
    off = [float(np.hypot(*(place - centre)[:2])) for place in places.values()]
    reach = 1.3 * float(np.clip(max((d for d in off if np.isfinite(d)), default=10.0), 5.0, 200.0))
    axes.set_xlim(centre[0] - reach, centre[0] + reach)
    axes.set_ylim(centre[1] - reach, centre[1] + reach)
    for name, place in places.items():
        axes.plot(*place[:2], 'o', color=colour(name), ms=6)
    axes.plot(*centre[:2], 'x', color=colour('truth'), ms=9)
    what = 'the end of the longest outage' if outages else 'the end'
    dress(axes, EAST, NORTH, f'around {what}; dots: where each is then')


def errors(
    file: Path, runs: Mapping[str, NavigationErrors], outages: Spans, begin_s: float
) -> Path:
    """Draw each method's east and north error by time with its 2 sigma (paper, Fig. 6)."""
    figure = new_figure(11.5, 1.0 + 2.0 * len(runs))
    panels = figure.subplots(len(runs), 2, sharex=True, squeeze=False)
    for row, (name, run) in zip(panels, runs.items(), strict=True):
        sigma = np.sqrt(np.maximum(np.diagonal(run.P, axis1=1, axis2=2), 0.0))
        t = _broken(run.time_s - begin_s, run.time_s)
        most = 1.0
        for k, axes in enumerate(row):
            shade(axes, outages, begin_s)
            error, band = (_broken(v[:, k], run.time_s) for v in (run.position, 2.0 * sigma))
            axes.fill_between(t, -band, band, color=colour(name), alpha=0.2, lw=0)
            axes.plot(t, error, color=colour(name), lw=0.9)
            most = max(most, 1.2 * float(np.nanpercentile(np.abs(error), 99.7)))
        for axes, side in zip(row, ('east', 'north'), strict=True):
            axes.set_ylim(-most, most)
            dress(axes, '', f'{side} [m]', name)
    panels[0, 0].set_title(f'{next(iter(runs), "")}: error and 2 sigma; shaded: no satellites',
                           loc='left', fontsize='medium')  # fmt: skip
    for axes in panels[-1]:
        axes.set_xlabel('time [s]')
        axes.margins(x=0.01)
    return save(figure, file)


def levels(
    file: Path, runs: Mapping[str, NavigationErrors], outages: Spans, begin_s: float
) -> Path:
    """Draw the level error of all methods by time on one logarithmic axis."""
    figure = new_figure(11.5, 4.2)
    axes = figure.subplots()
    shade(axes, outages, begin_s)
    for name, run in runs.items():
        t = _broken(run.time_s - begin_s, run.time_s)
        level = _broken(np.maximum(run.horizontal, 0.01), run.time_s)
        axes.plot(t, level, color=colour(name), lw=1.0, label=name)
    axes.set_yscale('log')
    axes.legend(frameon=False, ncols=len(runs), fontsize='small', loc='upper left')
    axes.margins(x=0.01)
    dress(axes, 'time [s]', 'level error [m]', 'level error; shaded: no satellites')
    return save(figure, file)


def modes(
    file: Path,
    changes: Mapping[str, Sequence[tuple[float, str]]],
    outages: Spans,
    span_s: tuple[float, float],
) -> Path:
    """Draw what each method's position rests on by time; ``changes`` are (from [s], mode)."""
    figure = new_figure(11.5, 1.4 + 0.4 * len(changes))
    axes = figure.subplots()
    shade(axes, outages, span_s[0])
    shown: dict[str, str] = {}
    for y, entries in enumerate(changes.values()):
        ends = [*(time for time, _ in entries), span_s[1]][1:]
        for (begin, mode), end in zip(entries, ends, strict=True):
            fill = MODE_COLOURS.get(mode, OTHER_MODES[len(shown) % len(OTHER_MODES)])
            fill = shown.setdefault(mode, fill)
            axes.barh(y, end - begin, left=begin - span_s[0], height=0.6, color=fill, lw=0)
    axes.set_yticks(range(len(changes)), list(changes), fontsize='small')
    axes.set_ylim(len(changes) - 0.5, -0.5)
    axes.set_xlim(0.0, max(span_s[1] - span_s[0], 1e-3))
    dress(axes, 'time [s]', '', 'what the position rests on; shaded: no satellites')
    axes.grid(False, axis='y')
    axes.legend(
        handles=[Patch(color=fill, label=mode) for mode, fill in shown.items()],
        frameon=False, loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize='small',
    )  # fmt: skip
    return save(figure, file)


def shade(axes: Axes, outages: Spans, begin_s: float) -> None:
    """Shade the outages on an axis of time."""
    for begin, end in outages:
        axes.axvspan(begin - begin_s, end - begin_s, color=SHADE, lw=0, zorder=0)


def _broken(values: Array, time_s: Array) -> Array:
    """Return values (N,) with NaN where the epochs have a gap, so that no line crosses it."""
    out = np.array(values, dtype=np.float64)
    if len(out) > 2:
        step = np.diff(time_s)
        out[1:][step > max(5.0 * float(np.median(step)), 1.0)] = np.nan
    return out

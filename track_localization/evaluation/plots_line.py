"""Pictures of a vehicle on a line by time: place, speed, doubt, and the health of its sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import at_times, speed_of
from track_localization.evaluation.plots_style import (
    colour,
    dress,
    new_figure,
    plain_log,
    save,
)

Array = NDArray[np.float64]
States = Sequence[tuple[float, str, str]]
"""Changes of a sensor's state: (time [s], sensor, state from then on)."""

STATE_COLOURS: Mapping[str, str] = {
    'waiting': '#deebf7',
    'ok': '#a6dba0',
    'silent': '#969696',
    'isolated': '#b2182b',
}
"""Colours of states that sensors are often in; others get one of their own."""
OTHER_STATES = ('#e69f00', '#56b4e9', '#cc79a7', '#f0e442')
MARK = '#d55e00'


def speeds(
    file: Path, tracks: Mapping[str, Trajectory], truth: Trajectory | None, begin_s: float
) -> Path:
    """
    Draw speeds against time, and below what is wrong with each where the truth is known.

    Args:
        file: the PNG to write.
        tracks: estimates by method.
        truth: the true motion, if it is known.
        begin_s: time that the axis counts from [s].
    """
    count = 0 if truth is None else len(tracks)
    figure = new_figure(11.0, 3.0 + 1.6 * count)
    panels = np.atleast_1d(
        figure.subplots(1 + count, 1, sharex=True, height_ratios=[1.8, *[1.0] * count])
    )
    for name, track in tracks.items():
        panels[0].plot(
            track.time_s - begin_s, speed_of(track), color=colour(name), lw=1.0, label=name
        )
    dress(panels[0], '', 'speed [m/s]', 'speed along the line')
    if truth is not None:
        _draw_truth(panels[0], truth.time_s - begin_s, speed_of(truth))
        for axes, (name, track) in zip(panels[1:], tracks.items(), strict=True):
            _speed_error(axes, name, track, truth, begin_s)
        panels[1].set_title('estimated minus true speed', loc='left', fontsize='medium')
    _legend_above(panels[0])
    panels[-1].set_xlabel('time [s]')
    panels[-1].margins(x=0.01)
    return save(figure, file)


def places(
    file: Path,
    tracks: Mapping[str, Trajectory],
    truth: Trajectory | None,
    balises: Array,
    begin_s: float,
) -> Path:
    """
    Draw distance along the line against time with the balises (K,) [m], and the claimed 2 sigma.

    Both need no truth; sigma is on a logarithmic axis.
    """
    figure = new_figure(11.0, 6.4)
    above, below = figure.subplots(2, 1, sharex=True)
    for name, track in tracks.items():
        if track.chainage is not None:
            above.plot(
                track.time_s - begin_s, track.chainage, color=colour(name), lw=1.2, label=name
            )
        if track.sigma_along is not None:
            sigma = np.maximum(2.0 * track.sigma_along, 1e-3)
            below.plot(track.time_s - begin_s, sigma, color=colour(name), lw=0.9)
    if truth is not None and truth.chainage is not None:
        _draw_truth(above, truth.time_s - begin_s, truth.chainage)
    for at in balises:
        above.axhline(at, xmax=0.012, color=MARK, lw=1.2)
    _legend_above(above)
    dress(above, '', 'distance [m]', 'place along the line; orange ticks are balises')
    below.set_yscale('log')
    low, high = below.get_ylim()
    plain_log(below.yaxis, (1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,))
    dress(below, 'time [s]', '2 sigma [m]', 'doubt that each method claims')
    below.margins(x=0.01)
    return save(figure, file)


def health(
    file: Path,
    methods: Mapping[str, States],
    heard: Mapping[str, Array],
    span_s: tuple[float, float],
) -> Path:
    """
    Draw what each method thought of each sensor over time, and when the sensors were heard.

    Args:
        file: the PNG to write.
        methods: changes of state by method.
        heard: arrivals (K,) of each sensor's messages [s], drawn as ticks; rows stand in its order.
        span_s: begin and end of the recording [s].
    """
    rows = {name: states for name, states in methods.items() if states}
    figure = new_figure(11.0, 1.6 + 0.34 * len(heard) * (len(rows) + 1))
    axes = figure.subplots()
    labels: list[str] = []
    shown: dict[str, str] = {}
    for sensor, times in heard.items():
        y = len(labels)
        axes.axhline(y - 0.5, color='#808080', lw=0.6)
        axes.vlines(_thinned(times, span_s) - span_s[0], y - 0.3, y + 0.3, color='#404040', lw=0.5)
        labels.append(f'{sensor}: messages')
        for name, states in rows.items():
            for begin, end, state in _spells(states, sensor, span_s[1]):
                shade = shown.setdefault(state, _state_colour(state, shown))
                left, width = begin - span_s[0], end - begin
                axes.barh(len(labels), width, left=left, height=0.6, color=shade, lw=0)
            labels.append(name)
    axes.set_yticks(range(len(labels)), labels, fontsize='small')
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(0.0, max(span_s[1] - span_s[0], 1e-3))
    dress(axes, 'time [s]', '', 'messages, and what each method thinks of the sensors')
    axes.grid(False, axis='y')
    axes.legend(
        handles=[Patch(color=shade, label=state) for state, shade in shown.items()],
        frameon=False, loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize='small',
    )  # fmt: skip
    return save(figure, file)


def _draw_truth(axes: Axes, time_s: Array, values: Array) -> None:
    axes.plot(time_s, values, color=colour('truth'), lw=0.9, ls='--', label='truth')


def _legend_above(axes: Axes) -> None:
    """Put the legend right of the title, out of the curves' way."""
    axes.legend(
        frameon=False, loc='lower right', bbox_to_anchor=(1.0, 0.98), ncols=6, fontsize='small'
    )


def _speed_error(
    axes: Axes, name: str, track: Trajectory, truth: Trajectory, begin_s: float
) -> None:
    """Draw one method's speed error; the axis shows nearly all of it."""
    error = speed_of(track) - speed_of(at_times(truth, track.time_s))
    axes.plot(track.time_s - begin_s, error, color=colour(name), lw=0.8)
    finite = np.abs(error[np.isfinite(error)])
    limit = 1.3 * float(np.percentile(finite, 99.5)) if len(finite) else 0.0
    axes.set_ylim(-max(limit, 0.05), max(limit, 0.05))
    dress(axes, '', 'error [m/s]')


def _spells(states: States, sensor: str, end_s: float) -> list[tuple[float, float, str]]:
    """Return (begin, end, state) of a sensor's states one after the other."""
    changes = [(time, state) for time, name, state in states if name == sensor]
    ends = [*(time for time, _ in changes), end_s][1:]
    return [(time, max(end, time), state) for (time, state), end in zip(changes, ends, strict=True)]


def _state_colour(state: str, shown: Mapping[str, str]) -> str:
    if state in STATE_COLOURS:
        return STATE_COLOURS[state]
    return OTHER_STATES[len(shown.keys() - STATE_COLOURS.keys()) % len(OTHER_STATES)]


def _thinned(times: Array, span_s: tuple[float, float], count: int = 2000) -> Array:
    """Return one time for each of ``count`` parts of the span that has any."""
    width = max(span_s[1] - span_s[0], 1e-9) / count
    _, first = np.unique(np.floor((times - span_s[0]) / width), return_index=True)
    return times[first]

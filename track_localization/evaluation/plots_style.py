"""What all pictures share: one colour per method, sizes, and how they are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

COLOURS: Mapping[str, str] = {
    'truth': '#000000',
    'design': '#b0b0b0',
    'imu': '#b22222',
    'dtw_z': '#7f7f7f',
    'dtw_penalised': '#e69f00',
    'srdtw_z': '#0072b2',
    'srdtw_pitch': '#56b4e9',
    'srdtw_yaw': '#cc79a7',
    'srdtw_roll': '#999933',
    'srdtw_multi': '#6a3d9a',
    'eskf_paper': '#7f5539',
    'eskf_live': '#00a087',
    'eskf': '#1b7837',
    'eskf_smoothed': '#d55e00',
    'eskf_srdtw': '#8c6bb1',
    'track_filter': '#4b0092',
    'track_filter_lag': '#8856a7',
    'track_filter_smoothed': '#dc267f',
    'paper': '#c51b7d',
    'robust': '#1a9850',
    'kalman': '#2166ac',
    'ins': '#8c2d04',
    'robust_map': '#e08214',
    'smoothed': '#542788',
}
"""Colours that stay with a method in every picture."""

SPARE = ('#332288', '#117733', '#882255', '#44aa99', '#ddcc77', '#aa4499')


def colour(method: str) -> str:
    """Return the method's colour; names not in ``COLOURS`` get a lasting one from their letters."""
    return COLOURS.get(method, SPARE[sum(method.encode()) % len(SPARE)])


def new_figure(width: float = 10.0, height: float = 4.5) -> Figure:
    """Return an empty figure of a size in inches, drawn without a display."""
    return Figure(figsize=(width, height), layout='constrained')


def dress(axes: Axes, x: str, y: str, title: str = '') -> None:
    """Label both axes with quantity and unit, add a light grid and a title."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(True, color='#e0e0e0', linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[['top', 'right']].set_visible(False)
    if title:
        axes.set_title(title, loc='left', fontsize='medium')


def plain_log(axis: Axis, steps: Sequence[float]) -> None:
    """Write the ticks of a logarithmic axis as plain numbers, at ``steps`` of each decade."""
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
    axis.set_minor_formatter(NullFormatter())


def save(figure: Figure, path: Path) -> Path:
    """Write a PNG and return its path."""
    figure.savefig(path, dpi=120, facecolor='white')
    return path

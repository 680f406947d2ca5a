"""The maglev paper's Figures 2 to 6: place and speed of its train, and the errors of both."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from track_localization.evaluation.plots_style import colour, dress, new_figure, save

Array = NDArray[np.float64]

TIME = 'time [s]'


@dataclasses.dataclass(frozen=True)
class Drive:
    """
    What one method makes of one drive.

    Attributes:
        time_s: (N,) of the estimates, from the start on [s].
        chainage, speed: (N,) estimated [m, m/s].
        error, speed_error: (N,) estimated less true [m, m/s].
    """

    time_s: Array
    chainage: Array
    speed: Array
    error: Array
    speed_error: Array


Drives = Mapping[str, Mapping[str, Drive]]
"""By loop, then by method."""


def figures_2_to_6(
    folder: Path,
    alone: Drives,
    helped: Drives,
    balises: Mapping[str, Array],
    truth: tuple[Array, Array, Array],
) -> list[Path]:
    """
    Draw ``fig2.png`` to ``fig6.png``; return their paths.

    Args:
        folder: where.
        alone: estimates without balises.
        helped: estimates with balises.
        balises: times of passing by loop [s].
        truth: times (M,) [s], chainage (M,) [m] and speed (M,) [m/s]; of the last loop.
    """
    return [
        estimated(folder / 'fig2.png', alone, truth, 'chainage', 'place [m]', 'Fig. 2: place'),
        estimated(folder / 'fig3.png', alone, truth, 'speed', 'speed [m/s]', 'Fig. 3: speed'),
        errors(folder / 'fig4.png', alone, 'error', (-10.0, 10.0), 'Fig. 4: no balises'),
        errors(folder / 'fig5.png', alone, 'speed_error', (-0.3, 0.4), 'Fig. 5: no balises'),
        errors(folder / 'fig6.png', helped, 'error', (-1.0, 1.0), 'Fig. 6: with balises', balises),
    ]


def estimated(
    file: Path,
    drives: Drives,
    truth: tuple[Array, Array, Array],
    quantity: str,
    label: str,
    title: str,
) -> Path:
    """Draw a quantity, ``chainage`` or ``speed``, as estimated and as it was."""
    figure, panels = _panels(drives)
    true = truth[1] if quantity == 'chainage' else truth[2]
    for axes, (loop, methods) in zip(panels, drives.items(), strict=True):
        axes.plot(truth[0], true, color=colour('truth'), lw=2.6, alpha=0.35, label='truth')
        for method, drive in methods.items():
            values = getattr(drive, quantity)
            axes.plot(drive.time_s, values, color=colour(method), lw=1.0, label=method)
        dress(axes, TIME, label, f'{title}, {loop}')
    panels[0].legend(edgecolor='none', framealpha=0.9)
    return save(figure, file)


def errors(
    file: Path,
    drives: Drives,
    quantity: str,
    paper: tuple[float, float],
    title: str,
    balises: Mapping[str, Array] | None = None,
) -> Path:
    """Draw errors, ``error`` or ``speed_error``, with what the ``paper`` says of them dashed."""
    figure, panels = _panels(drives)
    label = 'error of the place [m]' if quantity == 'error' else 'error of the speed [m/s]'
    for axes, (loop, methods) in zip(panels, drives.items(), strict=True):
        for k, limit in enumerate(paper):
            name = 'the paper' if k == 0 else None
            axes.axhline(limit, color='#222222', ls='--', lw=0.9, label=name)
        for at in [] if balises is None else balises[loop]:
            axes.axvline(at, color='#d55e00', lw=0.7, alpha=0.5)
        for method, drive in methods.items():
            values = getattr(drive, quantity)
            axes.plot(drive.time_s, values, color=colour(method), lw=1.1, label=method)
        dress(axes, TIME, label, f'{title}, {loop}')
    panels[0].legend(edgecolor='none', framealpha=0.9)
    return save(figure, file)


def _panels(drives: Drives) -> tuple[Figure, list[Axes]]:
    """Return a figure with a panel for each loop."""
    figure = new_figure(11.5, 4.2)
    return figure, list(figure.subplots(1, len(drives), squeeze=False)[0])

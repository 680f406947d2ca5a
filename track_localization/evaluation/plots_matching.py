"""Pictures of a match: which sample went with which, and the positions that gives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from track_localization.evaluation.plots_style import colour, dress, new_figure, save

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class MatchLines:
    """
    Two series and the warping path between them.

    Attributes:
        title: the panel's heading.
        measured_time_s, measured: (N,) the ride.
        design_time_s, design: (M,) the design simulation.
        path: (L, 2) pairs of indices (measured, design).
        cuts: (K, 2) pairs of indices at which segments meet, or None.
    """

    title: str
    measured_time_s: Array
    measured: Array
    design_time_s: Array
    design: Array
    path: NDArray[np.int64]
    cuts: NDArray[np.int64] | None = None


def matching_lines(file: Path, panels: Sequence[MatchLines], quantity: str) -> Path:
    """
    Draw each panel's two series one above the other with every 50th pair joined (paper, Fig. 6).

    Joints of segments carry a circle at both ends. Times count from each series' own start.
    """
    figure = new_figure(11.0, 3.2 * len(panels))
    for axes, panel in zip(np.atleast_1d(figure.subplots(len(panels))), panels, strict=True):
        _match_panel(axes, panel, quantity)
    return save(figure, file)


def _match_panel(axes: Axes, panel: MatchLines, quantity: str) -> None:
    t_measured = panel.measured_time_s - panel.measured_time_s[0]
    t_design = panel.design_time_s - panel.design_time_s[0]
    spread = np.concatenate([panel.measured, panel.design])
    offset = 1.3 * float(np.ptp(np.percentile(spread, [1.0, 99.0])))

    def joined(pairs: NDArray[np.int64]) -> Array:
        i, j = pairs[:, 0], pairs[:, 1]
        top = np.stack([t_measured[i], panel.measured[i] + offset], axis=1)
        return np.stack([top, np.stack([t_design[j], panel.design[j]], axis=1)], axis=1)

    pairs = joined(panel.path[::50])
    axes.add_collection(LineCollection(list(pairs), colors='#b8b8b8', linewidths=0.6, zorder=1))
    axes.plot(t_measured, panel.measured + offset, color=colour('srdtw_z'), lw=1.0, zorder=3)
    axes.plot(t_design, panel.design, color='#444444', lw=1.0, zorder=3)
    if panel.cuts is not None and len(panel.cuts):
        lines = joined(panel.cuts)
        axes.add_collection(LineCollection(list(lines), colors='#d55e00', linewidths=0.7, zorder=2))
        ends = lines.reshape(-1, 2)
        axes.plot(
            ends[:, 0], ends[:, 1], 'o', ms=3.5, mfc='white', mec='#d55e00', mew=0.9, zorder=4
        )
    title = f'{panel.title}: measured (top) and design (bottom), every 50th pair joined'
    if panel.cuts is not None:
        title += ', circles at cuts'
    dress(axes, 'time from the start of each series [s]', f'{quantity}, offset', title)
    axes.margins(x=0.01)


def matched_positions(
    file: Path,
    design: Array,
    time_s: Array,
    position: Array,
    chainage: Array,
    truth: tuple[Array, Array] | None,
    name: str,
) -> Path:
    """
    Draw the matched positions on the design line, and their chainage by time (paper, Fig. 7).

    Args:
        file: the PNG to write.
        design: (M, 3) positions of the design line in ``map`` [m].
        time_s: (N,) stamps of the match [s].
        position: (N, 3) matched positions [m].
        chainage: (N,) matched chainage [m].
        truth: stamps and chainage of the truth, where there is one.
        name: method, for the colour and the legend.
    """
    figure = new_figure(11.0, 4.6)
    plan, by_time = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
    plan.plot(design[:, 0], design[:, 1], color=colour('design'), lw=2.5, alpha=0.6, label='design')
    second = np.unique(np.floor(time_s), return_index=True)[1]
    dots = plan.scatter(
        position[second, 0], position[second, 1], c=time_s[second], s=16, cmap='viridis', zorder=3
    )
    figure.colorbar(dots, ax=plan, label='time of the measured sample [s]', shrink=0.8)
    plan.set_aspect('equal', adjustable='datalim')
    dress(plan, 'x [m]', 'y [m]', f'{name}: matched position, one dot a second')
    if truth is not None:
        by_time.plot(*truth, color=colour('truth'), lw=2.4, alpha=0.35, label='truth')
    by_time.plot(time_s, chainage, color=colour(name), lw=1.0, label=name)
    by_time.legend(frameon=False, loc='upper left')
    dress(by_time, 'time [s]', 'distance along the track [m]', 'where the match puts the vehicle')
    return save(figure, file)

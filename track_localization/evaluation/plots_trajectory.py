"""Pictures of where the vehicle went and how fast."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import speed_of
from track_localization.evaluation.plots_style import colour, dress, new_figure, save

Array = NDArray[np.float64]


def paths_3d(
    file: Path,
    design: Array,
    paths: Mapping[str, Array],
    markers: Array | None = None,
) -> Path:
    """
    Draw paths in space with the design line (paper, Fig. 12).

    A path that drifts away is cut where it leaves a box around the design line, and the legend
    says how far from the line it ends.

    Args:
        file: the PNG to write.
        design: (M, 3) positions of the design line in ``map`` [m].
        paths: (N, 3) positions by name [m].
        markers: (K, 3) design positions of markers [m].
    """
    figure = new_figure(9.0, 6.5)
    axes = figure.add_subplot(projection='3d')
    centre = 0.5 * (design.min(axis=0) + design.max(axis=0))
    reach = 0.5 * np.ptp(design, axis=0) + 0.15 * float(np.ptp(design, axis=0).max())
    axes.plot(*design.T, color=colour('design'), lw=3.5, alpha=0.5, label='design')
    for name, path in paths.items():
        shown, left = _inside(path, centre, reach)
        label = name
        if left:
            away = float(np.linalg.norm(path[-1] - design, axis=1).min())
            label += f' (leaves the picture, ends {away:.0f} m off)'
        axes.plot(*shown.T, color=colour(name), lw=1.3, label=label)
    if markers is not None and len(markers):
        axes.scatter(*markers.T, s=22, c='#d55e00', depthshade=False, label='markers')
    limits = (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())
    axes.set_box_aspect([high - low for low, high in limits], zoom=1.0)
    axes.set_xlabel('x [m]')
    axes.set_ylabel('y [m]')
    axes.set_zlabel('z [m]')
    axes.view_init(elev=32.0, azim=-60.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
        axis.line.set_color('#999999')
    axes.zaxis.set_major_locator(MaxNLocator(4))
    axes.legend(frameon=False, loc='upper left', fontsize='small')
    return save(figure, file)


def _inside(path: Array, centre: Array, reach: Array) -> tuple[Array, bool]:
    """Return the path (N, 3) until it leaves a box, NaN from there on, and whether it does."""
    outside = (np.abs(path - centre) > reach).any(axis=1)
    shown = path.copy()
    if outside.any():
        shown[int(np.argmax(outside)) :] = np.nan
    return shown, bool(outside.any())


def speeds(
    file: Path,
    design_time_s: Array,
    design_speed: Array,
    tracks: Mapping[str, Trajectory],
    truth: Trajectory | None = None,
) -> Path:
    """
    Draw the design speed above, and the speeds of the methods below (paper, Fig. 13).

    Speeds of methods come from their positions, |p[k+1] - p[k]| / dt, as the paper's do. The axis
    ends at 1.6 times the design's greatest speed: drift and jumps beyond it are cut off.
    """
    figure = new_figure(11.0, 6.0)
    above, below = figure.subplots(2, 1)
    top = 1.6 * float(np.max(design_speed))
    above.plot(design_time_s - design_time_s[0], design_speed, color=colour('design'), lw=1.4)
    above.set_ylim(0.0, top)
    dress(above, 'time of the design ride [s]', 'speed [m/s]', '(a) design simulation')
    for name, track in tracks.items():
        bare = Trajectory(track.time_s, track.position)
        below.plot(bare.time_s, speed_of(bare), color=colour(name), lw=1.0, label=name)
    if truth is not None:
        below.plot(
            truth.time_s, speed_of(truth), color=colour('truth'), lw=0.9, ls='--', label='truth'
        )
    below.set_ylim(0.0, top)
    below.legend(frameon=False, loc='upper left', ncols=5, fontsize='small')
    title = f'(b) from the recording, cut off at {top:.0f} m/s'
    dress(below, 'time of the recording [s]', 'speed [m/s]', title)
    for axes in (above, below):
        axes.margins(x=0.01)
    return save(figure, file)

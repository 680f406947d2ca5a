"""Pictures of how the fused error depends on the observation covariance (paper, Figs 14, 15)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from track_localization.evaluation.plots_style import (
    colour,
    dress,
    new_figure,
    plain_log,
    save,
)

Array = NDArray[np.float64]


def error_by_lambda(
    file: Path, lambda_y: Array, ratio: Array, error: Array, matching: float
) -> Path:
    """
    Draw the fused error at markers by lambda_y and n = lambda_x / lambda_y (paper, Fig. 14).

    Args:
        file: the PNG to write.
        lambda_y: (J,) variances across the track [m^2].
        ratio: (K,) values of n.
        error: (J, K) mean error at markers [m].
        matching: the error of the match that was fused [m].
    """
    figure = new_figure(11.5, 4.6)
    lines, cells = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    shades = colormaps['viridis'](np.linspace(0.0, 0.9, len(lambda_y)))
    for row, value, shade in zip(error, lambda_y, shades, strict=True):
        lines.plot(ratio, row, 'o-', ms=3.5, lw=1.2, color=shade, label=f'{value:g} m²')
    lines.axhline(matching, color='#222222', ls='--', lw=1.0, label='match alone')
    lines.set_xscale('log')
    lines.set_ylim(bottom=0.0)
    plain_log(lines.xaxis, (1.0,))
    lines.legend(frameon=False, title='lambda_y', fontsize='small')
    dress(lines, 'n = lambda_x / lambda_y', 'mean error at markers [m]')
    _cells(cells, lambda_y, ratio, error)
    return save(figure, file)


def error_by_channel(file: Path, lambda_x: Array, error: Mapping[str, Array]) -> Path:
    """Draw the fused error (K,) [m] by lambda_x (K,) [m^2], a line a channel (paper, Fig. 15)."""
    figure = new_figure(8.0, 4.6)
    axes = figure.subplots()
    for name, row in error.items():
        axes.plot(lambda_x, row, 'o-', ms=4, lw=1.4, color=colour(f'srdtw_{name}'), label=name)
    axes.set_xscale('log')
    axes.set_yscale('log')
    plain_log(axes.xaxis, (1.0,))
    plain_log(axes.yaxis, (1.0, 2.0, 5.0))
    axes.legend(frameon=False, title='channel', fontsize='small')
    dress(axes, 'lambda_x [m²] at n = 1000', 'mean error at markers [m]')
    return save(figure, file)


def _cells(axes: Axes, lambda_y: Array, ratio: Array, error: Array) -> None:
    shown = np.clip(error, 1e-3, None)
    image = axes.imshow(shown, origin='lower', aspect='auto', cmap='viridis_r', norm=LogNorm())
    middle = float(np.sqrt(np.nanmin(shown) * np.nanmax(shown)))
    for j, k in np.ndindex(*error.shape):
        shade = 'white' if shown[j, k] > middle else 'black'
        axes.text(k, j, f'{error[j, k]:.2f}', ha='center', va='center', size=8, color=shade)
    axes.set_xticks(range(len(ratio)), [f'{n:g}' for n in ratio])
    axes.set_yticks(range(len(lambda_y)), [f'{value:g}' for value in lambda_y])
    axes.set_xlabel('n = lambda_x / lambda_y')
    axes.set_ylabel('lambda_y [m²]')
    bar = axes.figure.colorbar(image, ax=axes, label='mean error at markers [m]')
    plain_log(bar.ax.yaxis, (1.0, 2.0, 3.0, 5.0))

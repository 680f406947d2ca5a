"""Pictures of several rides of one track by chainage: two compared, and what many teach."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from track_localization import GRAVITY
from track_localization.evaluation.plots_style import dress, new_figure, save

Array = NDArray[np.float64]

RIDE_A, RIDE_B, FLAG = '#0072b2', '#d55e00', '#ddcc77'
MRAD = 1e3
TWO_SIDED_95 = 1.96


@dataclasses.dataclass(frozen=True)
class RideCurves:
    """
    Two rides on one grid of chainages, M rows; pairs are ride A and ride B.

    ``speed`` [m/s], ``difference`` B minus A with its ``sigma`` [m/s], ``time_difference`` [s],
    ``force`` (M, 3) in body axes [m/s^2].
    """

    chainage: Array
    speed: tuple[Array, Array]
    difference: Array
    sigma: Array
    time_difference: Array
    force: tuple[Array, Array]


def rides_by_chainage(
    file: Path, curves: RideCurves, elements: Sequence[tuple[str, float, float, bool]]
) -> Path:
    """
    Draw speeds, their difference, the time difference and the forces of two rides.

    ``elements`` are (name, from, to, whether the speeds differ significantly); those that do are
    shaded.
    """
    figure = new_figure(12.0, 13.0)
    axes = figure.subplots(6, 1, sharex=True, height_ratios=(1.3, 1.1, 0.9, 1.0, 1.0, 1.0))
    s = curves.chainage
    for name, colour, speed in zip('AB', (RIDE_A, RIDE_B), curves.speed, strict=True):
        axes[0].plot(s, speed, color=colour, lw=1.2, label=f'ride {name}')
    axes[0].legend(frameon=False, loc='upper right', ncols=2)
    _band(axes[1], s, curves.difference, TWO_SIDED_95 * curves.sigma, '#333333')
    _limit(axes[1], curves.difference)
    axes[2].plot(s, curves.time_difference, color='#333333', lw=1.2)
    for row, k in ((3, 2), (4, 1), (5, 0)):
        for colour, force in zip((RIDE_A, RIDE_B), curves.force, strict=True):
            axes[row].plot(s, force[:, k] / GRAVITY, color=colour, lw=0.8)
    for ax in axes:
        for _, begin, end, differs in elements:
            if differs:
                ax.axvspan(begin, end, color=FLAG, alpha=0.3, lw=0)
            ax.axvline(begin, color='#cccccc', lw=0.6, zorder=0)
    for name, begin, end, _ in elements:
        axes[0].annotate(
            name,
            (0.5 * (begin + end), 1.0),
            xycoords=('data', 'axes fraction'),
            ha='center',
            va='bottom',
            fontsize=7,
            rotation=25,
        )
    labels = (
        'speed [m/s]',
        'speed, B - A\n[m/s], 95 %',
        'time, B - A [s]',
        'vertical [g]',
        'lateral [g]',
        'longitudinal [g]',
    )
    for ax, label in zip(axes, labels, strict=True):
        dress(ax, '', label)
    axes[-1].set_xlabel('chainage [m]; shaded: mean speeds differ significantly')
    return save(figure, file)


@dataclasses.dataclass(frozen=True)
class LearnedCurves:
    """
    What rides taught of a line, M rows.

    ``deviation`` and its standard ``error`` (M, 3) about x, y, z of the body [rad], ``turn``
    (M, 3) what of it is used; ``speeds`` (K, M) of the rides, ``usual`` and ``design`` [m/s].
    """

    chainage: Array
    deviation: Array
    error: Array
    turn: Array
    speeds: Array
    usual: Array
    design: Array


def learned_by_chainage(
    file: Path, curves: LearnedCurves, flagged: Sequence[tuple[str, float, float]]
) -> Path:
    """Draw where built track and design differ; ``flagged`` are (axis, from, to), shaded."""
    figure = new_figure(12.0, 11.0)
    axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.0, 1.0, 1.0, 1.2))
    s = curves.chainage
    signs = ('+ right side down', '+ nose down', '+ nose left')
    for k, name in enumerate(('roll', 'pitch', 'yaw')):
        width = TWO_SIDED_95 * MRAD * curves.error[:, k]
        _band(axes[k], s, MRAD * curves.deviation[:, k], width, RIDE_A)
        axes[k].plot(s, MRAD * curves.turn[:, k], color='#333333', lw=0.7, label='used')
        for axis, begin, end in flagged:
            if axis == name:
                axes[k].axvspan(begin, end, color=FLAG, alpha=0.45, lw=0)
        dress(axes[k], '', f'{name} [mrad]\n{signs[k]}')
    axes[0].legend(frameon=False, loc='upper right')
    axes[0].set_title(
        "built track's attitude against the design's, mean over rides, 95 %; shaded: flagged",
        loc='left',
        fontsize='medium',
    )
    for speed in curves.speeds:
        axes[3].plot(s, speed, color='#999999', lw=0.5)
    axes[3].plot(s, curves.design, color='#333333', ls='--', lw=1.0, label='design')
    axes[3].plot(s, curves.usual, color=RIDE_B, lw=1.3, label='usual')
    axes[3].legend(frameon=False, loc='upper right', ncols=2)
    dress(axes[3], 'chainage [m]', 'speed [m/s]')
    return save(figure, file)


def _band(axes: Axes, s: Array, value: Array, half: Array, colour: str) -> None:
    axes.fill_between(s, value - half, value + half, color=colour, alpha=0.25, lw=0)
    axes.plot(s, value, color=colour, lw=1.1)
    axes.axhline(0.0, color='#888888', lw=0.6)


def _limit(axes: Axes, value: Array) -> None:
    """Keep a few wide intervals (a train that stops) from flattening the rest."""
    finite = np.abs(value[np.isfinite(value)])
    if len(finite):
        reach = 1.4 * float(np.percentile(finite, 99.0)) + 0.1
        axes.set_ylim(-reach, reach)

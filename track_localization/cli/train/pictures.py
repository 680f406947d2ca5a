"""The train's pictures: the way, errors by time, speed, modes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from track_localization.cli.train.inputs import Inputs
from track_localization.cli.train.results import Outcome
from track_localization.evaluation import plots_line, plots_navigation
from track_localization.evaluation.report import Picture

ROW_M = 5.0


def draw(folder: Path, inputs: Inputs, outcomes: Mapping[str, Outcome]) -> list[Picture]:
    """Draw what these results allow; return the pictures in the report's order."""
    tracks = {name: one.trajectory for name, one in outcomes.items() if len(one.trajectory)}
    if not tracks:
        return []
    begin_s, end_s = _span(inputs)
    line = None
    if inputs.track is not None:
        line = inputs.track.position(np.arange(0.0, inputs.track.length, ROW_M))
    file = plots_navigation.way(folder / 'way.png', tracks, inputs.truth, inputs.outages, line)
    pictures = [Picture(file, 'The way from its start (Figures 3 to 5 of the paper).')]
    runs = {n: one.errors for n, one in outcomes.items() if one.errors is not None}
    runs = {name: errors for name, errors in runs.items() if len(errors)}
    if runs:
        file = plots_navigation.levels(folder / 'level_error.png', runs, inputs.outages, begin_s)
        pictures.append(Picture(file, 'Level error by time, all methods.'))
        file = plots_navigation.errors(folder / 'error_by_time.png', runs, inputs.outages, begin_s)
        pictures.append(Picture(file, 'East and north error by time (Figure 6), and 2 sigma.'))
    file = plots_line.speeds(folder / 'speeds.png', tracks, inputs.truth, begin_s)
    pictures.append(Picture(file, 'Speed, and what is wrong with it where that is known.'))
    changes = {name: one.result.modes for name, one in outcomes.items()}
    span = (begin_s, end_s)
    file = plots_navigation.modes(folder / 'modes.png', changes, inputs.outages, span)
    pictures.append(Picture(file, 'What the position rests on.'))
    return pictures


def _span(inputs: Inputs) -> tuple[float, float]:
    """Return when the recording begins and ends, in the clock of the stamps [s]."""
    stamps = inputs.recorded.imu.time_s[np.isfinite(inputs.recorded.imu.time_s)]
    low, high = np.percentile(stamps, [0.1, 99.9])
    near = stamps[(stamps > low - 60.0) & (stamps < high + 60.0)]
    return float(near.min()), float(near.max())

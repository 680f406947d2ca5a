"""The maglev's pictures: error by distance, speed, place and doubt, health of the sensors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.cli.maglev.inputs import SENSORS, Inputs
from track_localization.cli.maglev.results import Outcome
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation import plots_errors, plots_line
from track_localization.evaluation.line_metrics import since
from track_localization.evaluation.metrics import RideErrors
from track_localization.evaluation.report import Picture

Array = NDArray[np.float64]


def draw(folder: Path, inputs: Inputs, outcomes: Mapping[str, Outcome]) -> list[Picture]:
    """Draw what these results allow; return the pictures in the report's order."""
    tracks = {name: one.trajectory for name, one in outcomes.items() if len(one.trajectory)}
    begin_s, end_s = _span(inputs)
    heard = _heard(inputs)
    pictures = _errors(folder, inputs, outcomes)
    if tracks:
        file = plots_line.speeds(folder / 'speeds.png', tracks, inputs.truth, begin_s)
        pictures.append(Picture(file, 'Speed, and what is wrong with it where that is known.'))
        balises = inputs.balises.chainage[_reached(inputs, tracks)]
        file = plots_line.places(folder / 'places.png', tracks, inputs.truth, balises, begin_s)
        pictures.append(Picture(file, 'Place along the line, and the doubt that is claimed.'))
    states = {name: one.result.health for name, one in outcomes.items()}
    file = plots_line.health(folder / 'health.png', states, heard, (begin_s, end_s))
    pictures.append(Picture(file, 'When sensors were heard, and what the methods thought of them.'))
    return pictures


def _errors(folder: Path, inputs: Inputs, outcomes: Mapping[str, Outcome]) -> list[Picture]:
    runs = {n: one.errors for n, one in outcomes.items() if one.errors is not None}
    runs = {name: errors for name, errors in runs.items() if len(errors.time_s)}
    if not runs:
        return []
    pictures = [
        _by_distance(folder / 'error_along_track.png', inputs, runs, ''),
        Picture(
            plots_errors.error_distribution(folder / 'error_distribution.png', runs),
            'Distribution of the position error over the moving run.',
        ),
    ]
    if inputs.first_balise_s is not None:
        later = {name: since(errors, inputs.first_balise_s) for name, errors in runs.items()}
        later = {name: errors for name, errors in later.items() if len(errors.time_s)}
        file = folder / 'error_from_first_balise.png'
        if later:
            pictures.insert(1, _by_distance(file, inputs, later, ', from the first balise on'))
    return pictures


def _by_distance(
    file: Path, inputs: Inputs, runs: Mapping[str, RideErrors], stretch: str
) -> Picture:
    low = min(float(errors.chainage.min()) for errors in runs.values())
    high = max(float(errors.chainage.max()) for errors in runs.values())
    marks = {
        name: s
        for name, s in zip(inputs.balises.id, inputs.balises.chainage.tolist(), strict=True)
        if low - 1.0 <= s <= high + 1.0
    }
    plots_errors.error_along_track(file, runs, marks, 'balises')
    return Picture(file, f'Error by distance{stretch}, with the claimed 2 sigma, and the balises.')


def _span(inputs: Inputs) -> tuple[float, float]:
    """Return when the recording begins and ends, in the clock of the stamps [s]."""
    stamps = inputs.readings.time_s[np.isfinite(inputs.readings.time_s)]
    low, high = np.percentile(stamps, [0.1, 99.9])
    near = stamps[(stamps > low - 60.0) & (stamps < high + 60.0)]
    return float(near.min()), float(near.max())


def _heard(inputs: Inputs) -> dict[str, Array]:
    """Return the stamps of each sensor's messages."""
    of = np.array(inputs.readings.sensor)
    begin_s, end_s = _span(inputs)
    times = {s.sensor: inputs.readings.time_s[of == s.sensor] for s in SENSORS}
    return {name: t[(t >= begin_s) & (t <= end_s)] for name, t in times.items()}


def _reached(inputs: Inputs, tracks: Mapping[str, Trajectory]) -> NDArray[np.bool_]:
    """Return which balises lie on the stretch that was run, by the truth or else by the methods."""
    known = [inputs.truth] if inputs.truth is not None else list(tracks.values())
    s = np.concatenate([t.chainage for t in known if t.chainage is not None])
    at = inputs.balises.chainage
    inside: NDArray[np.bool_] = (at >= s.min() - 1.0) & (at <= s.max() + 1.0)
    return inside

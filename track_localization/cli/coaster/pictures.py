"""The coaster's pictures: the paper's Figures 6, 7 and 12 to 15, and errors along the track."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from coaster_localization.methods import MATCHING, MethodResult
from track_localization.cli.coaster.inputs import Inputs
from track_localization.cli.coaster.results import Reference
from track_localization.cli.coaster.sweeps import LAMBDA_X, LAMBDA_Y, RATIO, Sweeps
from track_localization.evaluation import (
    plots_errors,
    plots_matching,
    plots_sweeps,
    plots_trajectory,
)
from track_localization.evaluation.metrics import travelled
from track_localization.evaluation.report import Picture

FUSED = (
    *('track_filter_smoothed', 'track_filter_lag', 'track_filter'),
    *('eskf_smoothed', 'eskf', 'eskf_live', 'eskf_paper'),
)
"""Fused methods, the best first."""

Results = Mapping[str, MethodResult]


def draw(
    folder: Path, inputs: Inputs, results: Results, reference: Reference, sweeps: Sweeps | None
) -> list[Picture]:
    """Draw what these results allow; return the pictures in the report's order."""
    pictures = [
        *_paths(folder, inputs, results),
        *_speeds(folder, inputs, results),
        *_errors(folder, inputs, results, reference),
        *_matches(folder, inputs, results, reference),
    ]
    if sweeps is not None:
        pictures += _sweeps(folder, sweeps)
    return pictures


def best(results: Results) -> str | None:
    """Return the best fused method among the results."""
    return next((name for name in FUSED if name in results), None)


def _shown_match(results: Results) -> str | None:
    order = ('srdtw_z', 'srdtw_multi', *MATCHING)
    return next((name for name in order if name in results), None)


def _paths(folder: Path, inputs: Inputs, results: Results) -> list[Picture]:
    names = [name for name in ('imu', best(results)) if name in results]
    paths = {name: results[name].trajectory.position for name in names if name is not None}
    markers = inputs.markers.position if inputs.markers is not None else None
    file = plots_trajectory.paths_3d(
        folder / 'fig12_paths.png', inputs.design.position, paths, markers
    )
    return [Picture(file, 'Paths in space: design, IMU alone, fused (paper, Fig. 12).')]


def _speeds(folder: Path, inputs: Inputs, results: Results) -> list[Picture]:
    names = ('imu', _shown_match(results), best(results))
    tracks = {n: results[n].trajectory for n in names if n is not None and n in results}
    file = plots_trajectory.speeds(
        folder / 'fig13_speeds.png',
        inputs.design.time_s,
        inputs.design.speed,
        tracks,
        inputs.recording.truth,
    )
    return [Picture(file, 'Speeds: design, IMU alone, match, fused (paper, Fig. 13).')]


def _errors(folder: Path, inputs: Inputs, results: Results, reference: Reference) -> list[Picture]:
    pictures = []
    truth, markers = reference.truth, inputs.markers
    rides = {n: e for n, r in results.items() if (e := reference.ride(r.trajectory)) is not None}
    shown = ('dtw_penalised', 'eskf_live', 'eskf_smoothed', 'track_filter', 'track_filter_smoothed')
    panels = [n for n in shown if n in rides]
    panels = panels or list(rides)[:3]
    if truth is not None and panels:
        places = {}
        if markers is not None:
            s = np.interp(markers.time_s, truth.time_s, travelled(truth), np.nan, np.nan)
            places = dict(zip(markers.name, s[np.isfinite(s)].tolist(), strict=False))
        file = plots_errors.error_along_track(
            folder / 'error_along_track.png', {n: rides[n] for n in panels if n}, places
        )
        pictures.append(Picture(file, 'Error along the track with the claimed 2 sigma.'))
        file = plots_errors.error_distribution(folder / 'error_distribution.png', rides)
        pictures.append(Picture(file, 'Distribution of the position error over the moving ride.'))
    if markers is not None:
        at_markers = {
            n: reference.markers(r.trajectory).design for n, r in results.items() if n != 'imu'
        }
        file = plots_errors.error_at_markers(
            folder / 'error_at_markers.png', markers.name, at_markers or {}
        )
        pictures.append(Picture(file, 'Distance from the design position at each marker.'))
    return pictures


def _matches(folder: Path, inputs: Inputs, results: Results, reference: Reference) -> list[Picture]:
    names = [n for n in ('dtw_z', 'srdtw_z') if n in results] or [
        n for n in [_shown_match(results)] if n is not None
    ]
    panels = []
    for name in names:
        match = results[name].match
        if match is not None:
            last = (len(match.measured) - 1, len(match.design) - 1)
            panels.append(
                plots_matching.MatchLines(
                    name,
                    match.time_s,
                    match.measured[:, 0],
                    match.design_grid_s,
                    match.design[:, 0],
                    match.path,
                    None if match.cuts is None else np.minimum(match.cuts, last),
                )
            )
    if not panels:
        return []
    file = plots_matching.matching_lines(folder / 'fig6_matching.png', panels, 'scaled channel [-]')
    pictures = [Picture(file, 'Pairs that DTW and SRDTW chose (paper, Fig. 6).')]
    shown = _shown_match(results)
    match = results[shown].match if shown is not None else None
    if match is not None and shown is not None:
        truth = reference.truth
        file = plots_matching.matched_positions(
            folder / 'fig7_positions.png',
            inputs.design.position,
            match.time_s,
            match.position,
            match.chainage,
            None if truth is None else (truth.time_s, travelled(truth)),
            shown,
        )
        pictures.append(Picture(file, 'Positions from the match (paper, Fig. 7).'))
    return pictures


def _sweeps(folder: Path, sweeps: Sweeps) -> list[Picture]:
    ratio, lambda_y = np.array(RATIO), np.array(LAMBDA_Y)
    by_lambda = {
        feed: plots_sweeps.error_by_lambda(
            folder / f'fig14_{feed}.png', lambda_y, ratio, grid, sweeps.matching[feed]
        )
        for feed, grid in sweeps.by_lambda.items()
    }
    by_channel = plots_sweeps.error_by_channel(
        folder / 'fig15_channels.png', np.array(LAMBDA_X), sweeps.by_channel
    )
    return [
        *(
            Picture(
                file, f"Fused error by lambda_y and n, the paper's filter fed by {feed} (Fig. 14)."
            )
            for feed, file in by_lambda.items()
        ),
        Picture(by_channel, 'Fused error by lambda_x for each channel, n = 1000 (paper, Fig. 15).'),
    ]

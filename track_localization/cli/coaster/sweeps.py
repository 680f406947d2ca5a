"""The fused error by the observation covariance and by channel: the paper's Figures 14 and 15."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from coaster_localization.config import CoasterConfig
from coaster_localization.matching import Match
from coaster_localization.methods import apply_mount, observations
from coaster_localization.pipeline import CoasterEskf
from coaster_localization.smoothing import estimates_to_trajectory, run_filter
from track_localization.cli.coaster.results import Reference, match_trajectory
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.line_table import LineTable

Array = NDArray[np.float64]

LAMBDA_Y = (0.01, 0.1, 1.0)
RATIO = (1.0, 10.0, 100.0, 1000.0, 10000.0)
LAMBDA_X = (0.1, 1.0, 10.0, 100.0)
CHANNEL_RATIO = 1000.0
FEEDS = ('srdtw_paper', 'srdtw_z')
"""What the filter of Fig. 14 is fed by: the paper's own match, and SRDTW on Z at its best."""
CHANNELS = {'z': 'srdtw_z', 'pitch': 'srdtw_pitch', 'yaw': 'srdtw_yaw', 'roll': 'srdtw_roll'}


@dataclasses.dataclass(frozen=True)
class Sweeps:
    """
    Mean error at markers [m] after the paper's filter.

    Attributes:
        by_lambda: (J, K) for LAMBDA_Y and RATIO, by which of FEEDS the filter is fed (Fig. 14).
        by_channel: (K,) for LAMBDA_X at n = 1000, by channel (Fig. 15).
        matching: each match's own error, by feed and by channel.
    """

    by_lambda: dict[str, Array]
    by_channel: dict[str, Array]
    matching: dict[str, float]


def runs(methods: Collection[str]) -> int:
    """Return how many times ``sweep`` runs the filter on these methods' matches, for progress."""
    grids = len([feed for feed in FEEDS if feed in methods])
    channels = len([m for m in CHANNELS.values() if m in methods])
    return len(LAMBDA_Y) * len(RATIO) * grids + len(LAMBDA_X) * channels


def sweep(
    imu: ImuSeries,
    design: DesignRide,
    config: CoasterConfig,
    matches: Mapping[str, Match],
    reference: Reference,
    step: Callable[[str], None],
) -> Sweeps:
    """
    Run the paper's filter over the grids.

    Args:
        imu: the recording, in the sensor's axes.
        design: the design ride.
        config: settings; only lambda_x, n and the preset are varied.
        matches: by method name; those of FEEDS and CHANNELS are used.
        reference: must have markers.
        step: called with a label before each run.
    """
    last_s = float(np.max(reference.marker_time_s)) + 1.0
    imu = apply_mount(imu[imu.time_s <= last_s], config.mount_rpy_deg)
    line = LineTable(Centreline.from_design_ride(design))

    def error(match: Match, lambda_x: float, ratio: float, label: str) -> float:
        step(label)
        changed = dataclasses.replace(config.eskf, preset='paper', lambda_x=lambda_x, n=ratio)
        filter_ = CoasterEskf(design, changed, line)
        feed = [m for m in observations(match, config.matcher.rate_hz) if m.time_s <= last_s]
        return _at_markers(estimates_to_trajectory(run_filter(filter_, imu, feed), line), reference)

    by_lambda = {
        feed: np.array(
            [
                [error(matches[feed], y * n, n, f'{feed}, lambda_y {y:g}, n {n:g}') for n in RATIO]
                for y in LAMBDA_Y
            ]
        )
        for feed in FEEDS
        if feed in matches
    }
    by_channel = {
        channel: np.array(
            [error(matches[m], x, CHANNEL_RATIO, f'{channel}, lambda_x {x:g}') for x in LAMBDA_X]
        )
        for channel, m in CHANNELS.items()
        if m in matches
    }
    own = {
        name: _at_markers(match_trajectory(matches[m]), reference)
        for name, m in {**{feed: feed for feed in FEEDS}, **CHANNELS}.items()
        if m in matches
    }
    return Sweeps(by_lambda, by_channel, own)


def as_figures(sweeps: Sweeps) -> dict[str, float]:
    """Return the sweeps as ``srdtw_z_ly0.1_n100``, ``pitch_lx10`` and such; see ``collect``."""
    out = {f'match_{name}': value for name, value in sweeps.matching.items()}
    for feed, grid in sweeps.by_lambda.items():
        for y, row in zip(LAMBDA_Y, grid, strict=True):
            out |= {f'{feed}_ly{y:g}_n{n:g}': float(e) for n, e in zip(RATIO, row, strict=True)}
    for channel, row in sweeps.by_channel.items():
        out |= {f'{channel}_lx{x:g}': float(e) for x, e in zip(LAMBDA_X, row, strict=True)}
    return out


def collect(rides: Sequence[Mapping[str, float]]) -> Sweeps | None:
    """Return the medians over rides of what ``as_figures`` gave; None for no rides."""
    if not rides:
        return None

    def median(name: str) -> float:
        return float(np.median([ride[name] for ride in rides]))

    known = [n for n in (*FEEDS, *CHANNELS) if all(f'match_{n}' in ride for ride in rides)]
    by_lambda = {
        feed: np.array([[median(f'{feed}_ly{y:g}_n{n:g}') for n in RATIO] for y in LAMBDA_Y])
        for feed in FEEDS
        if feed in known
    }
    by_channel = {
        channel: np.array([median(f'{channel}_lx{x:g}') for x in LAMBDA_X])
        for channel in CHANNELS
        if channel in known
    }
    return Sweeps(by_lambda, by_channel, {name: median(f'match_{name}') for name in known})


def _at_markers(estimate: Trajectory, reference: Reference) -> float:
    distance = reference.markers(estimate).design
    known = np.isfinite(distance)
    return float(distance[known].mean()) if known.any() else float('nan')

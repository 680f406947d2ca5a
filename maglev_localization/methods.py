"""Every maglev method by name, run over one recording: what an evaluation compares."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from maglev_localization.config import MaglevConfig
from maglev_localization.estimate import Estimate
from maglev_localization.measurements import Measurement
from maglev_localization.pipeline import MaglevPipeline
from track_localization import garbage
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.balise_table import BaliseTable

METHODS = ('paper', 'robust', 'kalman')


@dataclasses.dataclass(frozen=True)
class MethodResult:
    """
    What one method made of a recording.

    Attributes:
        name: of the method.
        trajectory: its estimates, x = chainage.
        rejected: refused measurements, sensor -> reason -> count.
        runtime_s: seconds spent.
        health: (stamp [s], sensor, new state) of every change, oldest first.
        notes: what a reader should know.
    """

    name: str
    trajectory: Trajectory
    rejected: dict[str, dict[str, int]]
    runtime_s: float
    health: list[tuple[float, str, str]]
    notes: tuple[str, ...] = ()


def run_methods(
    measurements: Sequence[Measurement],
    config: MaglevConfig,
    balises: BaliseTable,
    line_length_m: float = 0.0,
    methods: Sequence[str] = METHODS,
    begin: Callable[[str], None] | None = None,
) -> Iterator[MethodResult]:
    """Yield each method's result; measurements in order of arrival, ``begin`` told its name."""
    for name in methods:
        if begin is not None:
            begin(name)
        pipeline = MaglevPipeline(dataclasses.replace(config, method=name), balises, line_length_m)
        started = time.perf_counter()
        with garbage.paused():
            estimates = [e for measurement in measurements for e in pipeline.push(measurement)]
        seconds = time.perf_counter() - started
        notes = () if estimates else ('no estimate at all: it never found a start',)
        yield MethodResult(
            name,
            trajectory_of(estimates),
            pipeline.rejected,
            seconds,
            pipeline.health_changes(),
            notes,
        )


def trajectory_of(estimates: Sequence[Estimate]) -> Trajectory:
    """Return estimates as a trajectory along x; of two at one stamp the later one counts."""
    last = {estimate.time_s: estimate for estimate in estimates}
    kept = [last[time_s] for time_s in sorted(last)]
    mean = np.array([e.mean for e in kept], dtype=np.float64).reshape(-1, 3)
    P = np.array([e.covariance for e in kept], dtype=np.float64).reshape(-1, 3, 3)
    nothing = np.zeros(len(kept))
    covariance = np.zeros((len(kept), 3, 3))
    covariance[:, 0, 0] = P[:, 0, 0]
    return Trajectory(
        time_s=np.array([e.time_s for e in kept], dtype=np.float64),
        position=np.stack([mean[:, 0], nothing, nothing], axis=1),
        velocity=np.stack([mean[:, 1], nothing, nothing], axis=1),
        chainage=mean[:, 0],
        speed=mean[:, 1],
        covariance=covariance,
        sigma_along=np.sqrt(P[:, 0, 0]),
        sigma_speed=np.sqrt(P[:, 1, 1]),
    )

"""The offset between the clock of the markers and that of the recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.interpolation import at_times

Array = NDArray[np.float64]


def fit_clock_offset(
    estimate: Trajectory, time_s: Array, design: Array, reach_s: float = 3.0
) -> tuple[float, Array]:
    """
    Find the offset [s] to add to the markers' times that brings the estimate closest to them.

    The loss is the mean distance, which a few wrong markers do not move; it is searched on grids
    from 0.1 s down to 1 ms within ``reach_s``. At a train's speed 10 ms are decimetres, so this is
    told beside the errors, never applied to them.

    Returns:
        The offset, and the distances (K,) [m] that remain with it. NaN where the estimate covers
        fewer than three markers.
    """
    centre, offset = 0.0, float('nan')
    for step, half_width in ((0.1, reach_s), (0.01, 0.1), (0.001, 0.01)):
        count = round(half_width / step)
        offsets = centre + step * np.arange(-count, count + 1)
        losses = [_loss(estimate, time_s + o, design) for o in offsets]
        if not np.isfinite(losses).any():
            return float('nan'), np.full(len(time_s), np.nan)
        offset = centre = float(offsets[int(np.nanargmin(losses))])
    return offset, np.linalg.norm(at_times(estimate, time_s + offset).position - design, axis=1)


def _loss(estimate: Trajectory, time_s: Array, design: Array) -> float:
    distance = np.linalg.norm(at_times(estimate, time_s).position - design, axis=1)
    known = np.isfinite(distance)
    if known.sum() < max(3, len(distance) // 2):
        return float('nan')
    return float(distance[known].mean())

"""What a live system is given at its start: the line's files, and a run to practise with."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from maglev_localization.measurements import BalisePassing, LoopPosition, Measurement, RadarSpeed
from maglev_localization.placing import read_line
from track_localization.track.balise_table import BaliseTable, read_balises

__all__ = ['read_balises', 'read_line', 'warm_up_measurements']

SPEED_MPS, PITCH_M, STOOD_S = 20.0, 0.2, 4.0
"""Of the run that is practised."""


def warm_up_measurements(balises: BaliseTable) -> Iterator[Measurement]:
    """
    Yield half a minute of a run past the first balise: what makes every part of a core compile.

    Departure, travel, a late message, a counter that jumps and one that stands still, a radar that
    slips and one that is silent, balises known, unknown and mistaken, and a stop.
    """
    rng = np.random.default_rng(0)
    s, start_s = float(balises.chainage[0]) - 100.0, 100.0
    count, jump = 0.0, 0.0
    for k in range(3000):
        time_s = start_s + 0.01 * k
        speed = SPEED_MPS * min(max(0.2 * (0.01 * k - STOOD_S), 0.0), 1.0) * (k < 2500)
        s += 0.01 * speed
        jump = 40.0 if k >= 1400 else jump
        count = np.floor((s + jump) / PITCH_M) * PITCH_M
        if k % 2 == 0 and not 1800 <= k < 1900:
            late = 0.3 if k % 200 == 0 else 0.0
            yield LoopPosition(time_s - late, float(count - late * speed), 0.01)
        if k % 5 == 0 and not 2000 <= k < 2300:
            slip = 1.05 if 1500 <= k < 1600 else 1.0
            yield RadarSpeed(time_s, float(slip * speed + rng.normal(0.0, 0.05)), 0.01)
        if k % 300 == 299:
            name = ('none', balises.id[-1], balises.id[0])[k // 300 % 3]
            yield BalisePassing(time_s, name, float(s - balises.chainage[0]), 1e-4)

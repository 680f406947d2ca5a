"""What the maglev's node is given at its start: files, frames, and a run to practise with."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import (
    BalisePassing,
    LoopPosition,
    Measurement,
    RadarSpeed,
)
from maglev_localization.placing import PlacingConfig, read_line
from track_localization.ros.params import FrameConfig, read_file
from track_localization.settings import setting
from track_localization.track.balise_table import BaliseTable, read_balises
from track_localization.track.centreline import Centreline

SPEED_MPS, PITCH_M = 20.0, 0.2
"""Of the run that is practised."""


@dataclasses.dataclass(frozen=True)
class FileConfig:
    """The files that describe the line."""

    balises: str = setting('', '', 'path of balises.csv, the surveyed table; needed')
    track: str = setting('', '', 'path of track.csv; without it map x is the chainage')


@dataclasses.dataclass(frozen=True)
class NodeConfig(MaglevConfig, FileConfig, FrameConfig):
    """Every parameter of the maglev's node."""

    placing: PlacingConfig = dataclasses.field(default_factory=PlacingConfig)
    predict_to_now: bool = setting(
        False, '', "publish odometry_now too: carried on to the node's clock"
    )
    predict_at_most_s: float = setting(2.0, 's', 'no further than this', 0.0, 60.0)


PARAMETERS = (
    *('balises', 'track', 'frame_map', 'frame_base', 'publish_tf', 'placing.', 'predict_'),
    *(field.name for field in dataclasses.fields(MaglevConfig)),
)
"""Beginnings of the names that the node declares: no IMU, no frame of one."""


def read_files(config: NodeConfig) -> tuple[BaliseTable, Centreline | None]:
    """Read the balise table, and the line where one is named; raise DataError with what to do."""
    what = 'balise ids mean nothing without their chainages; `simulate maglev` writes such a table'
    balises = read_file(config.balises, 'balises', read_balises, what)
    if not config.track:
        return balises, None
    return balises, read_file(config.track, 'track', lambda path: read_line(path, balises), '')


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
        speed = SPEED_MPS * min(max(0.2 * (0.01 * k - 1.0), 0.0), 1.0) * (k < 2500)
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


def practised(config: NodeConfig) -> Iterator[NodeConfig]:
    """Yield the settings to practise with: as given, and with the other kind of start."""
    yield config
    motion = dataclasses.replace(config.motion, start_known=not config.motion.start_known)
    yield dataclasses.replace(config, motion=motion)

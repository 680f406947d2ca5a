"""What the maglev's node is given at its start: files, frames, and settings to practise with."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

from maglev_localization.config import MaglevConfig
from maglev_localization.inputs import read_balises, read_line
from maglev_localization.placing import PlacingConfig
from track_localization.ros.params import FrameConfig, read_file
from track_localization.settings import setting


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


def read_files(config: NodeConfig) -> tuple[Any, Any]:
    """Read the balise table, and the line where one is named; raise DataError with what to do."""
    what = 'balise ids mean nothing without their chainages; `simulate maglev` writes such a table'
    balises = read_file(config.balises, 'balises', read_balises, what)
    if not config.track:
        return balises, None
    return balises, read_file(config.track, 'track', lambda path: read_line(path, balises), '')


def practised(config: NodeConfig) -> Iterator[NodeConfig]:
    """Yield the settings to practise with: as given, and with the other kind of start."""
    yield config
    motion = dataclasses.replace(config.motion, start_known=not config.motion.start_known)
    yield dataclasses.replace(config, motion=motion)

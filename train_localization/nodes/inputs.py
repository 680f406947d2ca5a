"""What the train's node is given at its start: the line, the origin of map, frames."""

from __future__ import annotations

import dataclasses
from typing import Any

from track_localization.errors import DataError
from track_localization.ros.params import FrameConfig, read_file
from track_localization.settings import setting
from train_localization.config import TrainConfig
from train_localization.inputs import datum_of, read_datum, read_line

FIRST_FIX = (0.0, 0.0, 0.0)
"""Of ``datum.place``: none is given."""


@dataclasses.dataclass(frozen=True)
class DatumConfig:
    """Where ``frame_map`` has its origin; neither given: at the first fix."""

    place: tuple[float, float, float] = setting(
        FIRST_FIX, '', 'latitude [deg], longitude [deg], height [m]; all 0: none', -360.0, 2e4
    )
    file: str = setting('', '', 'path of datum.yaml: latitude_deg, longitude_deg, height_m')


@dataclasses.dataclass(frozen=True)
class NodeConfig(TrainConfig, FrameConfig):
    """Every parameter of the train's node."""

    track: str = setting('', '', 'path of track.csv, the line in frame_map; needs a datum')
    datum: DatumConfig = DatumConfig()
    frame_gnss: str = setting('gnss', '', 'frame that fixes must name')
    turn_sigma_radps: float = setting(0.005, 'rad/s', 'of the angular rate told', 1e-6, 10.0)


PARAMETERS = (
    *('track', 'datum.', 'frame_', 'publish_tf', 'turn_sigma_'),
    *(field.name for field in dataclasses.fields(TrainConfig)),
)
"""Beginnings of the names that the node declares."""


def read_files(config: NodeConfig) -> tuple[Any, Any]:
    """Return the line and the datum, None where not given; raise DataError with what to do."""
    datum = _read_datum(config.datum)
    if not config.track:
        if config.method == 'robust_map':
            raise DataError(
                'parameter method: robust_map needs the line (-p track:=PATH); or take robust'
            )
        return None, datum
    if datum is None:
        raise DataError(
            'parameter track: a line means nothing without the origin of its map; give '
            '-p datum.file:=PATH or -p datum.place:=[LATITUDE, LONGITUDE, HEIGHT]'
        )
    return read_file(config.track, 'track', read_line, ''), datum


def _read_datum(given: DatumConfig) -> Any:
    if given.place != FIRST_FIX:
        if given.file:
            raise DataError('parameter datum.file: datum.place is given too; leave one out')
        return datum_of(*given.place, 'parameter datum.place')
    return read_file(given.file, 'datum.file', read_datum, '') if given.file else None

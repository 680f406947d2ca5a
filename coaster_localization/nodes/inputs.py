"""What the coaster's nodes have in common: files, mount, frames, and how they are declared."""

from __future__ import annotations

import dataclasses
from typing import Any

from rclpy.node import Node

from coaster_localization.config import CoasterConfig
from coaster_localization.inputs import check_track, read_design_ride
from track_localization.ros.params import FrameConfig, declare_config, read_file, warn_unknown
from track_localization.settings import setting

NODE_OPTIONS = {'automatically_declare_parameters_from_overrides': True}
"""Lets ``warn_unknown`` see parameters that were given and that nobody declares."""


@dataclasses.dataclass(frozen=True)
class FileConfig:
    """The files that describe the coaster."""

    design_ride: str = setting('', '', 'path of design_ride.csv, the simulated ride at the seat')
    track: str = setting('', '', 'path of track.csv; checked against design_ride')


@dataclasses.dataclass(frozen=True)
class NodeConfig(CoasterConfig, FileConfig, FrameConfig):
    """Every parameter of the coaster's estimator nodes: one parameter file serves them all."""


def declare(node: Node, only: tuple[str, ...]) -> NodeConfig:
    """Declare the parameters whose names begin so; return all settings, validated."""
    config = declare_config(node, NodeConfig(), only)
    warn_unknown(node, NodeConfig())
    return config


def design_ride(config: NodeConfig) -> Any:
    """
    Read the design ride, and hold the track file, where one is named, against it.

    Raise DataError, with what to do, when either cannot be used.
    """
    what = 'the matcher and the filter need the simulated ride; `simulate coaster` writes one'
    ride = read_file(config.design_ride, 'design_ride', read_design_ride, what)
    if config.track:
        read_file(config.track, 'track', lambda path: check_track(path, ride), '')
    return ride

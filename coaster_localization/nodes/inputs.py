"""What the coaster's nodes have in common: files, mount, frames, and how they are declared."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from coaster_localization.config import CoasterConfig
from track_localization.estimation import so3
from track_localization.ros.params import FrameConfig, declare_config, read_file, warn_unknown
from track_localization.settings import setting
from track_localization.track.design_ride import DesignRide, read_design_ride

NODE_OPTIONS = {'automatically_declare_parameters_from_overrides': True}
"""Lets ``warn_unknown`` see parameters that were given and that nobody declares."""


@dataclasses.dataclass(frozen=True)
class FileConfig:
    """The files that describe the coaster."""

    design_ride: str = setting('', '', 'path of design_ride.csv, the simulated ride at the seat')
    track: str = setting('', '', 'path of track.csv; gives the chainage where it is named')


@dataclasses.dataclass(frozen=True)
class NodeConfig(CoasterConfig, FileConfig, FrameConfig):
    """Every parameter of the coaster's estimator nodes: one parameter file serves them all."""


def declare(node: Node, only: tuple[str, ...]) -> NodeConfig:
    """Declare the parameters whose names begin so; return all settings, validated."""
    config = declare_config(node, NodeConfig(), only)
    warn_unknown(node, NodeConfig())
    return config


def design_ride(config: NodeConfig) -> DesignRide:
    """Read the design ride; raise DataError, with what to do, when it cannot be had."""
    what = 'the matcher and the filter need the simulated ride; `simulate coaster` writes one'
    return read_file(config.design_ride, 'design_ride', read_design_ride, what)


def mount_matrix(config: NodeConfig) -> NDArray[np.float64] | None:
    """Return R_bm (3, 3), which turns the sensor's axes into the body's; None when they agree."""
    if not any(config.mount_rpy_deg):
        return None
    return so3.matrix_from_rpy(*map(math.radians, config.mount_rpy_deg))

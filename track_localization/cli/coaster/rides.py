"""What ``compare`` and ``learn_line`` share: several recordings, each smoothed on one line."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from coaster_localization.config import CoasterConfig
from coaster_localization.methods import apply_mount
from coaster_localization.ride_passes import SmoothedRide
from coaster_localization.track_map import line_map
from coaster_localization.track_rides import filter_ride
from track_localization.cli.coaster import inputs as coaster_inputs
from track_localization.cli.coaster.usable import usable
from track_localization.cli.common import say
from track_localization.cli.files import beside
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.track.design_ride import DesignRide, read_design_ride
from track_localization.track.learned_line import LearnedLine, read_learned_line
from track_localization.track.line_map import LineMap

FAR_M = 5.0
"""A smoothed place less certain than this is not one [m]."""


@dataclasses.dataclass(frozen=True)
class Setup:
    """What all rides of a track share: design ride, settings, and the line made of them."""

    design: DesignRide
    config: CoasterConfig
    line: LineMap


def add_arguments(parser: argparse.ArgumentParser, learned: bool) -> None:
    """Declare the arguments that ``read_setup`` and ``read_ride`` read."""
    parser.add_argument(
        '--design-ride', type=Path, help='design_ride.csv; else that beside the first ride'
    )
    parser.add_argument('--config', type=Path, help='parameter file of the nodes (YAML)')
    if learned:
        parser.add_argument('--learned', type=Path, help='learned_line.csv of learn_line')
    parser.add_argument(
        '--topic', default=coaster_inputs.IMU_TOPIC, help='of the Imu messages (%(default)s)'
    )
    parser.add_argument('--platform', choices=('auto', 'ios', 'android'), default='auto')
    parser.add_argument('--units', choices=('auto', 'si', 'g', 'deg', 'g_deg'), default='auto')


def read_setup(args: argparse.Namespace, first: Path) -> Setup:
    """Read what the rides share; ``first`` is the ride beside which files are looked for."""
    config, named = CoasterConfig(), dict[str, Path]()
    if args.config is not None:
        config, named = coaster_inputs.read_config(args.config)
    path = args.design_ride or named.get('design_ride')
    path = path or beside(first, 'design_ride.csv')
    if path is None:
        raise DataError(f'{first}: no design_ride.csv beside it; name one with --design-ride')
    design = read_design_ride(path)
    learned: LearnedLine | None = None
    if getattr(args, 'learned', None) is not None:
        learned = read_learned_line(args.learned)
    return Setup(design, config, line_map(design, config.track_filter, learned))


def read_ride(args: argparse.Namespace, path: Path, setup: Setup) -> tuple[SmoothedRide, ImuSeries]:
    """Read a recording and smooth it; errors name the recording."""
    recording = coaster_inputs.read_with_options(path, args.topic, args)
    for finding in recording.findings:
        say(f'{path}: {finding}')
    imu = apply_mount(recording.imu, setup.config.mount_rpy_deg)
    start_m = float(setup.design.chainage[0])
    try:
        usable(['track_filter_smoothed'], recording)
        filtered = filter_ride(imu, setup.line, start_m, setup.config.track_filter)
    except DataError as error:
        raise DataError(f'{path}: {error}') from None
    ride = SmoothedRide.of(filtered)
    worst = float(ride.P[:, 0, 0].max()) ** 0.5
    if worst > FAR_M:
        say(f'{path}: the place is uncertain by up to {worst:.0f} m; its intervals are as wide')
    return ride, imu

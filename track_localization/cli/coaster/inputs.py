"""What ``evaluate coaster`` and ``locate`` are given: the recording and the files beside it."""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
from pathlib import Path

from coaster_localization.config import CoasterConfig
from coaster_localization.inputs import check_track
from track_localization.cli.common import remapping
from track_localization.cli.files import beside
from track_localization.cli.parameters import read_parameters
from track_localization.errors import DataError
from track_localization.io import bags
from track_localization.io.recording import Recording, read_recording
from track_localization.io.tables import Markers, read_markers
from track_localization.track.design_ride import DesignRide, read_design_ride
from track_localization.track.learned_line import LearnedLine, read_learned_line

NODES = ('srdtw_matcher', 'coaster_eskf', 'coaster_track_filter')
"""Sections of a parameter file that hold estimator settings; those of other nodes are skipped."""

IMU_TOPIC, TRUTH_TOPIC = 'imu/data_raw', 'ground_truth/odometry'


@dataclasses.dataclass(frozen=True)
class Inputs:
    """
    A ride to evaluate.

    Attributes:
        recording: the IMU, what is odd about it, and the truth if there is one.
        design: the design ride.
        config: every setting.
        markers: timed places, if there are any.
        files: what was read, by role.
        learned: what earlier rides taught of the line, if it was named.
        clock_event: when by the ground's clock [s] the train passed which chainage [m], if told.
    """

    recording: Recording
    design: DesignRide
    config: CoasterConfig
    markers: Markers | None
    files: dict[str, Path]
    learned: LearnedLine | None = None
    clock_event: tuple[float, float] | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that ``read_inputs`` reads."""
    parser.add_argument('bag', type=Path, help='bag folder, .mcap, .db3, or Sensor Logger export')
    parser.add_argument('--track', type=Path, help='track.csv, checked against the design ride')
    parser.add_argument('--design-ride', type=Path, help='design_ride.csv')
    parser.add_argument('--markers', type=Path, help='markers.csv')
    parser.add_argument(
        '--learned', type=Path, help='learned_line.csv of learn_line, for the track filter'
    )
    parser.add_argument(
        '--clock-event',
        type=_clock_event,
        metavar='TIME_S,CHAINAGE_M',
        help="the train passed this chainage at this time of the ground's clock: gives the offset "
        "between that clock and the recording's (--clock-event=-3,120 for a negative time)",
    )
    parser.add_argument('--config', type=Path, help='parameter file of the nodes (YAML)')
    parser.add_argument(
        '--remap',
        action='append',
        default=[],
        type=remapping,
        metavar='FROM:=TO',
        help=f'read TO from the bag where {IMU_TOPIC} or {TRUTH_TOPIC} is meant',
    )
    parser.add_argument('--truth-topic', help=f'topic of the ground truth ({TRUTH_TOPIC})')
    parser.add_argument('--platform', choices=('auto', 'ios', 'android'), default='auto')
    parser.add_argument('--units', choices=('auto', 'si', 'g', 'deg', 'g_deg'), default='auto')


def read_inputs(args: argparse.Namespace) -> Inputs:
    """
    Read the recording and its files; those not named are looked for beside the bag.

    Raise DataError, naming the file and the remedy, for what is missing or unusable.
    """
    config, named = (CoasterConfig(), {}) if args.config is None else read_config(args.config)
    files = {'bag': args.bag}
    for role, given in (
        ('track', args.track or named.get('track')),
        ('design_ride', args.design_ride or named.get('design_ride')),
        ('markers', args.markers),
    ):
        path = given or beside(args.bag, f'{role}.csv')
        if path is not None:
            files[role] = path
    recording = _read_recording(args)
    if 'design_ride' not in files:
        raise DataError(
            f'{args.bag}: no design_ride.csv beside it; name one with --design-ride. '
            '`simulate coaster --track track.csv --ride ride.yaml` makes one for a track that was '
            'exported without timing'
        )
    design = read_design_ride(files['design_ride'])
    if 'track' in files:
        check_track(str(files['track']), design)
    markers = read_markers(files['markers']) if 'markers' in files else None
    learned = None
    if args.learned is not None:
        files['learned'] = args.learned
        learned = read_learned_line(args.learned)
    return Inputs(recording, design, config, markers, files, learned, args.clock_event)


def read_config(path: Path) -> tuple[CoasterConfig, dict[str, Path]]:
    """Read a ROS parameter file: settings of the coaster's nodes, and the files it names."""
    return read_parameters(path, CoasterConfig(), NODES, ('track', 'design_ride'))


def read_with_options(
    path: Path, topic: str, args: argparse.Namespace, truth_topic: str = TRUTH_TOPIC
) -> Recording:
    """Read a recording; what is wrong with it is told with the command line's options."""
    try:
        recording = read_recording(path, topic, args.platform, args.units, truth_topic)
    except DataError as error:
        raise DataError(as_options(str(error))) from None
    findings = [f._replace(remedy=as_options(f.remedy)) for f in recording.findings]
    return dataclasses.replace(recording, findings=findings)


def as_options(text: str) -> str:
    """Return a text that says how to set parameters with the options that set them."""
    return re.sub(r'\b([Ss]et) (platform|units) to\b', r'\1 --\2 to', text)


def _read_recording(args: argparse.Namespace) -> Recording:
    remap = {name.strip('/'): topic for name, topic in args.remap}
    strange = set(remap) - {IMU_TOPIC, TRUTH_TOPIC}
    if strange:
        raise DataError(
            f'--remap {min(strange)}: the coaster reads {IMU_TOPIC} and {TRUTH_TOPIC} only'
        )
    wanted = args.truth_topic or remap.get(TRUTH_TOPIC)
    topic = remap.get(IMU_TOPIC, IMU_TOPIC)
    recording = read_with_options(args.bag, topic, args, wanted or TRUTH_TOPIC)
    if wanted and recording.truth is None:
        topics = ', '.join(bags.list_topics(args.bag)) if recording.kind == 'bag' else 'none'
        raise DataError(f'{args.bag}: no odometry on {wanted}; topics here: {topics}')
    return recording


def _clock_event(text: str) -> tuple[float, float]:
    try:
        time_s, chainage_m = (float(part) for part in text.split(','))
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not TIME_S,CHAINAGE_M') from None
    if not (math.isfinite(time_s) and math.isfinite(chainage_m)):
        raise argparse.ArgumentTypeError(f'{text!r}: both must be finite')
    return time_s, chainage_m

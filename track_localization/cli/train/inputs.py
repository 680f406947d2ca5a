"""What ``evaluate train`` is given: a bag's sensors and truth, and the files beside it."""

from __future__ import annotations

import argparse
import dataclasses
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.cli.common import remapping
from track_localization.cli.files import beside
from track_localization.cli.parameters import read_parameters
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSample
from track_localization.estimation.trajectory import Trajectory
from track_localization.geodesy import Datum, enu_from_geodetic
from track_localization.io import bags
from track_localization.io.gnss import GNSS, IMU, QUALITY, TOPICS, WHEEL, Recorded, read_recorded
from track_localization.io.start_pose import read_start
from track_localization.settings import override
from track_localization.track.centreline import Centreline
from train_localization.config import TrainConfig
from train_localization.inputs import read_datum, read_line
from train_localization.measurements import GnssFix, GnssQuality, Measurement, WheelSpeed
from train_localization.methods import GivenStart

Array = NDArray[np.float64]

NODES = ('train_kf',)
"""Sections of a parameter file that hold estimator settings; those of other nodes are skipped."""

FILES, OF_NODE_ONLY = ('track', 'datum.file'), ('datum.', 'frame_', 'turn_sigma_')
"""Parameters that name files, and beginnings of those that say what the node alone must know."""

TRUTH_TOPIC, START_TOPIC = 'ground_truth/odometry', 'initialpose'
OUTAGE_S = 5.0
"""So long without a usable fix is an outage [s]."""
OFF_TRACK_M = 20.0
"""A truth further from the track than this is told: another track, or another origin [m]."""

UNREAD = {
    'unreadable': 'The bag is damaged: at least {count} of its messages unreadable.',
    'undecodable': 'The bag is damaged: {count} of its messages undecodable.',
    'no_header_stamp': 'No {name} message has a header stamp: times of arrival are taken instead.',
}
"""Sentences about what could not be read as it should have been, by reason."""


@dataclasses.dataclass(frozen=True)
class Inputs:
    """
    A run to evaluate.

    Attributes:
        recorded: what the sensors told, as recorded.
        measurements: the same as the estimators take it, in order of arrival.
        rejected: what did not become a measurement, sensor -> reason -> count.
        config: every setting.
        track: the surveyed line in ``map``, if there is one.
        datum: origin of ``map``; None: the first fix.
        start: a pose that the methods are told, if the bag has one.
        truth: where the train was, if it is known.
        fixes: usable fixes: their stamps (K,) [s] and places (K, 3) in ``map`` [m].
        outages: (from, to) of each spell without them [s].
        files: what was read, by role.
        findings: what the user should know of all this.
    """

    recorded: Recorded
    measurements: list[Measurement]
    rejected: dict[str, dict[str, int]]
    config: TrainConfig
    track: Centreline | None
    datum: Datum | None
    start: GivenStart | None
    truth: Trajectory | None
    fixes: tuple[Array, Array]
    outages: list[tuple[float, float]]
    files: dict[str, Path]
    findings: list[str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that ``read_inputs`` reads, ``--set`` apart."""
    parser.add_argument('bag', type=Path, help='bag folder, .mcap or .db3')
    parser.add_argument('--track', type=Path, help='track.csv: the surveyed line in map')
    parser.add_argument(
        '--datum', type=Path, help='datum.yaml: latitude_deg, longitude_deg, height_m of map'
    )
    parser.add_argument('--config', type=Path, help='parameter file of the node (YAML)')
    parser.add_argument(
        '--remap',
        action='append',
        default=[],
        type=remapping,
        metavar='FROM:=TO',
        help=f'read TO from the bag where FROM is meant: {", ".join(_known_topics())}',
    )
    parser.add_argument('--truth-topic', help=f'topic of the ground truth ({TRUTH_TOPIC})')


def read_inputs(args: argparse.Namespace) -> Inputs:
    """
    Read the bag and its files; those not named are looked for beside the bag.

    Raise DataError, naming the file or topic and the remedy, for what is missing or unusable.
    """
    config, named = TrainConfig(), dict[str, Path]()
    if args.config is not None:
        config, named = read_parameters(args.config, config, NODES, FILES, OF_NODE_ONLY)
    config = override(config, dict(args.set))
    remap = _remapped(args)
    sensors = {sensor: topic for sensor, (topic, _) in TOPICS.items()}
    recorded = read_recorded(
        args.bag, {sensor: remap[topic] for sensor, topic in sensors.items() if topic in remap}
    )
    measurements, rejected = to_measurements(recorded)
    files = {'bag': args.bag}
    for role, name, given in (
        ('track', 'track.csv', args.track or named.get('track')),
        ('datum', 'datum.yaml', args.datum or named.get('datum.file')),
    ):
        path = given or beside(args.bag, name)
        if path is not None:
            files[role] = path
    datum = read_datum(str(files['datum'])) if 'datum' in files else None
    track = read_line(str(files['track'])) if 'track' in files else None
    truth, said = _truth(args, remap.get(TRUTH_TOPIC), track)
    pose = read_start(args.bag, remap.get(START_TOPIC, START_TOPIC))
    start = None if pose is None or datum is None else GivenStart(*pose)
    fixes, outages = usable_fixes(recorded, config, datum)
    findings = [*_lacking(recorded, rejected), *_files_lacking(files), *said]
    if pose is not None and datum is None:
        findings.append('The start that the bag tells is not used: no datum says where map is.')
    return Inputs(
        recorded, measurements, rejected, config, track, datum, start, truth, fixes, outages,
        files, findings,
    )  # fmt: skip


def to_measurements(recorded: Recorded) -> tuple[list[Measurement], dict[str, dict[str, int]]]:
    """
    Return what was recorded as the core takes it, and counts of what it cannot take.

    A stamp before 1970 is none (``bad_stamp``); a quality that does not tell the satellites in use
    is left out (``no_satellites``), and its fix is judged by its covariance alone.
    """
    measurements: list[Measurement] = []
    rejected: dict[str, Counter[str]] = {}
    imu, fix, quality, wheel = recorded.imu, recorded.fixes, recorded.qualities, recorded.speeds
    for sensor, i in recorded.arrivals():
        one: Measurement
        if sensor == IMU:
            one = ImuSample(float(imu.time_s[i]), imu.specific_force[i], imu.angular_rate[i])
        elif sensor == WHEEL:
            one = WheelSpeed(
                float(wheel.time_s[i]), float(wheel.speed[i]), float(wheel.variance[i])
            )
        elif sensor == GNSS:
            place = float(fix.latitude[i]), float(fix.longitude[i]), float(fix.height[i])
            one = GnssFix(float(fix.time_s[i]), *place, fix.covariance[i], bool(fix.valid[i]))
        else:
            one = GnssQuality(
                float(quality.time_s[i]), int(quality.satellites[i]), float(quality.hdop[i])
            )
        if one.time_s < 0.0:
            rejected.setdefault(sensor, Counter())['bad_stamp'] += 1
        elif isinstance(one, GnssQuality) and one.satellites < 0:
            rejected.setdefault(sensor, Counter())['no_satellites'] += 1
        else:
            measurements.append(one)
    return measurements, {sensor: dict(counts) for sensor, counts in rejected.items()}


def usable_fixes(
    recorded: Recorded, config: TrainConfig, datum: Datum | None
) -> tuple[tuple[Array, Array], list[tuple[float, float]]]:
    """
    Return the stamps and places of usable fixes, and the spells without any.

    Where a fix's quality is told it needs three satellites and an HDOP within the limit.
    """
    fix, quality = recorded.fixes, recorded.qualities
    good = fix.valid & np.isfinite(fix.latitude + fix.longitude + fix.height)
    poor = quality.hdop > config.gnss.hdop_limit
    poor |= (quality.satellites >= 0) & (quality.satellites < 3)
    good &= ~np.isin(np.round(fix.time_s, 3), np.round(quality.time_s[poor], 3))
    order = np.flatnonzero(good)
    order = order[np.argsort(fix.time_s[order], kind='stable')]
    stamps = fix.time_s[order]
    place = fix.latitude[order], fix.longitude[order], fix.height[order]
    if len(order):
        origin = datum or Datum(*(float(x[0]) for x in place))
        position = enu_from_geodetic(*place, origin)
    else:
        position = np.empty((0, 3))
    gaps = np.flatnonzero(np.diff(stamps) > OUTAGE_S)
    outages = [(float(stamps[k]), float(stamps[k + 1])) for k in gaps]
    return (stamps, position), outages


def _known_topics() -> tuple[str, ...]:
    return (*(topic for topic, _ in TOPICS.values()), START_TOPIC, TRUTH_TOPIC)


def _remapped(args: argparse.Namespace) -> dict[str, str]:
    remap = {name.strip('/'): topic for name, topic in args.remap}
    strange = set(remap) - set(_known_topics())
    if strange:
        raise DataError(
            f'--remap {min(strange)}: the train reads {", ".join(sorted(_known_topics()))} only'
        )
    return remap


def _truth(
    args: argparse.Namespace, remapped: str | None, track: Centreline | None
) -> tuple[Trajectory | None, list[str]]:
    """Return the truth, with its chainage where there is a track, and what to say about it."""
    wanted = args.truth_topic or remapped
    truth = bags.read_odometry(args.bag, wanted or TRUTH_TOPIC)
    if truth is None and wanted:
        topics = ', '.join(bags.list_topics(args.bag))
        raise DataError(f'{args.bag}: no odometry on {wanted}; topics here: {topics}')
    if truth is None:
        return None, ['No ground truth in the bag: errors are left out.']
    if track is None:
        return truth, []
    s = track.nearest(truth.position)
    away = float(np.linalg.norm(track.position(s) - truth.position, axis=1).max())
    found = dataclasses.replace(truth, chainage=s)
    if away <= OFF_TRACK_M:
        return found, []
    return found, [
        f'The ground truth is up to {away:.0f} m off the track.csv: is it that of another line, or '
        'of another datum?'
    ]


def _lacking(recorded: Recorded, rejected: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return sentences about sensors and messages that are missing."""
    without = {
        GNSS: 'only a start that is told could be gone on from',
        QUALITY: 'fixes are judged by themselves',
        WHEEL: 'no dead reckoning, slip cannot be told, the train is never known to stand',
    }
    said = []
    for sensor, consequence in without.items():
        topic = TOPICS[sensor][0]
        count, refused = recorded.count(sensor), sum(rejected.get(sensor, {}).values())
        if sensor not in recorded.topics:
            said.append(f'No {topic} in the bag: {consequence}.')
        elif not count:
            said.append(f'{topic} is empty: {consequence}.')
        elif refused == count:
            reasons = ', '.join(rejected[sensor])
            said.append(f'Every message on {topic} is refused ({reasons}): {consequence}.')
    if len(recorded.fixes.time_s) and not recorded.fixes.valid.any():
        said.append(f'No message on {TOPICS[GNSS][0]} has a fix.')
    if not recorded.imu.has_gyro:
        said.append('The IMU tells no angular rate: nothing can be estimated without.')
    return said + [
        UNREAD.get(reason, '{name}: {count} messages: {reason}').format(
            name=name, count=count, reason=reason
        )
        for name, counts in recorded.rejected.items()
        for reason, count in counts.items()
    ]


def _files_lacking(files: Mapping[str, Path]) -> list[str]:
    said = []
    if 'track' not in files:
        said.append('No track.csv beside the bag: robust_map is left out (--track FILE).')
    if 'datum' not in files:
        said.append(
            'No datum.yaml beside the bag: map has its origin at the first fix (--datum FILE); '
            'errors hold what lies between it and the origin of a truth.'
        )
    return said

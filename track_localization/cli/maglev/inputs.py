"""What ``evaluate maglev`` is given: a bag's sensors and truth, and the files beside it."""

from __future__ import annotations

import argparse
import dataclasses
from collections import Counter
from pathlib import Path

import numpy as np

from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import (
    BALISE,
    LOOP,
    RADAR,
    BalisePassing,
    LoopPosition,
    Measurement,
    RadarSpeed,
)
from maglev_localization.placing import read_line
from track_localization.cli.common import remapping
from track_localization.cli.files import beside
from track_localization.cli.maglev.truth import on_line, on_x
from track_localization.cli.parameters import read_parameters
from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.io import bags, codec
from track_localization.io.sensors import Readings, ScalarTopic, read_sensors
from track_localization.settings import override
from track_localization.track.balise_table import BaliseTable, read_balises
from track_localization.track.centreline import Centreline

NODES = ('maglev_federated_pf',)
"""Sections of a parameter file that hold estimator settings; those of other nodes are skipped."""
OF_NODE_ONLY = ('placing.', 'predict_')
"""Beginnings of parameters that say how the node publishes."""

TRUTH_TOPIC = 'ground_truth/odometry'
SENSORS = (
    ScalarTopic(LOOP, 'loop/pose', codec.POSE),
    ScalarTopic(RADAR, 'radar/twist', codec.TWIST),
    ScalarTopic(BALISE, 'balise/pose', codec.POSE),
)
"""Sensors, and the topics and types that they have in a bag."""

UNREAD = {
    'unreadable': 'The bag is damaged: at least {count} of its messages unreadable.',
    'undecodable': 'The bag is damaged: {count} of its messages undecodable.',
    'no_header_stamp': 'No {name} message has a header stamp: times of arrival are taken instead.',
}
"""Sentences about what could not be read as it should have been, by reason."""

LOOP_FRAME, BALISE_FRAME = 'track', 'balise_'
"""Frame of the loop's poses; beginning of a balise's, its id follows."""

NO_BALISES = BaliseTable((), np.empty(0), np.empty(0))


@dataclasses.dataclass(frozen=True)
class Inputs:
    """
    A run to evaluate.

    Attributes:
        readings: what the sensors told, as recorded.
        measurements: the same as the estimators take it, in order of arrival.
        rejected: what did not become a measurement, sensor -> reason -> count.
        config: every setting.
        balises: where they lie; empty without a table.
        line: the track in ``map``, if there is one.
        truth: where the train was, with its chainage, if it is known.
        files: what was read, by role.
        findings: what the user should know of all this.
    """

    readings: Readings
    measurements: list[Measurement]
    rejected: dict[str, dict[str, int]]
    config: MaglevConfig
    balises: BaliseTable
    line: Centreline | None
    truth: Trajectory | None
    files: dict[str, Path]
    findings: list[str]

    @property
    def line_length_m(self) -> float:
        """Length of the line [m]; 0 where no track tells it."""
        return 0.0 if self.line is None else self.line.length

    @property
    def first_balise_s(self) -> float | None:
        """
        Stamp from which on the estimates can know a balise of the table [s]; None if none was.

        That is the newest of all messages that had arrived when the balise did: it may be late.
        """
        newest = -np.inf
        for m in self.measurements:
            if np.isfinite(m.time_s):
                newest = max(newest, m.time_s)
                if isinstance(m, BalisePassing) and self.balises.index(m.balise) is not None:
                    return float(newest)
        return None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that ``read_inputs`` reads, ``--set`` apart."""
    parser.add_argument('bag', type=Path, help='bag folder, .mcap or .db3')
    parser.add_argument('--balises', type=Path, help='balises.csv: id,chainage_m,sigma_m')
    parser.add_argument(
        '--track', type=Path, help='track.csv: places the train in map; without it x is chainage'
    )
    parser.add_argument('--config', type=Path, help='parameter file of the node (YAML)')
    known = (*(s.topic for s in SENSORS), TRUTH_TOPIC)
    parser.add_argument(
        '--remap',
        action='append',
        default=[],
        type=remapping,
        metavar='FROM:=TO',
        help=f'read TO from the bag where FROM is meant: {", ".join(known)}',
    )
    parser.add_argument('--truth-topic', help=f'topic of the ground truth ({TRUTH_TOPIC})')


def read_inputs(args: argparse.Namespace) -> Inputs:
    """
    Read the bag and its files; those not named are looked for beside the bag.

    Raise DataError, naming the file or topic and the remedy, for what is missing or unusable.
    """
    config, named = MaglevConfig(), dict[str, Path]()
    if args.config is not None:
        config, named = read_parameters(
            args.config, config, NODES, ('track', 'balises'), OF_NODE_ONLY
        )
    config = override(config, dict(args.set))
    remap = _remapped(args)
    wanted = [s._replace(topic=remap.get(s.topic, s.topic)) for s in SENSORS]
    readings = read_sensors(args.bag, wanted)
    measurements, rejected = to_measurements(readings)
    if not measurements:
        raise DataError(f'{args.bag}: no message is of use ({rejected}); see the frames it names')
    files = {'bag': args.bag}
    for role, given in (('track', args.track), ('balises', args.balises)):
        path = given or named.get(role) or beside(args.bag, f'{role}.csv')
        if path is not None:
            files[role] = path
    balises = read_balises(files['balises']) if 'balises' in files else NO_BALISES
    line = read_line(str(files['track']), balises) if 'track' in files else None
    truth, findings = _truth(args, remap.get(TRUTH_TOPIC), line)
    findings = [*_lacking(readings, rejected, balises, 'balises' in files), *findings]
    return Inputs(readings, measurements, rejected, config, balises, line, truth, files, findings)


def to_measurements(readings: Readings) -> tuple[list[Measurement], dict[str, dict[str, int]]]:
    """
    Return readings as the core takes them, and counts of those that it cannot take.

    The loop tells of ``track`` and a balise of its own frame: another frame is another quantity
    (``wrong_frame``, ``empty_frame``), as the node has it too; a stamp before 1970 is none
    (``bad_stamp``).
    """
    measurements: list[Measurement] = []
    rejected: dict[str, Counter[str]] = {}
    rows = zip(
        readings.sensor,
        readings.time_s.tolist(),
        readings.value.tolist(),
        readings.variance.tolist(),
        readings.frame,
        strict=True,
    )
    for sensor, time, value, variance, frame in rows:
        last = frame.rsplit('/', 1)[-1]
        if time < 0.0:
            rejected.setdefault(sensor, Counter())['bad_stamp'] += 1
        elif sensor == RADAR:
            measurements.append(RadarSpeed(time, value, variance))
        elif sensor == LOOP and last == LOOP_FRAME:
            measurements.append(LoopPosition(time, value, variance))
        elif sensor == BALISE and last.startswith(BALISE_FRAME) and last != BALISE_FRAME:
            name = last.removeprefix(BALISE_FRAME)
            measurements.append(BalisePassing(time, name, value, variance))
        else:
            reason = 'wrong_frame' if frame else 'empty_frame'
            rejected.setdefault(sensor, Counter())[reason] += 1
    return measurements, {sensor: dict(counts) for sensor, counts in rejected.items()}


def _remapped(args: argparse.Namespace) -> dict[str, str]:
    remap = {name.strip('/'): topic for name, topic in args.remap}
    known = {*(s.topic for s in SENSORS), TRUTH_TOPIC}
    strange = set(remap) - known
    if strange:
        raise DataError(f'--remap {min(strange)}: the maglev reads {", ".join(sorted(known))} only')
    return remap


def _truth(
    args: argparse.Namespace, remapped: str | None, line: Centreline | None
) -> tuple[Trajectory | None, list[str]]:
    """Return the truth with its chainage, if the bag has it, and what to say about it."""
    wanted = args.truth_topic or remapped
    truth = bags.read_odometry(args.bag, wanted or TRUTH_TOPIC)
    if truth is None and wanted:
        topics = ', '.join(bags.list_topics(args.bag))
        raise DataError(f'{args.bag}: no odometry on {wanted}; topics here: {topics}')
    if truth is None:
        return None, ['No ground truth in the bag: errors are left out.']
    return on_x(truth) if line is None else on_line(truth, line)


def _lacking(
    readings: Readings, rejected: dict[str, dict[str, int]], balises: BaliseTable, table: bool
) -> list[str]:
    """Return sentences about sensors, messages and files that are missing."""
    said = []
    for sensor in SENSORS:
        count = readings.count(sensor.sensor)
        refused = rejected.get(sensor.sensor, {})
        if sensor.sensor not in readings.topics:
            said.append(f'No {sensor.topic} in the bag: run without the {sensor.sensor}.')
        elif not count:
            said.append(f'{sensor.topic} is empty: run without the {sensor.sensor}.')
        elif sum(refused.values()) == count:
            said.append(
                f'Every message on {sensor.topic} is refused ({", ".join(refused)}): run without '
                f'the {sensor.sensor}; {_frame_wanted(sensor.sensor)}.'
            )
    said += [
        UNREAD.get(reason, '{name}: {count} messages: {reason}').format(
            name=name, count=count, reason=reason
        )
        for name, counts in readings.rejected.items()
        for reason, count in counts.items()
    ]
    if BALISE in readings.topics and not table:
        said.append('No balises.csv beside the bag: balises cannot be placed (--balises FILE).')
    elif BALISE in readings.topics:
        said += _unknown(readings, balises)
    return said


def _unknown(readings: Readings, balises: BaliseTable) -> list[str]:
    """Tell of a table that has none of the balises that were heard: it is that of another line."""
    heard = {
        frame.rsplit('/', 1)[-1].removeprefix(BALISE_FRAME)
        for sensor, frame in zip(readings.sensor, readings.frame, strict=True)
        if sensor == BALISE
    }
    if not heard or any(balises.index(name) is not None for name in heard):
        return []
    return [
        f'None of the {len(heard)} balises heard ({", ".join(sorted(heard)[:3])} ...) is in the '
        f'table ({", ".join(balises.id[:3])} ...): is it that of another line?'
    ]


def _frame_wanted(sensor: str) -> str:
    frames = {LOOP: LOOP_FRAME, BALISE: f'{BALISE_FRAME}<id>'}
    return f"it needs frame_id '{frames[sensor]}'" if sensor in frames else 'see its stamps'

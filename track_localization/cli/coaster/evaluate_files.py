"""What ``evaluate coaster`` leaves behind besides figures: a bag, the report's sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from coaster_localization.methods import MethodResult, observations
from track_localization.cli.coaster.inputs import Inputs
from track_localization.evaluation.report import Picture, Section
from track_localization.evaluation.tabulate import Table
from track_localization.io.bags import BagWriter


def write_bag(folder: Path, inputs: Inputs, results: Mapping[str, MethodResult]) -> None:
    """
    Write the recording and its results as an mcap bag.

    Topics: ``imu/data_raw``, ``ground_truth/odometry`` where there is one, ``<method>/odometry``
    of every method, and ``srdtw/pose``, the match that was fused.
    """
    with BagWriter(folder, overwrite=True) as bag:
        bag.write_imu('imu/data_raw', inputs.recording.imu)
        if inputs.recording.truth is not None:
            bag.write_odometry('ground_truth/odometry', inputs.recording.truth)
        for name, result in results.items():
            bag.write_odometry(f'{name}/odometry', result.trajectory)
        matched = next((n for n in ('eskf', 'eskf_smoothed', 'srdtw_z') if n in results), None)
        match = results[matched].match if matched is not None else None
        if match is not None:
            fed = observations(match, inputs.config.matcher.observation_rate_hz)
            bag.write_pose(
                'srdtw/pose',
                np.array([m.time_s for m in fed]),
                np.array([m.position for m in fed]).reshape(-1, 3),
                np.array([m.covariance for m in fed]).reshape(-1, 3, 3),
                np.array([m.quaternion for m in fed]).reshape(-1, 4),
            )


def report_sections(
    content: Mapping[str, Any],
    figures: Table,
    said: Sequence[str],
    pictures: Sequence[Picture],
    config: str,
) -> list[Section]:
    """Return the report: figures first, pictures, then what one needs to repeat them."""
    sentences = list(said)
    floor = content['floor'].get('position_m', {}).get('mean')
    if floor is not None:
        sentences.append(
            f'The design line itself is {floor:.3f} m off the track as built (mean): no method '
            'that knows the design only can be better.'
        )
    data = content['data']
    facts = dict(data['files']) | {
        'duration': f'{data["duration_s"]:.1f} s',
        'IMU samples': str(data['samples']),
        'commit': content['commit'],
        **content['machine'],
    }
    return [
        Section('Figures', sentences, tables=[figures]),
        Section('Pictures', pictures=pictures),
        Section('Run times and refusals', tables=_run_tables(content)),
        Section('Data, code and machine', facts=facts),
        Section('Settings', verbatim=config),
    ]


def _run_tables(content: Mapping[str, Any]) -> list[Table]:
    """Return what each stage took, and what was refused if anything was."""
    duration_s = content['data']['duration_s']
    stages = [
        (name, stage, seconds, f'{seconds / duration_s:.2%}')
        for name, entry in content['methods'].items()
        for stage, seconds in entry.get('stages', {}).items()
    ]
    tables = [Table('run time by stage [s]', ['method', 'stage', 'time', 'of the ride'], stages)]
    refused = [
        (name, sensor, reason, count)
        for name, entry in content['methods'].items()
        for sensor, counts in entry['rejected'].items()
        for reason, count in counts.items()
    ]
    if refused:
        tables.append(Table('refused', ['method', 'sensor', 'reason', 'count'], refused))
    return tables

"""One way to read a ride's IMU, whatever recorded it: a ROS 2 bag or a phone's export."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.io import bags, phone
from track_localization.io.checks import Finding, conversion, inspect_imu, to_si


@dataclasses.dataclass(frozen=True)
class Recording:
    """
    A ride's IMU samples and what is known about them.

    Attributes:
        imu: cleaned, in SI units, in the sensor's axes.
        findings: what the user should know, the gravest first.
        rejected: counts of what reading and cleaning dropped, by reason.
        kind: what recorded it.
        truth: ground truth, where a bag has it.
    """

    imu: ImuSeries
    findings: list[Finding]
    rejected: dict[str, int]
    kind: Literal['bag', 'phone']
    truth: Trajectory | None = None


def read_recording(
    path: str | Path,
    topic: str = 'imu/data_raw',
    platform: str = 'auto',
    units: str = 'auto',
    truth_topic: str = 'ground_truth/odometry',
) -> Recording:
    """
    Read a bag (folder, ``.mcap``, ``.db3``) or a Sensor Logger export (folder, ``.zip``).

    Args:
        path: the recording.
        topic: of the Imu messages in a bag.
        platform: of the phone: ``auto``, ``ios`` or ``android`` (see ``phone.read_phone``).
        units: ``auto``, ``si``, ``g``, ``deg`` or ``g_deg`` (see ``checks.to_si``).
        truth_topic: of the ground truth in a bag; it may be absent.

    Raises:
        DataError: neither of the two, or nothing usable in it; see ``bags`` and ``phone``.
    """
    path = Path(path)
    truth = None
    notes: list[Finding] = []
    kind: Literal['bag', 'phone'] = 'bag'
    if not path.exists():
        raise DataError(
            f'{path}: no such file or folder; give a bag folder, an .mcap, a .db3 or a Sensor '
            'Logger export (folder or .zip)'
        )
    if not bags.is_bag(path):
        if not phone.is_phone_export(path):
            raise DataError(
                f'{path}: neither a ROS 2 bag (.mcap, .db3) nor a Sensor Logger export '
                '(TotalAcceleration.csv or Accelerometer.csv, in a folder or zip)'
            )
        kind = 'phone'
        force_units = {'g_deg': 'g', 'deg': 'auto'}.get(units, units)
        imu, rejected, found = phone.read_phone(path, platform, force_units)
        if found != 'si':
            notes.append(conversion(found, asked=force_units != 'auto'))
        units = 'deg' if units in ('deg', 'g_deg') else 'si'
    else:
        imu, rejected = bags.read_imu(path, topic)
        truth = bags.read_odometry(path, truth_topic)
    imu, more = to_si(imu, units)
    return Recording(imu, inspect_imu(imu, rejected) + notes + more, rejected, kind, truth)

"""Which methods a recording's faults leave: no figures come from data that is called unusable."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from coaster_localization.methods import MATCHING
from track_localization.errors import DataError
from track_localization.io.recording import Recording

WITHOUT_GYRO = tuple(name for name, (_, channel) in MATCHING.items() if channel == 'z')
"""Methods that need no angular rate; there is none that needs no specific force."""


def usable(
    methods: Sequence[str], recording: Recording
) -> tuple[tuple[str, ...], Recording, list[str]]:
    """
    Return the methods that can be run, the recording for them, and a note on those left out.

    Rates that cannot be used are taken out of the recording. Raise DataError, with the reason,
    when no method remains.
    """
    spoilt = {finding.spoils: finding for finding in reversed(recording.findings)}
    if 'force' in spoilt:
        raise DataError(f'no method can be run: {spoilt["force"].what}. {spoilt["force"].remedy}')
    if 'rate' not in spoilt:
        return tuple(methods), recording, []
    fault = spoilt['rate']
    left = tuple(name for name in methods if name in WITHOUT_GYRO)
    if not left:
        raise DataError(f'{", ".join(methods)}: cannot be run: {fault.what}. {fault.remedy}')
    out = [name for name in methods if name not in left]
    imu = dataclasses.replace(
        recording.imu, angular_rate=np.full_like(recording.imu.angular_rate, np.nan)
    )
    notes = [f'left out, as they need the gyro: {", ".join(out)} ({fault.what})'] if out else []
    return left, dataclasses.replace(recording, imu=imu), notes

"""What a reader of an evaluation should know, in sentences."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coaster_localization.methods import TRACK_METHODS, MethodResult
from track_localization.cli.coaster.inputs import Inputs
from track_localization.cli.coaster.pictures import best
from track_localization.cli.coaster.results import CLOCK_OFFSET_WORTH_S, rpy_deg
from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.clock import ClockOffset, offset_from_event

Array = NDArray[np.float64]


def notes(
    inputs: Inputs, results: Mapping[str, MethodResult], metrics: Mapping[str, Any]
) -> list[str]:
    """Return findings about the recording, what was missing, and what the methods remarked."""
    said = [str(finding) for finding in inputs.recording.findings]
    if inputs.recording.truth is None:
        said.append('No ground truth in the recording: errors over the ride are left out.')
    if inputs.markers is None:
        said.append('No markers.csv: errors at markers are left out.')
    said += _clock(results, metrics)
    said += _event(inputs, results)
    said += _mount(results)
    remarks: dict[str, list[str]] = {}
    for name, result in results.items():
        for note in result.notes:
            remarks.setdefault(note, []).append(name)
        share = 0.0 if result.match is None else float(result.match.flagged.mean())
        if result.fed_by is None and share >= 0.005:
            remarks.setdefault(f'{share:.0%} of the match is in doubt', []).append(name)
    said += [f'{", ".join(names)}: {note}' for note, names in remarks.items()]
    return said


def clock_offset(
    trajectory: Trajectory, event: tuple[float, float], method: str
) -> tuple[ClockOffset, str]:
    """Return the offset that a clock event gives, and a sentence about it."""
    clock = offset_from_event(trajectory, *event)
    side = 'behind' if clock.offset_s > 0 else 'ahead of'
    text = dataclasses.replace(clock, offset_s=abs(clock.offset_s)).text()
    return clock, (
        f'clock event: the train passed {event[1]:g} m at {event[0] + clock.offset_s:.3f} s of the '
        f"recording's clock ({method}); the ground's clock is {text} {side} it"
    )


def mount_note(mount: tuple[Array, float]) -> str:
    """Return a sentence about how the sensor sits in the body: R_bm (3, 3), sigma [rad]."""
    angles = ', '.join(f'{angle + 0.0:.2f}' for angle in rpy_deg(mount[0]))
    return (
        f'mount found: roll, pitch, yaw {angles} deg +- {np.rad2deg(mount[1]):.2f} deg (1 sigma); '
        f'put mount_rpy_deg: [{angles}] into the parameter file'
    )


def _mount(results: Mapping[str, MethodResult]) -> list[str]:
    """Tell of the mount once: all that estimate it share one filter."""
    mount = next((r.mount for r in results.values() if r.mount is not None), None)
    return [] if mount is None else [mount_note(mount)]


def _most_accurate(results: Mapping[str, MethodResult]) -> str | None:
    found = (name for name in reversed(TRACK_METHODS) if name in results)
    return next(found, best(results))


def _event(inputs: Inputs, results: Mapping[str, MethodResult]) -> list[str]:
    """Tell what the clock event says by the best method; raise DataError where it says nothing."""
    if inputs.clock_event is None:
        return []
    name = _most_accurate(results)
    if name is None:
        raise DataError(
            'clock event: only methods that fuse can time it; add eskf or track_filter to --methods'
        )
    return [clock_offset(results[name].trajectory, inputs.clock_event, name)[1]]


def _clock(results: Mapping[str, MethodResult], metrics: Mapping[str, Any]) -> list[str]:
    """Tell the offset of the markers' clock, and what it would change where it is a clear one."""
    name = _most_accurate(results)
    entry = metrics.get(name, {}) if name is not None else {}
    offset = entry.get('markers_clock_offset_s')
    before = entry.get('markers_m', {}).get('mean')
    after = entry.get('markers_after_offset_mean_m')
    if offset is None or before is None or after is None:
        return []
    sigma = entry.get('markers_clock_offset_sigma_s', float('nan'))
    text = ClockOffset(abs(offset), sigma, np.empty(0)).text()
    side = 'behind' if offset > 0 else 'ahead of'
    said = f"markers.csv: its clock seems {text} {side} the recording's ({name})"
    if abs(offset) < CLOCK_OFFSET_WORTH_S or after > 0.7 * before:
        return [said]
    return [
        f'{said}; with that corrected the error at markers would be {after:.2f} m instead of '
        f'{before:.2f} m (the figures are not corrected).'
    ]

"""What a reader of an evaluation should know, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from coaster_localization.methods import MethodResult
from track_localization.cli.coaster_inputs import Inputs
from track_localization.cli.coaster_pictures import best
from track_localization.cli.coaster_results import CLOCK_OFFSET_WORTH_S


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
    remarks: dict[str, list[str]] = {}
    for name, result in results.items():
        for note in result.notes:
            remarks.setdefault(note, []).append(name)
        share = 0.0 if result.match is None else float(result.match.flagged.mean())
        if result.fed_by is None and share >= 0.005:
            remarks.setdefault(f'{share:.0%} of the match is in doubt', []).append(name)
    said += [f'{", ".join(names)}: {note}' for note, names in remarks.items()]
    return said


def _clock(results: Mapping[str, MethodResult], metrics: Mapping[str, Any]) -> list[str]:
    """Tell of an offset of the markers' clock when the best method sees a clear one."""
    name = best(results)
    entry = metrics.get(name, {}) if name is not None else {}
    offset = entry.get('markers_clock_offset_s')
    before = entry.get('markers_m', {}).get('mean')
    after = entry.get('markers_after_offset_mean_m')
    if offset is None or before is None or after is None:
        return []
    if abs(offset) < CLOCK_OFFSET_WORTH_S or after > 0.7 * before:
        return []
    side = 'behind' if offset > 0 else 'ahead of'
    return [
        f"markers.csv: its clock seems {abs(offset):.3f} s {side} the recording's; with that "
        f'corrected the {name} error at markers would be {after:.2f} m instead of {before:.2f} m '
        '(the figures are not corrected).'
    ]

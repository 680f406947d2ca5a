"""Figures of the train's methods: from results and truth to metrics.json and tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from track_localization.cli.train.inputs import Inputs
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.metrics import present
from track_localization.evaluation.navigation_metrics import (
    NavigationErrors,
    error_of_latest,
    navigation_errors,
    navigation_figures,
)
from track_localization.evaluation.tabulate import Cell, Table
from train_localization.methods import MAP, MethodResult

COLUMNS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ('median', ('horizontal_m', 'median')),
    ('95 %', ('horizontal_m', 'p95')),
    ('max', ('horizontal_m', 'max')),
    ('along 95 %', ('along_m', 'p95')),
    ('across 95 %', ('cross_m', 'p95')),
    ('up 95 %', ('up_m', 'p95')),
    ('speed median [m/s]', ('speed_mps', 'median')),
    ('speed 95 %', ('speed_mps', 'p95')),
)
"""Columns of the table of errors, and where metrics.json has them."""
HONESTY: tuple[tuple[str, str], ...] = (
    ('in 2 sigma', 'inside_2_sigma'),
    ('velocity in 2 sigma', 'velocity_inside_2_sigma'),
    ('NEES / 3', 'nees_position_over_3'),
    ('velocity NEES / 3', 'nees_velocity_over_3'),
)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One method's result, and how far it is off; ``errors`` None without a truth."""

    result: MethodResult
    errors: NavigationErrors | None

    @property
    def trajectory(self) -> Trajectory:
        """The method's estimates."""
        return self.result.trajectory


def outcome(result: MethodResult, inputs: Inputs) -> Outcome:
    """Hold a method's estimates against the truth."""
    errors = None
    if inputs.truth is not None and len(result.trajectory):
        errors = navigation_errors(result.trajectory, result.velocity_covariance, inputs.truth)
    return Outcome(result, errors)


def figures(outcome: Outcome, inputs: Inputs) -> dict[str, Any]:
    """Return what metrics.json says about one method; see ARCHITECTURE.md for the names."""
    out: dict[str, Any] = {}
    if outcome.errors is not None and len(outcome.errors):
        out |= navigation_figures(outcome.errors, inputs.outages)
    seconds, duration_s = outcome.result.runtime_s, inputs.recorded.duration_s
    out['estimates'] = len(outcome.trajectory)
    out['runtime_s'] = seconds
    out['real_time_factor'] = seconds / duration_s if duration_s > 0.0 else None
    out = present(out)
    out['modes'] = [[time_s, mode] for time_s, mode in outcome.result.modes]
    out['rejected'] = {name: dict(counts) for name, counts in outcome.result.rejected.items()}
    return out


def tables(metrics: Mapping[str, Mapping[str, Any]], inputs: Inputs) -> list[Table]:
    """Return errors over the run, through each outage, what sigma is worth, modes, run times."""
    found = []
    known = {name: entry for name, entry in metrics.items() if 'horizontal_m' in entry}
    if known:
        found.append(_errors(known))
        if any(entry['outages'] for entry in known.values()):
            found.append(_passages(known, inputs))
        found.append(_honesty(known))
    found.append(_modes(metrics))
    rows = [
        (name, entry['estimates'], entry['runtime_s'], _inverse(entry.get('real_time_factor')))
        for name, entry in metrics.items()
    ]
    columns = ('method', 'estimates', 'run time [s]', 'x real time')
    return [*found, Table('run time', columns, rows)]


def refusals(metrics: Mapping[str, Mapping[str, Any]]) -> Table | None:
    """Return what was refused, by sensor and reason, the methods side by side; None if nothing."""
    reasons = sorted(
        {
            (sensor, reason)
            for entry in metrics.values()
            for sensor, counts in entry['rejected'].items()
            for reason in counts
        }
    )
    if not reasons:
        return None
    rows = [
        (
            sensor,
            reason,
            *(entry['rejected'].get(sensor, {}).get(reason) for entry in metrics.values()),
        )
        for sensor, reason in reasons
    ]
    return Table('refused measurements', ('sensor', 'reason', *metrics), rows)


def notes(inputs: Inputs, outcomes: Mapping[str, Outcome]) -> list[str]:
    """Return what a reader should know: what was missing, what the methods remarked."""
    said = list(inputs.findings)
    said += [
        f'{name}: {count} messages refused before any method: {reason}'
        for name, counts in inputs.rejected.items()
        for reason, count in counts.items()
    ]
    if inputs.track is None and MAP not in outcomes:
        said.append('Without a track there is no chainage; along and across are by the course.')
    remarks: dict[str, list[str]] = {}
    for name, one in outcomes.items():
        for note in one.result.notes:
            remarks.setdefault(note, []).append(name)
        if one.errors is not None and not len(one.errors):
            remarks.setdefault('no estimate while the truth moves', []).append(name)
    return said + [f'{", ".join(names)}: {note}' for note, names in remarks.items()]


def entry_errors(inputs: Inputs) -> list[float | None]:
    """Return the level error of the last fix before each outage [m]: the floor of what follows."""
    if inputs.truth is None:
        return [None] * len(inputs.outages)
    times, positions = inputs.fixes
    return [error_of_latest(times, positions, inputs.truth, begin) for begin, _ in inputs.outages]


def _errors(metrics: Mapping[str, Mapping[str, Any]]) -> Table:
    rows = [[name, *(_dig(entry, path) for _, path in COLUMNS)] for name, entry in metrics.items()]
    title = 'level error [m] over the moving part of the run'
    return Table(title, ('method', *(title for title, _ in COLUMNS)), rows)


def _passages(metrics: Mapping[str, Mapping[str, Any]], inputs: Inputs) -> Table:
    """Return greatest and last level error of every method through every outage."""
    begin_s = float(inputs.recorded.imu.time_s[0])
    rows: list[list[Cell]] = []
    for (begin, end), floor in zip(inputs.outages, entry_errors(inputs), strict=True):
        row: list[Cell] = [f'{begin - begin_s:.0f} s', round(end - begin), floor]
        for entry in metrics.values():
            passage: Mapping[str, float]
            passage = next((p for p in entry['outages'] if p['from_s'] == begin), {})
            row += [passage.get('max_m'), passage.get('end_m')]
        rows.append(row)
    for what in ('median', 'p95', 'max'):
        row = [{'p95': '95 %'}.get(what, what), None, None]
        for entry in metrics.values():
            row += [_dig(entry, ('outage', name, what)) for name in ('max_m', 'end_m')]
        rows.append(row)
    columns = ['outage at', 'length [s]', 'fix before']
    for name in metrics:
        columns += [f'{name}: max', 'end']
    return Table('level error [m] through the outages', columns, rows)


def _honesty(metrics: Mapping[str, Mapping[str, Any]]) -> Table:
    rows = [
        (name, where, *(_dig(entry, (place, key)) for _, key in HONESTY))
        for place, where in (('open_sky', 'with fixes'), ('outage', 'in outages'))
        for name, entry in metrics.items()
    ]
    columns = ('method', 'where', *(title for title, _ in HONESTY))
    return Table('what sigma is worth: an honest one gives 0.954 and 1', columns, rows)


def _modes(metrics: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return how often each method was in each mode."""
    names = list(dict.fromkeys(mode for entry in metrics.values() for _, mode in entry['modes']))
    rows = [
        (name, *(sum(mode == wanted for _, mode in entry['modes']) for wanted in names))
        for name, entry in metrics.items()
    ]
    return Table('modes: how often each was entered', ('method', *names), rows)


def _inverse(value: float | None) -> float | None:
    return 1.0 / value if value else None


def _dig(content: Mapping[str, Any], path: tuple[str, ...]) -> float | None:
    value: Any = content
    for name in path:
        value = value.get(name) if isinstance(value, Mapping) else None
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else None

"""Figures of the maglev's methods: from results and truth to metrics.json and tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from maglev_localization.health import ISOLATED, SILENT
from maglev_localization.methods import MethodResult
from track_localization.cli.maglev.inputs import Inputs
from track_localization.cli.maglev.truth import placed
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.line_metrics import (
    epoch_errors,
    line_figures,
    since,
    spread,
    standing_errors,
)
from track_localization.evaluation.metrics import RideErrors, present
from track_localization.evaluation.tabulate import Table

SINCE = 'from_first_balise'
"""Where metrics.json has the figures from the first balise on."""
COLUMNS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ('RMSE', ('position_m', 'rmse')),
    ('mean', ('position_m', 'mean')),
    ('median', ('position_m', 'median')),
    ('95 %', ('position_m', 'p95')),
    ('max', ('position_m', 'max')),
    ('speed RMSE [m/s]', ('speed_mps', 'rmse')),
    ('speed 95 %', ('speed_mps', 'p95')),
    ('speed max', ('speed_mps', 'max')),
    ('NEES', ('nees_mean',)),
    ('in 2 sigma', ('inside_2_sigma',)),
)
"""Columns of the table of errors, and where metrics.json has them."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """
    One method's result, placed on the line, and how far it is off.

    Attributes:
        result: what the method gave.
        trajectory: its estimates as poses in ``map``.
        errors: over the moving part of the run; None without a truth.
    """

    result: MethodResult
    trajectory: Trajectory
    errors: RideErrors | None


def outcome(result: MethodResult, inputs: Inputs) -> Outcome:
    """Place a method's estimates on the line and hold them against the truth."""
    trajectory = placed(result.trajectory, inputs.line)
    errors = None
    if inputs.truth is not None and len(trajectory):
        errors = epoch_errors(trajectory, inputs.truth)
    return Outcome(result, trajectory, errors)


def figures(outcome: Outcome, inputs: Inputs) -> dict[str, Any]:
    """Return what metrics.json says about one method; see ARCHITECTURE.md for the names."""
    out: dict[str, Any] = {}
    if outcome.errors is not None and inputs.truth is not None:
        out |= line_figures(outcome.errors)
        out['standing_m'] = spread(standing_errors(outcome.trajectory, inputs.truth))
        if inputs.first_balise_s is not None:
            later = line_figures(since(outcome.errors, inputs.first_balise_s))
            out[SINCE] = {name: v for name, v in later.items() if name != 'covered'}
    seconds, duration_s = outcome.result.runtime_s, inputs.readings.duration_s
    out['estimates'] = len(outcome.trajectory)
    out['runtime_s'] = seconds
    out['real_time_factor'] = seconds / duration_s if duration_s > 0.0 else None
    out = present(out)
    out['rejected'] = {name: dict(counts) for name, counts in outcome.result.rejected.items()}
    return out


def tables(metrics: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """Return the errors over the whole run and from the first balise on, and the run times."""
    found = []
    if any('position_m' in entry for entry in metrics.values()):
        title = 'error [m] over the moving part of the run'
        found.append(_errors(title, metrics))
    later = {name: entry[SINCE] for name, entry in metrics.items() if SINCE in entry}
    if any('position_m' in entry for entry in later.values()):
        found.append(_errors('the same from the first balise on', later))
    rows = [
        (name, entry['estimates'], entry['runtime_s'], entry.get('real_time_factor'))
        for name, entry in metrics.items()
    ]
    columns = ('method', 'estimates', 'run time [s]', 'of the run')
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
        (sensor, reason, *(_count(entry, sensor, reason) for entry in metrics.values()))
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
    if inputs.truth is not None and len(inputs.balises) and inputs.first_balise_s is None:
        said.append('No balise of the table was heard: figures from the first balise are left out.')
    remarks: dict[str, list[str]] = {}
    for name, one in outcomes.items():
        for note in (*one.result.notes, *_spells(one.result.health, inputs)):
            remarks.setdefault(note, []).append(name)
        if one.errors is not None and not len(one.errors.time_s):
            remarks.setdefault('no estimate while the truth moves', []).append(name)
    return said + [f'{", ".join(names)}: {note}' for note, names in remarks.items()]


def _spells(health: Sequence[tuple[float, str, str]], inputs: Inputs) -> list[str]:
    """Return how long each sensor was silent or not believed."""
    end_s = float(inputs.readings.arrival_s[-1])
    lasted: dict[tuple[str, str], float] = {}
    for k, (time, sensor, state) in enumerate(health):
        after = (t for t, other, _ in health[k + 1 :] if other == sensor)
        if state in (SILENT, ISOLATED):
            spell = max(next(after, end_s) - time, 0.0)
            lasted[sensor, state] = lasted.get((sensor, state), 0.0) + spell
    return [f'{sensor} {state} for {s:.1f} s' for (sensor, state), s in lasted.items()]


def _errors(title: str, metrics: Mapping[str, Mapping[str, Any]]) -> Table:
    rows = [[name, *(_dig(entry, path) for _, path in COLUMNS)] for name, entry in metrics.items()]
    return Table(title, ('method', *(title for title, _ in COLUMNS)), rows)


def _count(entry: Mapping[str, Any], sensor: str, reason: str) -> int | None:
    count: int | None = entry['rejected'].get(sensor, {}).get(reason)
    return count


def _dig(content: Mapping[str, Any], path: tuple[str, ...]) -> float | None:
    value: Any = content
    for name in path:
        value = value.get(name) if isinstance(value, Mapping) else None
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else None

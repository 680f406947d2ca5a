"""
The real drive of docs/kingston.md: fixes withheld in window after window, every method beside.

Use: ``.venv/bin/python tools/real_kingston.py`` (``make real``). The recording is read where it is:
``../shared/data/kingston``, or ``kingston`` in the folder that TRACK_LOCALIZATION_DATA names.
"""

from __future__ import annotations

import argparse
import copy
import dataclasses
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from track_localization.cli.common import assignment, guarded, names_among, say
from track_localization.cli.parameters import config_text, read_parameters
from track_localization.errors import DataError
from track_localization.evaluation.tabulate import Cell, Table
from track_localization.evaluation.windows import Ends, Way, dead_reckoned, end_errors, figures
from track_localization.geodesy import Datum, enu_from_geodetic
from track_localization.io.kingston import Drive, default_folder, read_drive
from track_localization.settings import override
from train_localization.config import TrainConfig
from train_localization.estimate import Estimate
from train_localization.measurements import GnssFix, Measurement, WheelSpeed
from train_localization.pipeline import TrainPipeline, with_method

Array = NDArray[np.float64]

CONFIG = Path(__file__).resolve().parent.parent / 'config' / 'kingston.yaml'
METHODS = ('ins', 'paper', 'robust')
LENGTHS_S = (30.0, 60.0, 120.0)
STRIDE_S, SETTLING_S = 60.0, 300.0
TUNED_UNTIL_S = 1000.0
"""Settings were chosen on what came before; what comes after is what counts."""
TUNING_SETTLING_S, TUNING_STRIDE_S = 100.0, 20.0
"""The car starts at 530 s: before 1000 s there is no time for more."""
RESTS_UNTIL_S = 500.0
WHEEL_VARIANCE = 0.03
"""The odometer tells none; what rounding down to 1 km/h leaves [m^2/s^2]."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """
    One method over the drive.

    Attributes:
        estimates: with every fix.
        coasted: window's begin -> estimates from there on, without fixes.
        rejected: sensor -> reason -> count, with every fix.
    """

    estimates: list[Estimate]
    coasted: dict[float, list[Estimate]]
    rejected: dict[str, dict[str, int]]


class Exam:
    """The drive as measurements and as truth, in east, north, up of where it began."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        fixes, reference = drive.fixes, drive.reference
        first = reference.geodetic[0]
        rest = fixes.time_s < RESTS_UNTIL_S
        truly = np.interp(fixes.time_s[rest], reference.time_s, reference.geodetic[:, 2])
        # Heights are above different surfaces: the car's first minutes tell how far apart.
        self.height_offset = float(np.mean(fixes.geodetic[rest, 2] - truly))
        self.datum = Datum(first[0], first[1], first[2] + self.height_offset)
        place = enu_from_geodetic(
            reference.geodetic[:, 0],
            reference.geodetic[:, 1],
            reference.geodetic[:, 2] + self.height_offset,
            self.datum,
        )
        self.way = Way(reference.time_s, place, reference.velocity, reference.yaw)

    def measurements(self, until_s: float) -> list[Measurement]:
        """Return what the sensors told, in order of arrival."""
        drive = self.drive
        told: list[tuple[float, int, Measurement]] = []
        for k, time_s in enumerate(drive.imu.time_s):
            told.append((float(time_s), 0, drive.imu.sample(k)))
        for k, time_s in enumerate(drive.fixes.time_s):
            latitude, longitude, height = (float(x) for x in drive.fixes.geodetic[k])
            covariance = np.diag(drive.fixes.sigma[k] ** 2)
            fix = GnssFix(float(time_s), latitude, longitude, height, covariance)
            told.append((fix.time_s, 1, fix))
        for time_s, speed in zip(drive.speeds.time_s, drive.speeds.speed, strict=True):
            wheel = WheelSpeed(float(time_s), float(speed), WHEEL_VARIANCE)
            told.append((wheel.time_s, 2, wheel))
        told.sort(key=lambda one: one[:2])
        begin_s = drive.imu.time_s[0]
        return [measurement for time_s, _, measurement in told if begin_s <= time_s <= until_s]

    def run(
        self, config: TrainConfig, until_s: float, settling_s: float, stride_s: float, from_s: float
    ) -> Outcome:
        """Run a method over the drive; at each window's begin a copy of it goes on without."""
        heard, pipeline = self.measurements(until_s), TrainPipeline(config, None, self.datum)
        estimates: list[Estimate] = []
        coasted: dict[float, list[Estimate]] = {}
        next_s = np.inf
        for k, measurement in enumerate(heard):
            while measurement.time_s >= next_s:
                if next_s >= from_s and next_s + LENGTHS_S[0] <= until_s:
                    blind = copy.deepcopy(pipeline)
                    coasted[next_s] = list(_coast(blind, heard[k:], next_s + LENGTHS_S[-1]))
                next_s += stride_s
            made = pipeline.push(measurement)
            if made and not estimates:
                next_s = made[0].time_s + settling_s
            estimates += made
        return Outcome(estimates, coasted, pipeline.rejected)

    def ends(self, outcome: Outcome, length_s: float, until_s: float) -> Ends:
        """Return the errors at the ends of all windows of one length."""
        begins = np.array([b for b in outcome.coasted if b + length_s <= until_s])
        last = [_nearest(outcome.coasted[b], b + length_s) for b in begins]
        return end_errors(
            begins,
            np.array([e.time_s for e in last]),
            np.array([e.position for e in last]),
            np.array([e.covariance[:2, :2] for e in last]),
            self.way,
        )

    def farthest(self, outcome: Outcome) -> float:
        """Return the greatest horizontal error anywhere in a window [m]."""
        coasted = [e for estimates in outcome.coasted.values() for e in estimates]
        times = np.array([e.time_s for e in coasted])
        inside = times <= self.way.time_s[-1]
        place = np.array([e.position[:2] for e in coasted])[inside]
        return float(np.hypot(*(place - self.way.position(times[inside])[:, :2]).T).max())

    def baseline(self, begins: Array, length_s: float) -> Ends:
        """Return those of odometer and yaw gyro from the true pose at the start."""
        drive = self.drive
        position = dead_reckoned(
            begins,
            length_s,
            self.way,
            (drive.imu.time_s, drive.imu.angular_rate[:, 2]),
            (drive.speeds.time_s, drive.speeds.speed),
        )
        return end_errors(begins, begins + length_s, position, None, self.way)

    def receiver(self, from_s: float, until_s: float) -> tuple[Array, Array]:
        """Return stamps (N,) and errors (N, 3) of the fixes themselves."""
        fixes = self.drive.fixes
        inside = (fixes.time_s >= from_s) & (fixes.time_s <= until_s)
        latitude, longitude, height = fixes.geodetic[inside].T
        place = enu_from_geodetic(latitude, longitude, height, self.datum)
        return fixes.time_s[inside], place - self.way.position(fixes.time_s[inside])


def _coast(
    pipeline: TrainPipeline, heard: Sequence[Measurement], until_s: float
) -> Iterator[Estimate]:
    for measurement in heard:
        if measurement.time_s > until_s + 1.0:
            return
        if not isinstance(measurement, GnssFix):
            yield from pipeline.push(measurement)


def _nearest(estimates: Sequence[Estimate], time_s: float) -> Estimate:
    """Return the estimate at a time; those after a filter's restart are none."""
    found = min(estimates, key=lambda e: abs(e.time_s - time_s), default=None)
    if found is None or abs(found.time_s - time_s) > 0.2:
        raise DataError(f'no estimate at {time_s:.1f} s: the filter gave up')
    return found


def whole_drive(exam: Exam, outcomes: dict[str, Outcome], from_s: float, until_s: float) -> Table:
    """Return the errors with every fix, beside the receiver's own at the same times."""
    times, errors = exam.receiver(from_s, until_s)
    rows = [_row('receiver alone', errors, np.full(len(times), np.nan))]
    for method, outcome in outcomes.items():
        stamps = np.array([e.time_s for e in outcome.estimates])
        inside = (stamps >= from_s) & (stamps <= until_s)
        place = np.array([e.position for e in outcome.estimates])[inside]
        P = np.array([e.covariance[:3, :3] for e in outcome.estimates])[inside]
        error = place - exam.way.position(stamps[inside])
        nees = np.einsum('ij,ij->i', error, np.linalg.solve(P, error[..., None])[..., 0])
        rows.append(_row(method, error, nees))
    return Table(
        f'With every fix, {from_s:.0f} to {until_s:.0f} s [m]',
        (
            *('', 'horizontal: median', '95 %', 'max', 'rms'),
            *('up: median', '95 %', 'max', 'rms', 'NEES/3'),
        ),
        rows,
    )


def _row(name: str, error: Array, nees: Array) -> list[Cell]:
    level, up = np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])
    shown: list[Cell] = [name]
    for values in (level, up):
        shown += [*(float(x) for x in np.percentile(values, [50.0, 95.0, 100.0]))]
        shown.append(float(np.sqrt(np.mean(values**2))))
    return [*shown, float(np.mean(nees)) / 3.0]


def windows(exam: Exam, outcomes: dict[str, Outcome], until_s: float) -> list[Table]:
    """Return a table for each length of the windows."""
    tables = []
    for length_s in LENGTHS_S:
        found = {m: exam.ends(outcome, length_s, until_s) for m, outcome in outcomes.items()}
        begins = next(iter(found.values())).begin_s
        found['odometer + gyro, true start'] = exam.baseline(begins, length_s)
        shown = {name: figures(ends) for name, ends in found.items()}
        names = ['method', *next(iter(shown.values()))]
        rows: list[list[Cell]] = [[name, *values.values()] for name, values in shown.items()]
        tables.append(
            Table(f'Fixes withheld for {length_s:.0f} s: error at the end [m]', names, rows)
        )
    return tables


def main(argv: Sequence[str] | None = None) -> int:
    """Run and print; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('--data', type=Path, default=default_folder(), metavar='DIR')
    parser.add_argument('--config', type=Path, default=CONFIG, metavar='FILE')
    parser.add_argument(
        '--set', type=assignment, action='append', default=[], metavar='FIELD=VALUE'
    )
    parser.add_argument('--methods', type=names_among(METHODS), default=METHODS)
    parser.add_argument('--tuning', action='store_true', help='the part before 1000 s instead')
    parser.add_argument('--markdown', action='store_true', help='tables as Markdown')
    parser.add_argument('--each', action='store_true', help='every window too')
    args = parser.parse_args(argv)
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> None:
    """Run the methods over the drive and print what came out."""
    exam = Exam(read_drive(args.data))
    config = read_parameters(args.config, TrainConfig(), ('train_kf',), ())[0]
    config = override(config, dict(args.set))
    end_s = float(exam.drive.reference.time_s[-1])
    until_s = TUNED_UNTIL_S if args.tuning else end_s
    from_s = 0.0 if args.tuning else TUNED_UNTIL_S
    pace = (TUNING_SETTLING_S, TUNING_STRIDE_S) if args.tuning else (SETTLING_S, STRIDE_S)
    outcomes = {}
    for method in args.methods:
        say(f'{method} ...')
        outcomes[method] = exam.run(with_method(config, method), until_s, *pace, from_s)
    tables = windows(exam, outcomes, until_s)
    began_s = next(iter(outcomes.values())).estimates[0].time_s
    tables.append(whole_drive(exam, outcomes, max(from_s, began_s + 20.0), until_s))
    changed = [line for line in config_text(config).splitlines() if '(default' in line]
    print('\n'.join(['Settings that differ from the defaults:', *changed]))
    for table in tables:
        print('\n' + (table.markdown() if args.markdown else table.text()))
    for method, outcome in outcomes.items():
        print(
            f'\n{method}: started at {outcome.estimates[0].time_s:.1f} s; at most '
            f'{exam.farthest(outcome):.1f} m off anywhere in a window; '
            f'refused: {outcome.rejected or "nothing"}'
        )
        if args.each:
            print(_each(exam, outcome, until_s).text())


def _each(exam: Exam, outcome: Outcome, until_s: float) -> Table:
    rows = []
    for length_s in LENGTHS_S:
        ends = exam.ends(outcome, length_s, until_s)
        rows += [
            [length_s, b, float(np.hypot(a, c)), a, c, s]
            for b, a, c, s in zip(ends.begin_s, ends.along, ends.cross, ends.sigma, strict=True)
        ]
    return Table('', ('length [s]', 'begin [s]', 'error [m]', 'along', 'cross', 'sigma'), rows)


if __name__ == '__main__':
    sys.exit(main())

"""``reproduce coaster --track-filter``: the track filter's exam and its acceptance table."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Callable, Sequence

import numpy as np

from coaster_localization.methods import TRACK_METHODS
from track_localization.cli import goals
from track_localization.cli.coaster import reproduce_midride, reproduce_tables
from track_localization.cli.coaster.reproduce_goals import MARKERS, Rides
from track_localization.cli.coaster.reproduce_rides import (
    KEEPER,
    MID_RIDE,
    START_OFF,
    Ride,
    Task,
    code_fingerprint,
)
from track_localization.cli.coaster.reproduce_track_goals import (
    LIVE,
    POSITION,
    SMOOTHED,
    Exam,
    track_goals,
)
from track_localization.evaluation import provenance
from track_localization.evaluation.tabulate import Cell, Table

EXAM_SEEDS = range(2000, 2020)
"""Seeds that nothing was tuned on."""
EXAM_TRACKS = ('looping', 'mine', 'launch', 'wooden', 'shuttle')
SCENARIO_SEEDS = 5
STARTS = 200

SCENARIO_ROWS = (
    *('mount8', 'mount20', 'mount90', 'mountany', 'vib3', 'dwell0', 'dwell120'),
    *('blockstop', 'clip4g', 'track3', START_OFF),
)
NOT_IN_SCENARIOS = ('shuttle',)

TRUTH = 'markers_truth_m.mean'
METHOD_COLUMNS: tuple[tuple[str, str, Callable[..., np.floating]], ...] = (
    ('markers', MARKERS, np.mean),
    ('markers, truth', TRUTH, np.mean),
    ('ride', POSITION, np.mean),
    ('worst ride', POSITION, np.max),
    ('in 2 sigma', 'inside_2_sigma', np.mean),
    ('NEES/3: mean', 'nees_position_over_3', np.mean),
    ('median', 'nees_position_over_3', np.median),
    ('covered', 'covered', np.mean),
)
"""Heading, figure of a ride, statistic over rides."""


def run(args: argparse.Namespace) -> None:
    """Run or read the rides, then print and write the tables."""
    tasks, code = make_tasks(args), code_fingerprint()
    rides = KEEPER.gather(tasks, args.output / 'rides', args.jobs, args.reprint, code)
    publish(args, rides, code)


def make_tasks(args: argparse.Namespace) -> list[Task]:
    """Return the rides to run: nominal ones, those of the scenarios, those met under way."""
    places = [(track, seed) for seed in args.seeds for track in args.tracks]
    tasks = [Task(track, 'nominal', seed, TRACK_METHODS) for track, seed in places]
    tasks += [
        Task(track, name, seed, TRACK_METHODS)
        for name in SCENARIO_ROWS
        for seed in args.seeds[: args.scenario_seeds]
        for track in args.tracks
        if track not in NOT_IN_SCENARIOS
    ]
    for k, (track, seed) in enumerate(places):
        count = len(range(k, args.starts, len(places)))
        if count:
            tasks.append(Task(track, MID_RIDE, seed, reproduce_midride.names(count)))
    return tasks


def publish(args: argparse.Namespace, rides: Sequence[Ride], code: str) -> None:
    """Print the tables; write them as Markdown, CSV and JSON."""
    wanted = {(t.scenario, t.track, t.seed): t.methods for t in make_tasks(args)}
    rides = [_only(ride, wanted[ride.scenario, ride.track, ride.seed]) for ride in rides]
    exam = Exam(
        [ride for ride in rides if ride.scenario == 'nominal'],
        {name: [r for r in rides if r.scenario == name] for name in SCENARIO_ROWS},
        [ride for ride in rides if ride.scenario == MID_RIDE],
    )
    nominal = Rides(exam.nominal)
    tables = {
        'methods': methods_table(nominal),
        'tracks': tracks_table(nominal),
        'scenarios': scenarios_table(exam),
        'midride': midride_table(exam),
        'goals': goals.table(track_goals(exam)),
    }
    said = [
        f'reproduce coaster --track-filter --seeds {args.seeds.start}:{args.seeds.stop} '
        f'--scenario-seeds {args.scenario_seeds} --starts {args.starts}, '
        f'tracks {", ".join(args.tracks)}.',
        *reproduce_tables.rides_note(rides),
        *_broken(exam.mid_ride),
        f'Run times with {args.jobs} jobs on {provenance.machine()["processors"]} processors.',
        f'Commit {provenance.commit()}, code {code}.',
    ]
    goals.show(args.output, tables, said)
    content = {name: dataclasses.asdict(table) for name, table in tables.items()}
    text = json.dumps(_finite(content | {'about': said}), indent=2)
    (args.output / 'reproduce.json').write_text(text + '\n', encoding='utf-8')


def methods_table(nominal: Rides) -> Table:
    """Return METHOD_COLUMNS of every output of the filter, and of the floor."""
    return Table(
        f'The track filter over {len(nominal.all)} nominal rides: errors [m], means over rides',
        ('output', *(heading for heading, _, _ in METHOD_COLUMNS), 'x real time'),
        _method_rows(nominal),
    )


def tracks_table(nominal: Rides) -> Table:
    """Return the same, track by track."""
    rows = [
        (f'{track} ({len(nominal.on(track).all)})', *row)
        for track in nominal.tracks
        for row in _method_rows(nominal.on(track))
    ]
    columns = ('track', 'output', *(heading for heading, _, _ in METHOD_COLUMNS), 'x real time')
    return Table('The same by track', columns, rows)


def scenarios_table(exam: Exam) -> Table:
    """Return a row for each scenario."""
    rows: list[tuple[Cell, ...]] = []
    for name, all_ in exam.scenarios.items():
        rides = Rides(all_)
        worst = rides.values(LIVE, POSITION)
        rows.append(
            (
                name,
                len(exam.simulated(all_)),
                exam.lost(all_),
                rides.mean(LIVE, POSITION),
                float(worst.max()) if len(worst) else None,
                rides.mean(SMOOTHED),
                rides.mean(LIVE),
                rides.mean(LIVE, 'markers_after_element_m.mean'),
                rides.mean(LIVE, 'inside_2_sigma'),
                rides.mean(LIVE, 'nees_position_over_3'),
                rides.mean(SMOOTHED, 'inside_2_sigma'),
                rides.mean(LIVE, 'covered'),
            )
        )
    columns = (
        *('scenario', 'rides', 'lost', 'live', 'worst live', 'smoothed markers', 'live markers'),
        *('after an element', 'in 2 sigma', 'NEES/3', 'smoothed in 2 sigma', 'covered'),
    )
    title = 'Scenarios: errors [m], means over rides; lost: live mean beyond 5 m, or no result'
    return Table(title, columns, rows)


def midride_table(exam: Exam) -> Table:
    """Return how starts during the ride went, by track and in all."""
    tracks = Rides(exam.mid_ride).tracks
    groups = [(track, [r for r in exam.mid_ride if r.track == track]) for track in tracks]
    rows: list[tuple[Cell, ...]] = []
    for name, rides in [*groups, ('all', exam.mid_ride)]:
        starts = exam.starts(rides)
        rows.append(
            (
                name,
                len(starts.all),
                len(starts.told),
                100.0 * starts.share('near'),
                starts.median('error_m'),
                100.0 * starts.share('wrong_after'),
                100.0 * starts.share('wrong_ever'),
                100.0 * starts.per_time('wrong_s', 'answered_s'),
                starts.per_time('cpu_s', 'ride_s'),
            )
        )
    columns = (
        *('track', 'starts', 'told by 2 elements', 'then within 1 m [%]', 'median error [m]'),
        *('wrong then or later [%]', 'wrong ever [%]', 'of the time [%]', 'CPU s per s'),
    )
    title = (
        'Starts during the ride; wrong: an answer off by more than 5 sigma and 1 m, '
        'share of the starts'
    )
    return Table(title, columns, rows)


def _method_rows(rides: Rides) -> list[tuple[Cell, ...]]:
    rows: list[tuple[Cell, ...]] = []
    for method in TRACK_METHODS:
        cells: list[Cell] = [method]
        for _, figure, statistic in METHOD_COLUMNS:
            values = rides.values(method, figure)
            cells.append(float(statistic(values)) if len(values) else None)
        times = rides.values(method, 'real_time_factor')
        rows.append((*cells, float(1.0 / np.median(times)) if len(times) else None))
    floor: list[Cell] = ['floor: the design line']
    for _, figure, statistic in METHOD_COLUMNS:
        values = rides.about(f'floor.{figure}')
        floor.append(float(statistic(values)) if len(values) else None)
    return [*rows, (*floor, None)]


def _broken(mid_ride: Sequence[Ride]) -> list[str]:
    """Return sentences on starts at which the filter broke down."""
    return [
        f'broken down: {ride.track} seed {ride.seed}, begun at {start["begin_s"]:.2f} s: '
        f'{start["broken"]}'
        for ride in mid_ride
        for start in ride.methods.values()
        if 'broken' in start
    ]


def _only(ride: Ride, methods: Sequence[str]) -> Ride:
    """Return the ride without methods that an earlier run kept and this one does not ask for."""
    kept = {name: entry for name, entry in ride.methods.items() if name in methods}
    return dataclasses.replace(ride, methods=kept)


def _finite(content: object) -> object:
    """Return nested content with None for what is not finite, which JSON cannot hold."""
    if isinstance(content, dict):
        return {name: _finite(value) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    if isinstance(content, float) and not np.isfinite(content):
        return None
    return content

"""The paper's tables and figures beside ours."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from coaster_localization.methods import MATCHING, METHODS, PAPER_FRONT_END
from track_localization.cli.coaster.reproduce_goals import MARKERS, Rides, gross, mount_of
from track_localization.cli.coaster.reproduce_rides import Ride
from track_localization.cli.coaster.sweeps import LAMBDA_X, LAMBDA_Y, RATIO, Sweeps, collect
from track_localization.cli.goals import Goal
from track_localization.evaluation.tabulate import Table

Array = NDArray[np.float64]

PAPER_MATCHING = {'srdtw_z': 0.445, 'srdtw_yaw': 2.191, 'srdtw_pitch': 0.634, 'srdtw_roll': 1.9978}
"""Table 1 of the paper: mean error at 16 markers, two runs each [m]."""

PAPER_FUSED, PAPER_GAIN = 0.24, -45.6
"""Headline of the paper: fused error [m], and change against the matching [%]."""


def paper_table(nominal: Rides, small_mount: Rides) -> Table:
    """Return the paper's Table 1 and headline beside ours."""
    rows: list[tuple[str | float | None, ...]] = [
        (
            f'match, {method.removeprefix("srdtw_")}',
            paper,
            nominal.median(method),
            nominal.mean(method),
        )
        for method, paper in PAPER_MATCHING.items()
    ]
    rows.append(
        (
            'fused as the paper does (eskf_paper)',
            PAPER_FUSED,
            nominal.median('eskf_paper'),
            nominal.mean('eskf_paper'),
        )
    )
    rows.append(('  change against its match', _percent(PAPER_GAIN), *_gain(nominal, 'eskf_paper')))
    for name, rides in (
        ('fused, ours (eskf_smoothed)', nominal),
        ('fused, ours, mount 1 deg', small_mount),
    ):
        if rides.all:
            both = (rides.median('eskf_smoothed'), rides.mean('eskf_smoothed'))
            rows.append((name, PAPER_FUSED, *both))
            gain = _gain(rides, 'eskf_smoothed')
            rows.append(('  change against its match', _percent(PAPER_GAIN), *gain))
    return Table(
        'Error at markers [m]: the paper (mean, a real ride) and ours (simulated rides)',
        ('', 'paper', 'ours, median over rides', 'ours, mean over rides'),
        [tuple(_text(c) for c in row) for row in rows],
    )


METHOD_COLUMNS = (
    ('ride mean: median', 'position_m.mean', np.median),
    ('mean', 'position_m.mean', np.mean),
    ('ride 95 %: median', 'position_m.p95', np.median),
    ('markers: median', MARKERS, np.median),
    ('mean', MARKERS, np.mean),
    ('speed [m/s]', 'speed_mps.mean', np.median),
    ('NEES/3', 'nees_position_over_3', np.median),
    ('in 2 sigma', 'inside_2_sigma', np.median),
    ('real-time factor', 'real_time_factor', np.median),
)
"""Heading, figure of a ride, statistic over rides."""


def methods_table(nominal: Rides) -> Table:
    """Return every method, and the design line itself, with METHOD_COLUMNS."""

    def row(name: str, values: Callable[[str], Array]) -> list[str | float]:
        cells: list[str | float] = [name]
        for _, figure, statistic in METHOD_COLUMNS:
            found = values(figure)
            cells.append(float(statistic(found)) if len(found) else float('nan'))
        return cells

    rows = [
        row(method, functools.partial(nominal.values, method))
        for method in METHODS
        if len(nominal.values(method, 'runtime_s'))
    ]
    rows.append(row('floor: the design line', lambda f: nominal.about(f'floor.{f}')))
    return Table(
        f'All methods over {len(nominal.all)} rides [m]; real-time factor = run time / duration',
        ('method', *(heading for heading, _, _ in METHOD_COLUMNS)),
        rows,
    )


def tracks_table(nominal: Rides) -> Table:
    """Return each method's median error at markers by track."""
    rows: list[tuple[str | float, ...]] = [
        (method, *(nominal.on(track).median(method) for track in nominal.tracks))
        for method in METHODS
        if len(nominal.values(method, MARKERS))
    ]
    columns = [f'{track} ({len(nominal.on(track).all)})' for track in nominal.tracks]
    return Table('Error at markers by track, median over rides [m]', ('method', *columns), rows)


def gross_table(nominal: Rides) -> Table:
    """Return how the gross mismatches of every match are dealt with."""
    rows: list[tuple[str | float, ...]] = [
        (method, *(100.0 * value for value in gross(nominal, method)))
        for method in MATCHING
        if len(nominal.values(method, 'match.gross_share'))
    ]
    columns = ('match', 'off by > 10 m', 'of that flagged', 'within 3 sigma', 'either')
    return Table('Gross mismatches, share of the moving ride [%]', columns, rows)


def sweeps_of(nominal: Rides) -> Sweeps | None:
    """Return the sweeps' medians over the rides that have them."""
    swept = []
    for ride in nominal.all:
        figures = {
            name.removeprefix('sweep.'): value
            for name, value in ride.about.items()
            if name.startswith('sweep.') and isinstance(value, float)
        }
        if figures:
            swept.append(figures)
    return collect(swept)


def sweep_tables(sweeps: Sweeps) -> dict[str, Table]:
    """Return the paper's Figures 14 and 15 as tables, by name."""
    by_lambda = {
        f'fig14_{feed}': Table(
            f'Fig. 14: fused error at markers [m] by lambda_y and n, fed by {feed}; '
            f'the match alone {sweeps.matching[feed]:.3f}',
            ('lambda_y [m^2]', *(f'n = {n:g}' for n in RATIO)),
            [(f'{y:g}', *(float(v) for v in row)) for y, row in zip(LAMBDA_Y, grid, strict=True)],
        )
        for feed, grid in sweeps.by_lambda.items()
    }
    by_channel = Table(
        'Fig. 15: fused error at markers [m] by lambda_x, n = 1000',
        ('channel', 'match alone', *(f'lambda_x = {x:g}' for x in LAMBDA_X)),
        [
            (channel, sweeps.matching[channel], *(float(v) for v in row))
            for channel, row in sweeps.by_channel.items()
        ],
    )
    return {**by_lambda, 'fig15': by_channel}


def sweep_goals(sweeps: Sweeps) -> list[Goal]:
    """Return the paper's findings on n and lambda_x as goals."""
    ratio = np.array(RATIO)
    means = {
        feed: [float(grid[:, mask].mean()) for mask in (ratio >= 100.0, ratio <= 10.0)]
        for feed, grid in sweeps.by_lambda.items()
    }
    told = [f'{high:.3f} against {low:.3f} m fed by {feed}' for feed, (high, low) in means.items()]
    # The paper found it with its own match; of a better one it says nothing.
    high, low = means.get(PAPER_FRONT_END, (np.nan, np.nan))
    out = [
        Goal(
            f"the paper's finding, fed by {PAPER_FRONT_END}: n >= 100 better than n <= 10",
            'smaller error',
            '; '.join(told) + ' (means over the grid of medians)',
            None if PAPER_FRONT_END not in means else high < low,
        )
    ]
    rows = sweeps.by_channel
    if len(rows) == 4:
        k = LAMBDA_X.index(10.0)
        z, pitch, yaw, roll = (float(rows[c][k]) for c in ('z', 'pitch', 'yaw', 'roll'))
        out.append(
            Goal(
                "the paper's finding: fused from Z or pitch better than from yaw or roll",
                'both than both',
                f'{z:.2f}, {pitch:.2f} against {yaw:.2f}, {roll:.2f} m at lambda_x = 10',
                max(z, pitch) < min(yaw, roll),
            )
        )
    return out


def rides_note(rides: Sequence[Ride]) -> list[str]:
    """Return sentences on what was run and what failed."""
    failed = [ride for ride in rides if 'failed' in ride.about]
    mounts = np.array([mount_of(ride) for ride in rides if 'failed' not in ride.about])
    said = [f'{len(rides)} rides, {len(failed)} failed.']
    if len(mounts):
        said[0] += (
            f' Mount angle: median {np.nanmedian(mounts):.1f}, most {np.nanmax(mounts):.1f} deg.'
        )
    said += [f'failed: {r.scenario} {r.track} seed {r.seed}: {r.about["failed"]}' for r in failed]
    return said


def _gain(rides: Rides, method: str) -> tuple[str, str]:
    """Return the change against the fed match: of the medians, of the means."""
    out = []
    for statistic in (rides.median, rides.mean):
        mine, theirs = statistic(method), statistic(method, 'fed.' + MARKERS)
        out.append(_percent(100.0 * (mine / theirs - 1.0)) if theirs > 0.0 else '')
    return out[0], out[1]


def _percent(value: float) -> str:
    return f'{value:+.1f} %'


def _text(cell: str | float | None) -> str:
    return cell if isinstance(cell, str) else '' if cell is None else f'{cell:.3f}'

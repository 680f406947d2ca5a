"""The goals of the train, each with what it asks, what was measured, and whether met."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from track_localization.cli.goals import Goal, at_most
from track_localization.cli.train.reproduce_runs import PLAIN
from track_localization.cli.train.reproduce_tables import MOST, PLACES, Exam, Runs
from train_localization.methods import MAP, PAPER, ROBUST, SMOOTHED

Array = NDArray[np.float64]

LIMITS: tuple[tuple[str, str, str, float, float], ...] = (
    ('paper', PAPER, 'paper scenario, 5 deg/h: paper', 2.5, 5.5),
    ('paper', ROBUST, 'paper scenario, 5 deg/h: robust, no map', 1.7, 2.8),
    ('paper', MAP, 'paper scenario, 5 deg/h: robust with map', 0.9, 1.7),
    ('mems', ROBUST, 'MEMS, 50 deg/h: robust', 2.5, 5.5),
    ('slip', ROBUST, 'wheel slip in the outage: robust', 1.8, 2.6),
)
"""Case, entry, what it is, and the limits of the median and the 95th percentile [m]."""
PAPERS_M, HALF, FACTOR, FAST = 10.0, 0.5, 2.0, 200.0
LEAST, MOST_INSIDE = 0.92, 0.98


def goals(exam: Exam) -> list[Goal]:
    """Return every goal that is measured here."""
    out = [
        _errors(exam[case], entry, what, median, p95) for case, entry, what, median, p95 in LIMITS
    ]
    return [
        *out,
        _smoothed(exam['paper']),
        _papers(exam['paper']),
        *(_honest(exam['paper'], entry) for entry in (ROBUST, MAP)),
        _wrong_map(exam['wrongmap']),
        _fast(exam),
    ]


def _errors(runs: Runs, entry: str, what: str, median_m: float, p95_m: float) -> Goal:
    median, p95 = runs.median(entry, MOST), runs.p95(entry, MOST)
    text = f'{median:.2f} / {p95:.2f} m ({len(runs.values(entry, MOST))} runs)'
    met = None if np.isnan(median) else median <= median_m and p95 <= p95_m
    if entry == PAPER and len(runs.values(PLAIN, MOST)):
        text += f'; without fading {runs.median(PLAIN, MOST):.2f} / {runs.p95(PLAIN, MOST):.2f}'
    best = _best(runs.floor(ROBUST if entry == PAPER else entry), median_m, p95_m)
    what = f'{what}: outage maximum, median / 95 %'
    return Goal(what, f'<= {median_m} / {p95_m} m', text, met, best)


def _best(drawn: Array, median_m: float, p95_m: float) -> str:
    """Return what the best estimator has, (draws, runs) [m], and how often it meets a goal."""
    if not drawn.size:
        return ''
    median, p95 = np.quantile(drawn, (0.5, 0.95))
    exams = np.quantile(drawn, (0.5, 0.95), axis=1)
    met = np.mean((exams[0] <= median_m) & (exams[1] <= p95_m))
    return f'{median:.2f} / {p95:.2f} m; such exams that meet the goal: {met:.0%}'


def _smoothed(runs: Runs) -> Goal:
    ratios = [
        statistic(SMOOTHED, MOST) / statistic(ROBUST, MOST)
        for statistic in (runs.median, runs.p95)
        if statistic(ROBUST, MOST) > 0.0
    ]
    text = ' / '.join(f'{ratio:.2f}' for ratio in ratios)
    met = at_most(float(np.max(ratios)), HALF) if ratios else None
    best, online, smoothed = '', runs.floor(ROBUST), runs.floor(SMOOTHED)
    if online.size:
        ratio = np.quantile(smoothed, (0.5, 0.95)) / np.quantile(online, (0.5, 0.95))
        quantiles = [np.quantile(drawn, (0.5, 0.95), axis=1) for drawn in (smoothed, online)]
        halved = (quantiles[0] <= HALF * quantiles[1]).all(axis=0)
        best = (
            f'{ratio[0]:.2f} / {ratio[1]:.2f}; such exams that meet the goal: {halved.mean():.0%}'
        )
    what = 'smoothed over robust, outage maximum, median / 95 %'
    return Goal(what, '<= 0.5', text, met, best)


def _papers(runs: Runs) -> Goal:
    within = {entry: runs.share(entry, MOST, PAPERS_M) for entry in (PAPER, PLAIN)}
    text = f'{within[PAPER]:.0%} of the runs; without fading {within[PLAIN]:.0%}'
    met = None if np.isnan(within[PAPER]) else bool(within[PAPER] == 1.0)
    return Goal("the paper's claim: SINS/DR stays below 10 m in the outage", 'always', text, met)


def _honest(runs: Runs, entry: str) -> Goal:
    """Return whether position and velocity are within 2 sigma as often as they should."""
    shares = [
        runs.mean(entry, f'{place}.{name}')
        for place in PLACES
        for name in ('inside_2_sigma', 'velocity_inside_2_sigma')
    ]
    nees = [
        runs.mean(entry, f'{place}.nees_{name}_over_3')
        for place in PLACES
        for name in ('position', 'velocity')
    ]
    shown = ', '.join(f'{share:.1%}' for share in shares)
    text = f'{shown} (NEES / 3: {", ".join(f"{value:.2f}" for value in nees)})'
    known = not np.isnan(shares).any()
    met = all(LEAST <= share <= MOST_INSIDE for share in shares) if known else None
    what = f'{entry}: position and velocity inside 2 sigma, with fixes; in the outage'
    return Goal(what, '92 to 98 %', text, met)


def _wrong_map(runs: Runs) -> Goal:
    """Return whether a map 3 m off ever makes sigma lie: root of NEES / 3, also of one outage."""
    lies = {
        where: np.sqrt(runs.mean(MAP, f'{place}.nees_position_over_3'))
        for place, where in PLACES.items()
    }
    worst = np.sqrt(runs.worst(MAP, 'outage.nees_position_over_3'))
    text = ', '.join(f'{lie:.2f} {where}' for where, lie in lies.items())
    text += f'; in the worst outage {worst:.2f}; outage maximum {runs.median(MAP, MOST):.2f} / '
    text += f'{runs.p95(MAP, MOST):.2f} m'
    known = not np.isnan(list(lies.values())).any()
    met = all(lie <= FACTOR for lie in (*lies.values(), worst)) if known else None
    return Goal('map 3 m off: error over sigma, rms, and of the worst outage', '<= 2', text, met)


def _fast(exam: Exam) -> Goal:
    times = {case: runs.times_real_time(ROBUST) for case, runs in exam.items() if runs.all}
    known = {case: value for case, value in times.items() if not np.isnan(value)}
    text = ', '.join(f'{case} {value:.0f}' for case, value in known.items())
    met = min(known.values()) >= FAST if known else None
    return Goal('robust at 100 Hz: times real time, median', f'>= {FAST:g}', text, met)

"""The goals of the maglev, each with what it asks, what was measured, and whether met."""

from __future__ import annotations

import numpy as np

from track_localization.cli.goals import Goal, at_most
from track_localization.cli.maglev.reproduce_runs import (
    DEAD,
    FAULTS,
    LINE,
    MISSED,
    MULTI_MODAL,
    PAPER,
)
from track_localization.cli.maglev.reproduce_tables import (
    INSIDE,
    MOST,
    NEES,
    RMSE,
    SINCE,
    Exam,
    judged_by,
    lost,
    medians,
    ratio,
    recovered,
)

NO_WORSE, PAPERS_M = 1.05, 10.0
FAST = 100.0


def goals(exam: Exam) -> list[Goal]:
    """Return every goal that is measured here."""
    return [*_paper(exam), *_missed(exam), *_line(exam), *_beside_kalman(exam), *_dead(exam)]


def _paper(exam: Exam) -> list[Goal]:
    runs, out = exam[PAPER], []
    best = runs.pooled('optimal', RMSE)
    for name, particles, limit in (('paper_1000', 1000, 1.03), ('paper_10000', 10000, 1.005)):
        place = runs.pooled(name, RMSE)
        over = place / best
        text = f'{over:.4f} ({place:.4f} over {best:.4f} m, {len(runs.all)} runs)'
        what = f"paper scenario, N = {particles}: RMSE over the optimal Kalman filter's"
        out.append(Goal(what, f'<= {limit}', text, at_most(over, limit)))
    count = {name: lost(runs, name) for name in ('paper_1000', 'paper_10000')}
    run = [name for name in count if len(runs.values(name, MOST))]
    text = ', '.join(f'{count[name]} of {len(runs.values(name, MOST))} ({name})' for name in run)
    met = not any(count[name] for name in run) if run else None
    return [*out, Goal('the same: runs lost', 'none', text, met)]


def _missed(exam: Exam) -> list[Goal]:
    runs = exam[MISSED]
    alone, rmse = runs.median('paper_alone', MOST), runs.pooled('robust', SINCE + RMSE)
    worst, below = runs.worst('robust', SINCE + MOST), runs.share('robust', SINCE + MOST, 1.0)
    told, best = (runs.share(name, SINCE + MOST, 1.0) for name in ('robust_told', 'linear'))
    met = None if np.isnan(alone) else bool(0.5 * PAPERS_M <= alone <= 2.0 * PAPERS_M)
    return [
        Goal(
            'loop as a counter, without balises: greatest error of paper, median over runs',
            "the paper's 10 m (5 to 20)",
            f'{alone:.1f} m',
            met,
        ),
        Goal(
            'the same with balises: errors of robust from the first balise on, every run',
            '< 1 m',
            f'worst {worst:.2f} m; below 1 m in {below:.1%} of the runs, RMSE {rmse:.2f} m (told '
            f'more {told:.1%}; the best linear filter, told everything, {best:.1%})',
            None if np.isnan(worst) else worst < 1.0,
        ),
    ]


def _line(exam: Exam) -> list[Goal]:
    runs = exam[LINE]
    median, worst = runs.median('robust', RMSE), runs.worst('robust', RMSE)
    inside, nees = runs.mean('robust', INSIDE), runs.mean('robust', NEES)
    later, later_nees = (runs.mean('robust', SINCE + figure) for figure in (INSIDE, NEES))
    least = runs.values('robust', INSIDE)
    fast = runs.times_real_time('robust')
    lowest = f', the least of a run {least.min():.1%}' if len(least) else ''
    return [
        Goal('line: RMSE of robust, median', '<= 0.25 m', f'{median:.3f} m', at_most(median, 0.25)),
        Goal('line: RMSE of robust, worst run', '<= 0.6 m', f'{worst:.3f} m', at_most(worst, 0.6)),
        Goal(
            'line: errors of robust inside 2 sigma',
            '92 to 98 %',
            f'{inside:.1%} (NEES {nees:.2f}{lowest}); '
            f'after a balise {later:.1%}, NEES {later_nees:.2f}',
            None if np.isnan(inside) else bool(0.92 <= inside <= 0.98),
        ),
        Goal(
            'line: robust, times real time, median',
            f'>= {FAST:g}',
            f'{fast:.0f}',
            None if np.isnan(fast) else fast >= FAST,
        ),
    ]


def _beside_kalman(exam: Exam) -> list[Goal]:
    found = {case: ratio(exam[case], medians(case)) for case in (LINE, *FAULTS)}
    ratios = {case: value for case, value in found.items() if not np.isnan(value)}
    where = max(ratios, key=lambda case: ratios[case], default='')
    several = {case: found[case] for case in MULTI_MODAL if case in ratios}
    shown = ', '.join(f'{case} {value:.2f}' for case, value in several.items())
    runs = [(case, exam[case]) for case in several]
    tails = ', '.join(
        f'{r.worst("robust", judged_by(c)):.2f} against {r.worst("kalman", judged_by(c)):.2f} m'
        for c, r in runs
    )
    return [
        Goal(
            'robust over kalman, medians of the RMSE, any scenario',
            f'<= {NO_WORSE}',
            f'{ratios[where]:.2f} at worst ({where})' if ratios else '',
            ratios[where] <= NO_WORSE if ratios else None,
        ),
        Goal(
            'the same where posteriors have several modes',
            'better',
            f'{shown}; worst runs {tails}',
            all(value < 1.0 for value in several.values()) if several else None,
        ),
    ]


def _dead(exam: Exam) -> list[Goal]:
    out = []
    for case in DEAD:
        runs = exam[case]
        most = runs.values('robust', 'outage.most_sigmas')
        share = runs.mean('robust', 'outage.share_inside')
        text = (
            f'{int((most <= 3.0).sum())} of {len(most)} runs always, {share:.2%} of the time, '
            f'{most.max() if len(most) else 0.0:.1f} sigma at most'
        )
        met = bool((most <= 3.0).all()) if len(most) else None
        out.append(Goal(f'{case}: inside 3 sigma while dead', 'always', text, met))
        found = recovered(runs, 'robust')
        text = f'{int(found.sum())} of {len(found)} runs'
        met = bool(found.all()) if len(found) else None
        out.append(Goal(f'{case}: found again after one balise', 'every run', text, met))
    return out

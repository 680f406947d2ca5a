"""The goals of the track filter, each with what it asks, what was measured, and whether met."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from track_localization.cli.coaster.reproduce_goals import MARKERS, NAN, Rides
from track_localization.cli.coaster.reproduce_rides import Ride
from track_localization.cli.goals import Goal, at_most
from track_localization.cli.kept import Figures

LIVE, SMOOTHED = 'track_filter', 'track_filter_smoothed'
POSITION = 'position_m.mean'
LOST_M = 5.0
"""A ride whose live error is beyond this in the mean is lost [m]."""
MOUNTS = ('mount8', 'mount20', 'mount90', 'mountany')


@dataclasses.dataclass(frozen=True)
class Starts:
    """Starts during rides: of each, the figures that ``reproduce_midride`` gives."""

    all: list[Figures]

    @property
    def told(self) -> list[Figures]:
        """Those that saw two elements."""
        return [start for start in self.all if start['told'] == 1.0]

    def share(self, figure: str) -> float:
        """Return the mean of a figure over the starts that have it; NaN without any."""
        values = self._values(figure)
        return float(np.mean(values)) if values else NAN

    def median(self, figure: str) -> float:
        """Return the median of a figure; NaN without any."""
        values = self._values(figure)
        return float(np.median(values)) if values else NAN

    def per_time(self, figure: str, duration: str) -> float:
        """Return a figure's sum over that of a duration; NaN where there is none."""
        total = sum(self._values(duration))
        return sum(self._values(figure)) / total if total > 0.0 else NAN

    def _values(self, figure: str) -> list[float]:
        return [float(start[figure]) for start in self.all if figure in start]


@dataclasses.dataclass(frozen=True)
class Exam:
    """
    All rides of the exam, those that failed included.

    Attributes:
        nominal: with the errors a usual ride has.
        scenarios: others, by scenario.
        mid_ride: those met under way.
    """

    nominal: Sequence[Ride]
    scenarios: Mapping[str, Sequence[Ride]]
    mid_ride: Sequence[Ride]

    @staticmethod
    def simulated(rides: Sequence[Ride]) -> list[Ride]:
        """Return those that there was a recording of."""
        return [ride for ride in rides if 'mount_deg' in ride.about]

    @classmethod
    def lost(cls, rides: Sequence[Ride]) -> int:
        """Return how many are lost: beyond LOST_M in the mean, live, or without a result."""
        errors = [r.methods.get(LIVE, {}).get(POSITION) for r in cls.simulated(rides)]
        return sum(not (isinstance(e, float) and e <= LOST_M) for e in errors)

    @staticmethod
    def starts(rides: Sequence[Ride]) -> Starts:
        """Return the starts of rides met under way."""
        return Starts([entry for ride in rides for entry in ride.methods.values()])


def track_goals(exam: Exam) -> list[Goal]:
    """Return every goal that is measured here."""
    return [*_accuracy(exam), *_consistency(exam), *_cost(exam), *_hard(exam), *_mid_ride(exam)]


def _accuracy(exam: Exam) -> list[Goal]:
    rides = Rides(exam.nominal)
    floor = rides.about(f'floor.{MARKERS}')
    beside = f'; the floor {floor.mean():.3f}' if len(floor) else ''
    out = []
    for method, name, limit in ((LIVE, 'live', 0.09), (SMOOTHED, 'smoothed', 0.06)):
        ours, truth = rides.mean(method), rides.mean(method, 'markers_truth_m.mean')
        text = f'{ours:.3f} m (against the built truth {truth:.3f}{beside})'
        what = f'markers, {name}, mean over rides'
        out.append(Goal(what, f'<= {limit} m', text, at_most(ours, limit)))
    for method, name, limit in ((LIVE, 'live', 0.35), (SMOOTHED, 'smoothed', 0.13)):
        ours = rides.mean(method, POSITION)
        what = f'moving ride, {name}, mean over rides'
        out.append(Goal(what, f'<= {limit} m', f'{ours:.3f} m', at_most(ours, limit)))
    return [*out, _worst(exam)]


def _worst(exam: Exam) -> Goal:
    """Return the goal of the worst ride; one without a result is worse than any."""
    simulated = exam.simulated(exam.nominal)
    found = [(r.methods.get(LIVE, {}).get(POSITION), r) for r in simulated]
    errors = [(e, f'{r.track} {r.seed}') for e, r in found if isinstance(e, float)]
    missing = len(simulated) - len(errors)
    worst, where = max(errors, default=(NAN, ''))
    met = at_most(worst, 1.3)
    text = f'{worst:.3f} m ({where})'
    if missing:
        text, met = f'{text}, and {missing} without a result', False
    return Goal("worst ride, live, the ride's mean", '<= 1.3 m', text, met)


def _consistency(exam: Exam) -> list[Goal]:
    rides = Rides(exam.nominal)
    out = []
    for method, name in ((LIVE, 'live'), (SMOOTHED, 'smoothed')):
        inside = rides.mean(method, 'inside_2_sigma')
        what = f'inside 2 sigma, {name}, mean over rides'
        met = None if np.isnan(inside) else bool(0.92 <= inside <= 0.98)
        out.append(Goal(what, '92 to 98 %', f'{100.0 * inside:.1f} %', met))
    for method, name in ((LIVE, 'live'), (SMOOTHED, 'smoothed')):
        figure = 'nees_position_over_3'
        nees = rides.mean(method, figure)
        text = f'{nees:.2f} (median {rides.median(method, figure):.2f})'
        met = None if np.isnan(nees) else bool(0.5 <= nees <= 1.5)
        what = f'NEES of the position / 3, {name}, mean over rides'
        out.append(Goal(what, '0.5 to 1.5', text, met))
    return out


def _cost(exam: Exam) -> list[Goal]:
    seconds = Rides(exam.nominal).values(SMOOTHED, 'real_time_factor')
    times = 1.0 / float(np.median(seconds)) if len(seconds) else NAN
    slowest = 1.0 / float(np.max(seconds)) if len(seconds) else NAN
    return [
        Goal(
            'offline, filter and smoothing, median over rides',
            '>= 300 x real time',
            f'{times:.0f} (the slowest {slowest:.0f})',
            None if np.isnan(times) else times >= 300.0,
        )
    ]


def _hard(exam: Exam) -> list[Goal]:
    out = []
    for name in MOUNTS:
        rides = Rides(exam.scenarios.get(name, []))
        smoothed, live = rides.mean(SMOOTHED), rides.mean(LIVE, 'markers_after_element_m.mean')
        what = f'{name}: smoothed at markers, mean over rides'
        out.append(Goal(what, '<= 0.08 m', f'{smoothed:.3f} m', at_most(smoothed, 0.08)))
        what = f'{name}: live at markers after the first element'
        out.append(Goal(what, '<= 0.15 m', f'{live:.3f} m', at_most(live, 0.15)))
    lost = {name: exam.lost(rides) for name, rides in exam.scenarios.items()}
    count = sum(len(exam.simulated(rides)) for rides in exam.scenarios.values())
    which = ', '.join(f'{name} {n}' for name, n in lost.items() if n)
    text = f'{sum(lost.values())} of {count}' + (f': {which}' if which else '')
    met = not any(lost.values()) if count else None
    return [*out, Goal('rides lost, all scenarios', 'none', text, met)]


def _mid_ride(exam: Exam) -> list[Goal]:
    starts = exam.starts(exam.mid_ride)
    near, after, ever = (starts.share(f) for f in ('near', 'wrong_after', 'wrong_ever'))
    of = f'of {len(starts.told)} starts that saw two elements, {len(starts.all)} in all'
    return [
        Goal(
            'start during the ride: within 1 m after two elements',
            '>= 95 %',
            f'{100.0 * near:.1f} % {of}',
            None if np.isnan(near) else near >= 0.95,
        ),
        Goal(
            'the same: a confident wrong answer then or later',
            '<= 1 %',
            f'{100.0 * after:.1f} % of {len(starts.told)}',
            at_most(after, 0.01),
        ),
        Goal(
            'the same: at any time',
            '<= 1 %',
            f'{100.0 * ever:.1f} % of {len(starts.all)}',
            at_most(ever, 0.01),
        ),
    ]

"""
What a railway's shape tells the train's error state: on a straight the course does not change.

Railway lines are set out as straights and curves with transitions between. That a stretch is
straight the gyros show, for a curve turns a train a hundred times as fast as they drift; and if it
is, their drift over it is seen and undone. Every ``mark_m`` of way the train is marked: its mean
course since the mark before becomes a state of its own (stochastic cloning: Roumeliotis and
Burdick, ICRA 2002), to be judged two marks later, when it is known that the train was not about to
turn. A mean, as rails are not even: it is the direction of the chord.

A straight follows the Earth (a geodesic): against north it turns as the meridians do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization.estimation.sequential import update
from train_localization.config import StraightConfig
from train_localization.kernels import COURSE, EARLIER, LINE, MEAN, SIZE, give, rotation

Array = NDArray[np.float64]

CONSISTENT = 9.0
"""Greatest NIS of a course that is as it was."""
BESIDE = 2
"""So many chords before and behind one lie in line with it if it is one of a straight."""
REFUTED = 20
"""
Where a straight turns out to be none without a turn, its chords before have been held wrongly: so
many more must lie in line before it is believed again.
"""
NOTHING, NEXT, FIRST = 0, 1, 2


class Marks(NamedTuple):
    """
    Where the train has been marked.

    Attributes:
        way_m: since the last mark [m]; infinite before the first.
        longitude: of the last mark [rad].
        convergence: by so much a straight has turned against north, in all [rad].
        reference: the mean course since the last mark is told from here [rad].
        straights: chords in a row, the last one included, in line with the one before.
        anchored: whether the course of the straight is known.
        due: what the next prediction does: nothing, mark the train, or begin a straight as well.
        marked_m: way between the mark that is due and the one before [m].
    """

    way_m: float = math.inf
    longitude: float = math.nan
    convergence: float = 0.0
    reference: float = 0.0
    straights: int = 0
    anchored: bool = False
    due: int = NOTHING
    marked_m: float = math.inf


def carry(
    nav: Array, aux: Array, P: Array, marks: Marks, way_m: float, R: float, Phi: Array
) -> Marks:
    """
    Mark the train if that is due, and add ``way_m`` at its course to the mean, in place.

    ``R`` is the variance of a chord's course about that of the straight [rad^2]. ``Phi`` (27, 27),
    the identity before, becomes the transition that this is.
    """
    if marks.due:
        _mark(aux, marks.reference, marks.marked_m, marks.due == FIRST, Phi)
        P[:] = Phi @ P @ Phi.T
        P[LINE, LINE] += R if marks.due == FIRST else 0.0
        marks = marks._replace(due=NOTHING, reference=float(aux[COURSE - 9]))
    _lean(nav, aux, P, marks.reference + marks.convergence, way_m, Phi)
    return marks._replace(way_m=marks.way_m + way_m)


def tell(nav: Array, aux: Array, P: Array, marks: Marks, config: StraightConfig) -> Marks:
    """Judge the chord before the last if the train is due for a mark; update in place."""
    longitude, way_m = float(nav[1]), marks.way_m
    if way_m < config.mark_m:
        return marks
    if math.isinf(way_m):
        return Marks(0.0, longitude, reference=course(nav, np.zeros(SIZE)), straights=-1, due=NEXT)
    east = math.remainder(longitude - marks.longitude, 2.0 * math.pi)
    turn = most_turned(aux, P, marks.reference, way_m, config.course_sigma_rad**2)
    straights = marks.straights + 1 if turn < way_m / config.greatest_radius_m else 0
    anchored, due = marks.anchored and straights > 0, NEXT
    if straights > 2 * BESIDE - 1:
        if not anchored:
            anchored, due = True, FIRST
        elif not hold(nav, aux, P, config.course_sigma_rad**2):
            anchored, straights = False, -REFUTED
    return Marks(
        way_m=0.0,
        longitude=longitude,
        convergence=marks.convergence - east * math.sin(nav[0]),
        reference=marks.reference,
        straights=straights,
        anchored=anchored,
        due=due,
        marked_m=way_m,
    )


@njit(cache=True)
def course(nav: Array, h: Array) -> float:
    """Return the course of the IMU's first axis, from east to north [rad]; add its row to ``h``."""
    R = rotation(nav)
    level2 = R[0, 0] ** 2 + R[1, 0] ** 2
    h[7] += (R[1, 0] * R[0, 2] - R[0, 0] * R[1, 2]) / level2
    h[8] += (R[0, 0] * R[1, 1] - R[1, 0] * R[0, 1]) / level2
    return math.atan2(R[1, 0], R[0, 0])


@njit(cache=True)
def _mark(aux: Array, reference: float, way_m: float, first: bool, F: Array) -> None:
    """Keep the mean course, in place, and make of ``F``, I before, the transition that this is."""
    if first:
        aux[LINE - 9] = aux[EARLIER - 9]
        F[LINE, LINE], F[LINE, EARLIER] = 0.0, 1.0
    F[EARLIER, EARLIER], F[EARLIER, COURSE] = 0.0, 1.0
    F[COURSE, COURSE], F[COURSE, MEAN], F[MEAN, MEAN] = 0.0, 1.0 / way_m, 0.0
    aux[EARLIER - 9] = aux[COURSE - 9]
    aux[COURSE - 9] = reference + aux[MEAN - 9] / way_m
    aux[MEAN - 9] = 0.0


@njit(cache=True)
def _lean(nav: Array, aux: Array, P: Array, reference: float, way_m: float, F: Array) -> None:
    """Add a way at the course it has against ``reference`` to the mean, in place; see ``carry``."""
    h = np.zeros(SIZE)
    aux[MEAN - 9] += way_m * wrapped(course(nav, h) - reference)
    added = np.zeros(SIZE)
    for k in range(6, 9):
        F[MEAN, k] += way_m * h[k]
        for j in range(SIZE):
            added[j] += way_m * h[k] * P[k, j]
    corner = 0.0
    for k in range(6, 9):
        corner += way_m * h[k] * added[k]
    for j in range(SIZE):
        P[MEAN, j] += added[j]
        P[j, MEAN] += added[j]
    P[MEAN, MEAN] += corner


@njit(cache=True)
def most_turned(aux: Array, P: Array, reference: float, way_m: float, R: float) -> float:
    """
    Return by how much the mean course may have changed, 2 sigma [rad]; infinite if it is known to.

    Between the stretch up to the last mark and that since, of ``way_m`` [m]. ``R`` is the variance
    of a stretch's course about that of the straight [rad^2].
    """
    change = abs(wrapped(reference + aux[MEAN - 9] / way_m - aux[COURSE - 9]))
    S = P[MEAN, MEAN] / way_m**2 - 2.0 * P[MEAN, COURSE] / way_m + P[COURSE, COURSE]
    if not change * change <= CONSISTENT * (S + 2.0 * R):
        return math.inf
    return change + 2.0 * math.sqrt(max(S, 0.0))


@njit(cache=True)
def hold(nav: Array, aux: Array, P: Array, R: float) -> bool:
    """
    Tell that the course before the last mark was the straight's, variance ``R`` [rad^2], in place.

    Return whether that may be: where it is unlikely nothing is done.
    """
    nu = -wrapped(aux[EARLIER - 9] - aux[LINE - 9])
    S = P[EARLIER, EARLIER] - 2.0 * P[EARLIER, LINE] + P[LINE, LINE] + R
    if not nu * nu <= CONSISTENT * S:
        return False
    dx, h = np.zeros(SIZE), np.zeros(SIZE)
    h[EARLIER], h[LINE] = 1.0, -1.0
    update(P, h, R, nu, dx)
    give(nav, aux, dx)
    return True


@njit(cache=True)
def wrapped(angle: float) -> float:
    """Return an angle within pi of zero [rad]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))

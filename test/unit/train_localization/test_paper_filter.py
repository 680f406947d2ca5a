"""The paper's filter: its fading factor and its dead reckoning, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from track_localization.estimation import so3
from track_localization.estimation.earth import gravity
from train_localization import paper_filter
from train_localization.alignment import start_at
from train_localization.config import TrainConfig
from train_localization.kernels import moved
from train_localization.measurements import GnssFix, WheelSpeed
from train_localization.paper_filter import PaperFilter
from train_localization.state import Fix, Stretch

LATITUDE, V = 0.7, 50.0
H = np.array([1.0, 0.0])


def faded(nu, V, R=1.0, limit=math.inf):
    """Return V and the first variance after the factor, for a variance of 4 before."""
    P = np.diag([4.0, 9.0])
    after = paper_filter.fade(P, H, R, nu, V, limit)
    assert P[1, 1] == pytest.approx(9.0 / 4.0 * P[0, 0])
    return after, P[0, 0]


def test_the_first_innovation_begins_its_variance():
    """V = nu^2 = 36: lambda = (36 - 1) / 4."""
    assert faded(6.0, math.nan) == pytest.approx((36.0, 35.0))


def test_later_innovations_are_averaged_as_in_eq_6():
    """V = (0.95 x 10 + 36) / 1.95 = 23.33: the variance becomes V - R."""
    V = (9.5 + 36.0) / 1.95
    assert faded(6.0, 10.0) == pytest.approx((V, V - 1.0))


def test_small_innovations_do_not_fade():
    assert faded(1.0, 2.0)[1] == 4.0


def test_the_factor_has_a_limit():
    assert faded(60.0, math.nan, limit=1.05)[1] == pytest.approx(4.2)


def north(t, stamps):
    """Return a stretch of level motion northward without turning, from ``t`` on [s]."""
    force = np.array([0.0, 0.0, gravity(LATITUDE, 0.0)])
    n = len(stamps)
    return Stretch(stamps[-1], np.array(stamps), np.zeros((n, 3)), np.tile(force, (n, 1)))


def test_dead_reckoning_goes_on_from_the_last_odometer_reading():
    """Readings at 0.1 and 0.2 s, a fix at 0.17 s: of 50 m/s nothing is counted twice."""
    filter_ = PaperFilter(TrainConfig())
    geodetic = np.array([LATITUDE, 0.3, 0.0])
    state = filter_.start(
        start_at(0.0, geodetic, so3.matrix_from_rpy(0.0, 0.0, np.pi / 2), np.eye(6) * 1e-4, V, 0.1)
    )
    for heard in (
        north(0.0, [0.05, 0.1]),
        WheelSpeed(0.1, V, 0.01),
        north(0.1, [0.15, 0.17]),
        Fix(0.17, GnssFix(0.17, *moved(geodetic, np.array([0.0, 0.17 * V, 0.0])), np.eye(3)), 3),
        north(0.17, [0.2]),
        WheelSpeed(0.2, V, 0.01),
    ):
        state = filter_.apply(state, heard)
    # Forces of a moving Earth, 1e-2 m/s^2, are all that differs.
    assert np.abs(state.aux[6:9]).max() < 0.01

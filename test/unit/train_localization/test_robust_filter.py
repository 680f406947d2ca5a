"""The robust filter, told measurement after measurement; what it is told is made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from track_localization.estimation import so3
from track_localization.estimation.earth import earth_rate, gravity, transport_rate
from track_localization.settings import override
from train_localization.alignment import start_at
from train_localization.config import TrainConfig
from train_localization.kernels import SLOW, apart, moved
from train_localization.measurements import GnssFix, WheelSpeed
from train_localization.robust_filter import RobustFilter
from train_localization.state import Fix, Stretch

LATITUDE, V, EPOCH_S = 0.7, 50.0, 0.1
BEGIN = np.array([LATITUDE, 0.3, 0.0])


def drive(seconds, off_m, sigma_m, believed=V):
    """
    Drive north with a fix a second, all ``off_m`` east; return error east and sigma [m].

    Where the filter is sure of a speed that it does not have, return the error north instead.
    """
    sure = {'imu.grade': 'navigation', 'wheel.mounting_sigma_deg': 0.0}
    filter_ = RobustFilter(override(TrainConfig(), sure))
    covariance = np.diag([0.25, 0.25, 0.25, 1e-8, 1e-8, 1e-8])
    R_nb = so3.matrix_from_rpy(0.0, 0.0, np.pi / 2)
    state = filter_.start(start_at(0.0, BEGIN, R_nb, covariance, believed, 0.1))
    if believed != V:
        state = state._replace(began_s=-60.0)
    earth, transport = np.empty(3), np.empty(3)
    earth_rate(LATITUDE, earth)
    transport_rate(state.nav, transport)
    falling = np.array([0.0, 0.0, gravity(LATITUDE, 0.0)])
    force = R_nb.T @ (falling + np.cross(2.0 * earth + transport, [0.0, V, 0.0]))
    turn = R_nb.T @ (earth + transport)
    for k in range(1, round(seconds / EPOCH_S) + 1):
        t = k * EPOCH_S
        stamps = t - EPOCH_S + EPOCH_S * np.arange(1, 11) / 10
        stretch = Stretch(t, stamps, np.tile(turn, (10, 1)), np.tile(force, (10, 1)))
        for heard in (stretch, WheelSpeed(t, V, 0.01)):
            state = filter_.apply(state, heard)
        if k % 10 == 0:
            place = moved(BEGIN, np.array([off_m, V * t, 0.0]))
            fix = GnssFix(t, *place, np.eye(3) * sigma_m**2)
            state = filter_.apply(state, Fix(t, fix, 3))
    error = -apart(state.nav, *moved(BEGIN, np.array([0.0, V * seconds, 0.0])))
    axis = 0 if believed == V else 1
    return error[axis], np.sqrt(state.P[axis, axis])


def test_fixes_that_claim_much_do_not_carry_the_train_away():
    """Half a minute of them, 4 m off and claiming 3: they err alike, and are no 30 witnesses."""
    error, sigma = drive(30.0, 4.0, 3.0)
    assert error < 2.0
    assert error < 2.5 * sigma


def test_usual_fixes_are_followed_as_far_as_their_slow_error_lets():
    """0.5 m known at the start and 0.8 m of slow error share 1 m as their variances."""
    error, sigma = drive(30.0, 1.0, 0.85)
    share = 0.25 / (0.25 + 0.64)
    assert error == pytest.approx(share, abs=0.25)
    assert sigma == pytest.approx(0.8 * np.sqrt(share), abs=0.15)


def told_by(sigma_m):
    """Return the variance east of place and slow error together after one fix claiming so much."""
    filter_ = RobustFilter(TrainConfig())
    covariance = np.diag([100.0**2] * 3 + [1e-6] * 3)
    R_nb = so3.matrix_from_rpy(0.0, 0.0, np.pi / 2)
    state = filter_.start(start_at(0.0, BEGIN, R_nb, covariance, V, 0.1))
    fix = GnssFix(0.0, *BEGIN, np.eye(3) * sigma_m**2)
    P = filter_.apply(state, Fix(0.0, fix, 3)).P
    return P[0, 0] + 2.0 * P[0, SLOW] + P[SLOW, SLOW]


def test_a_fix_that_claims_a_little_more_counts_by_its_white_part():
    """At HDOP 1.2 sigma is 1.02 m instead of 0.85: 0.4 of it is white, and tells the course."""
    assert told_by(1.02) == pytest.approx((0.4 * 1.02) ** 2, rel=0.01)
    assert told_by(3.0) > 3.0**2


@pytest.mark.parametrize('seconds', [7.0, 20.0])
def test_a_filter_against_which_fixes_and_odometer_agree_gives_in(seconds):
    """It is sure to be 8 m/s faster: after 7 s that would be 56 m; four fixes are refused."""
    error, sigma = drive(seconds, 0.0, 0.85, believed=V + 8.0)
    assert abs(error) < 3.0
    assert abs(error) < 3.0 * sigma

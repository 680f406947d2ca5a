"""A line more crooked than the settings say: noticed, and the claims widened for it."""

import numpy as np
import pytest

from coaster_localization.config import CoasterConfig
from coaster_localization.methods import run_methods
from coaster_localization.track_crooked import PRIOR_COUNT, USUAL_NIS, Crookedness
from track_localization.sim.coaster import scenario, simulate_coaster


def told(values, speed=10.0, sigma=0.1):
    crooked = Crookedness()
    for value in values:
        crooked.push(np.full(3, value), speed, sigma)
    return crooked.factor


def test_a_line_as_expected_changes_nothing():
    assert told([]) == told(np.full(5000, USUAL_NIS)) == told(np.zeros(5000)) == 1.0


def test_a_poor_fit_counts_by_its_mean_and_slowly():
    assert told(np.full(PRIOR_COUNT, 3.0 * USUAL_NIS)) == pytest.approx(2.0)
    assert told(np.full(100 * PRIOR_COUNT, 3.0 * USUAL_NIS)) == pytest.approx(3.0, rel=0.02)


def test_a_stray_comparison_counts_little():
    assert told([1e9]) < 1.3


def test_what_is_told_at_rest_or_in_doubt_does_not_count():
    assert told(np.full(5000, 9.0), speed=0.0) == told(np.full(5000, 9.0), sigma=5.0) == 1.0


def test_a_track_three_times_as_crooked_is_covered():
    """Cross-track deviations included, which no sensor on board can tell."""
    ride = simulate_coaster('wooden', scenario('track3'), 9)
    most = {'track_filter': 3.0, 'track_filter_smoothed': 2.0}
    for result in run_methods(ride.imu, ride.design, CoasterConfig(), list(most)):
        out = result.trajectory
        truth = np.stack(
            [np.interp(out.time_s, ride.truth.time_s, p) for p in ride.truth.position.T]
        )
        error = out.position - truth.T
        moves = np.interp(out.time_s, ride.truth.time_s, ride.truth.speed) > 1.0
        nees = np.einsum('ni,nij,nj->n', error, np.linalg.inv(out.covariance), error)[moves]
        # 5 and more without it
        assert 0.4 < nees.mean() / 3.0 < most[result.name]

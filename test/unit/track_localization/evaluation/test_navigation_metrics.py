"""Figures of a passage through an outage, on errors that are given."""

import numpy as np
import pytest

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.navigation_metrics import (
    error_of_latest,
    navigation_errors,
    navigation_figures,
)

OUTAGE = (40.0, 60.0)
SPEED = 30.0


@pytest.fixture
def truth():
    """Return 100 s to the north at 30 m/s, after which the train stands for 10 s."""
    t = np.arange(0.0, 110.0, 0.1)
    y = SPEED * np.minimum(t, 100.0)
    position = np.stack([0.0 * t, y, 0.0 * t], axis=1)
    velocity = np.stack([0.0 * t, SPEED * (t < 100.0), 0.0 * t], axis=1)
    return Trajectory(t, position, velocity=velocity, chainage=y, speed=velocity[:, 1])


def estimate(truth, east=0.0, north=0.0, up=0.0, sigma=1.0):
    """Return an estimate once a second that is off by metres (N,) of the truth's epochs."""
    off = np.stack(np.broadcast_arrays(east, north, up, 0.0 * truth.time_s)[:3], axis=1)
    found = Trajectory(
        truth.time_s,
        truth.position + off,
        velocity=truth.velocity + np.array([0.0, 0.3, 0.0]),
        covariance=np.tile(sigma**2 * np.eye(3), (len(truth), 1, 1)),
    )
    return found[::10]


def figures(truth, **off):
    found = estimate(truth, **off)
    V = np.tile(0.01 * np.eye(3), (len(found), 1, 1))
    return navigation_figures(navigation_errors(found, V, truth), [OUTAGE])


def test_an_outage_is_told_by_entry_maximum_and_end(truth):
    """3 m to the left growing from 1 m at the entry, 4 m ahead at the end: 5 m there."""
    share = np.clip((truth.time_s - 40.0) / 19.0, 0.0, 1.0)
    inside = (truth.time_s >= 40.0) & (truth.time_s < 60.0)
    east = np.where(inside, -1.0 - 2.0 * share, -1.0)
    north = np.where(inside, 4.0 * share, 0.0)
    found = figures(truth, east=east, north=north, up=7.0)
    (passage,) = found['outages']
    assert (passage['from_s'], passage['to_s']) == OUTAGE
    assert passage['entry_m'] == pytest.approx(1.0)
    assert passage['max_m'] == pytest.approx(5.0)
    assert passage['end_m'] == pytest.approx(5.0)
    assert passage['along_end_m'] == pytest.approx(4.0)
    assert passage['cross_end_m'] == pytest.approx(3.0)
    assert passage['sigma_end_m'] == pytest.approx(1.0)
    assert passage['most_sigmas'] == pytest.approx(5.0)
    assert found['horizontal_m']['median'] == pytest.approx(1.0)
    assert found['horizontal_m']['max'] == pytest.approx(5.0)
    assert found['open_sky']['horizontal_m']['max'] == pytest.approx(1.0)
    assert found['up_m']['median'] == pytest.approx(7.0)
    assert found['speed_mps']['median'] == pytest.approx(0.3)


def test_honesty_is_judged_by_component_and_by_nees(truth):
    """East is at 3 sigma, north and up at 1: two thirds inside, NEES 11; velocity at 3 sigma."""
    found = figures(truth, east=3.0, north=1.0, up=-1.0)
    for part in (found, found['open_sky'], found['outage']):
        assert part['inside_2_sigma'] == pytest.approx(2.0 / 3.0)
        assert part['nees_mean'] == pytest.approx(11.0)
        assert part['nees_position_over_3'] == pytest.approx(11.0 / 3.0)
        assert part['velocity_inside_2_sigma'] == pytest.approx(2.0 / 3.0)
        assert part['nees_velocity_over_3'] == pytest.approx(3.0)


def test_a_standing_train_does_not_count(truth):
    inside = truth.time_s < 99.5
    found = figures(truth, east=np.where(inside, 1.0, 50.0))
    assert found['horizontal_m']['max'] == pytest.approx(1.0)
    assert found['covered'] == pytest.approx(1.0, abs=0.01)


def test_nothing_is_said_of_an_outage_that_the_estimate_does_not_cover(truth):
    late = estimate(truth)
    late = late[late.time_s > 70.0]
    errors = navigation_errors(late, None, truth)
    found = navigation_figures(errors, [OUTAGE])
    assert found['outages'] == []
    assert 'outage' not in found or 'max_m' not in found['outage']
    assert 'nees_velocity_over_3' not in found
    assert found['covered'] == pytest.approx(0.3, abs=0.02)


def test_the_floor_is_the_latest_fix_before(truth):
    times = np.array([38.5, 39.5, 40.5])
    position = np.stack([[3.0, 4.0, 9.0], SPEED * times, 0.0 * times], axis=1)
    assert error_of_latest(times, position, truth, 40.0) == pytest.approx(4.0)
    assert error_of_latest(times, position, truth, 30.0) is None
    assert error_of_latest(times, position, truth, 45.0) is None

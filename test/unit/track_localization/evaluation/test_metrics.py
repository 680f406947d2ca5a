"""Metrics against values worked out by hand."""

import numpy as np
import pytest

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation import metrics
from track_localization.evaluation.interpolation import at_times, speed_of


@pytest.fixture
def truth() -> Trajectory:
    """10 s at rest, then 10 m/s along x for 10 s; sampled at 10 Hz."""
    time = np.arange(201) / 10.0
    x = np.maximum(time - 10.0, 0.0) * 10.0
    position = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    velocity = np.zeros_like(position)
    velocity[time > 10.0, 0] = 10.0
    return Trajectory(time, position, velocity=velocity, chainage=x)


def shifted(truth: Trajectory, offset: tuple[float, float, float]) -> Trajectory:
    return Trajectory(truth.time_s, truth.position + np.array(offset), velocity=truth.velocity)


def test_errors_are_counted_over_the_moving_part_only(truth):
    """1000 m of error at rest does not enter; 5 m = |(3, 0, 4)| while moving does."""
    estimate = shifted(truth, (3.0, 0.0, 4.0))
    estimate.position[truth.time_s <= 10.0] += 1000.0
    figures = metrics.ride_figures(metrics.ride_errors(estimate, truth))
    for name in ('mean', 'median', 'p95', 'max'):
        assert figures['position_m'][name] == pytest.approx(5.0)
    assert len(metrics.ride_errors(estimate, truth).time_s) == 100


def test_along_and_cross_follow_the_direction_of_travel(truth):
    errors = metrics.ride_errors(shifted(truth, (-3.0, 4.0, 12.0)), truth)
    np.testing.assert_allclose(errors.along, -3.0)
    np.testing.assert_allclose(errors.cross, np.hypot(4.0, 12.0))


def test_along_needs_no_velocity(truth):
    """Without velocities the direction and the speed come from the positions."""
    bare = Trajectory(truth.time_s, truth.position)
    errors = metrics.ride_errors(
        Trajectory(truth.time_s, truth.position + np.array([2.0, 1.0, 0.0])), bare
    )
    np.testing.assert_allclose(errors.along, 2.0)
    np.testing.assert_allclose(errors.cross, 1.0)
    np.testing.assert_allclose(speed_of(bare)[-50:], 10.0)


def test_summary_by_hand():
    figures = metrics.summary(np.array([-1.0, 2.0, 3.0, np.nan, -10.0]))
    assert figures['mean'] == pytest.approx(4.0)
    assert figures['median'] == pytest.approx(2.5)
    assert figures['max'] == pytest.approx(10.0)
    assert figures['p95'] == pytest.approx(3.0 + 0.85 * 7.0)  # rank 0.95 * 3 = 2.85
    assert metrics.summary(np.array([np.nan])) == {}


def test_marker_errors_against_design_and_truth(truth):
    estimate = shifted(truth, (1.0, 0.0, 0.0))
    time = np.array([11.05, 15.0, 25.0])
    design = np.array([[10.5, 0.3, 0.0], [50.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    errors = metrics.marker_errors(estimate, time, design, truth)
    np.testing.assert_allclose(errors.design, [np.hypot(1.0, 0.3), 1.0, np.nan])
    np.testing.assert_allclose(errors.truth, [1.0, 1.0, np.nan])
    figures = metrics.marker_figures(metrics.marker_errors(estimate, time, design))
    assert 'markers_truth_m' not in figures
    assert figures['markers_m']['max'] == pytest.approx(np.hypot(1.0, 0.3))


def test_nothing_is_extrapolated_or_read_inside_a_gap(truth):
    early = truth[(truth.time_s < 12.0) | (truth.time_s > 15.0)][:-20]
    there = at_times(early, np.array([-0.1, 11.55, 13.0, 17.0, 19.9]))
    known = np.isfinite(there.position).all(axis=1)
    np.testing.assert_array_equal(known, [False, True, False, True, False])
    assert there.position[1, 0] == pytest.approx(15.5)


def test_covered_tells_the_share_of_the_ride_with_an_estimate(truth):
    errors = metrics.ride_errors(truth[truth.time_s <= 15.0], truth)
    assert errors.covered == pytest.approx(0.5)


def test_chainage_is_not_mixed_across_a_wrap():
    position = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    lap = Trajectory(np.array([0.0, 0.1, 0.2]), position, chainage=np.array([498.5, 499.5, 0.5]))
    there = at_times(lap, np.array([0.05, 0.14, 0.16]))
    np.testing.assert_allclose(there.chainage, [499.0, 499.5, 0.5])


def test_speed_error_uses_the_claimed_speed(truth):
    estimate = Trajectory(truth.time_s, truth.position, speed=np.full(len(truth), 9.0))
    figures = metrics.ride_figures(metrics.ride_errors(estimate, truth))
    assert figures['speed_mps']['mean'] == pytest.approx(1.0)


def test_gross_mismatch_is_measured_with_its_claimed_sigma(truth):
    """A tenth of the moving ride is 20 m off; sigma covers half of that within 3."""
    estimate = shifted(truth, (0.0, 0.0, 0.0))
    wrong = (truth.time_s > 11.0) & (truth.time_s <= 12.0)
    estimate.position[wrong, 0] += 20.0
    sigma = np.where(truth.time_s <= 11.5, 10.0, 1.0)
    estimate = Trajectory(truth.time_s, estimate.position, sigma_along=sigma)
    figures = metrics.ride_figures(metrics.ride_errors(estimate, truth))
    assert figures['gross_share'] == pytest.approx(0.1)
    assert figures['gross_inside_3_sigma'] == pytest.approx(0.5)


def test_what_cannot_be_computed_is_absent(truth):
    figures = metrics.ride_figures(metrics.ride_errors(shifted(truth, (1.0, 0.0, 0.0)), truth))
    assert 'nees_mean' not in figures
    assert 'inside_2_sigma' not in figures
    nested = metrics.present({'a': float('nan'), 'b': {'c': None, 'd': {}}, 'e': 0.0, 'f': [1]})
    assert nested == {'e': 0.0, 'f': [1]}


def test_an_estimate_that_never_overlaps_gives_no_figures(truth):
    late = Trajectory(truth.time_s + 100.0, truth.position)
    assert metrics.ride_figures(metrics.ride_errors(late, truth)) == {'covered': 0.0}

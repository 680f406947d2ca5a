"""Figures of a vehicle on a line against values worked out by hand."""

import numpy as np
import pytest

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.line_metrics import (
    epoch_errors,
    line_figures,
    nees_along,
    since,
    spread,
    standing_errors,
)
from track_localization.evaluation.metrics import ride_errors


def run(time_s: np.ndarray, error: np.ndarray | float = 0.0, sigma: float = 0.5) -> Trajectory:
    """10 s at rest at 100 m, then 1 m/s^2 from 1 m/s on, off by ``error``."""
    moving = np.maximum(time_s - 10.0, 0.0)
    s = 100.0 + moving + 0.5 * moving**2 + error
    speed = np.where(time_s > 10.0, 1.0 + moving, 0.0)
    zero = np.zeros_like(s)
    return Trajectory(
        time_s,
        np.stack([s, zero, zero], axis=1),
        velocity=np.stack([speed, zero, zero], axis=1),
        chainage=s,
        speed=speed,
        sigma_along=np.full(len(s), sigma),
    )


@pytest.fixture
def truth() -> Trajectory:
    return run(np.arange(0.0, 30.001, 0.01))


def test_root_mean_square_by_hand():
    """(9 + 16 + 144) / 3 = 56.33...; the sign of an error does not matter."""
    figures = spread(np.array([-3.0, 4.0, np.nan, -12.0]))
    assert figures['rmse'] == pytest.approx(np.sqrt(169.0 / 3.0))
    assert figures['max'] == pytest.approx(12.0)
    assert spread(np.array([np.nan])) == {}


def test_an_estimate_once_a_second_is_not_blamed_for_the_half_second_between(truth):
    """Between two epochs a straight line is off by a T^2 / 8 = 0.125 m; at them by nothing."""
    estimate = run(np.arange(11.5, 30.0, 1.0))
    assert np.abs(ride_errors(estimate, truth).along).max() == pytest.approx(0.125, abs=0.01)
    errors = epoch_errors(estimate, truth)
    assert len(errors.time_s) == 19
    # The truth's own 100 Hz: a straight line between its stamps is off by 0.01^2 / 8 m.
    assert np.abs(errors.along).max() < 2e-5


def test_figures_of_known_errors(truth):
    """Errors of -0.3 m and 0.4 m in turn with a claimed 0.5 m; only the moving part counts."""
    time = np.arange(0.0, 30.0, 0.05)
    error = np.where(np.arange(len(time)) % 2 == 0, -0.3, 0.4)
    error[time <= 10.0] = 50.0
    figures = line_figures(epoch_errors(run(time, error), truth))
    for name in ('position_m', 'along_m'):
        assert figures[name]['rmse'] == pytest.approx(np.sqrt(0.125), rel=0.01)
        assert figures[name]['mean'] == pytest.approx(0.35, rel=0.01)
        assert figures[name]['max'] == pytest.approx(0.4, rel=1e-3)
    assert figures['nees_mean'] == pytest.approx(0.125 / 0.25, rel=0.01)
    assert figures['inside_2_sigma'] == 1.0
    assert figures['covered'] == pytest.approx(1.0, abs=0.01)
    assert not {'cross_m', 'nees_position_over_3', 'gross_inside_3_sigma'} & set(figures)


def test_errors_at_standstill_stand_apart(truth):
    time = np.arange(0.0, 30.0, 0.05)
    standing = standing_errors(run(time, np.where(time <= 10.0, 50.0, 0.1)), truth)
    assert 199 <= len(standing) <= 201
    np.testing.assert_allclose(standing, 50.0)
    assert len(standing_errors(Trajectory(time, np.zeros((len(time), 3))), truth)) == 0


def test_from_a_time_on(truth):
    time = np.arange(0.0, 30.0, 0.05)
    errors = epoch_errors(run(time, np.where(time < 20.0, 3.0, 0.2)), truth)
    later = since(errors, 20.0)
    assert np.abs(later.along).max() == pytest.approx(0.2, abs=1e-3)
    assert len(later.time_s) == len(later.chainage) == pytest.approx(200, abs=1)
    assert since(errors, 99.0).time_s.size == 0
    assert line_figures(since(errors, 99.0)) == {'covered': errors.covered}


def test_covered_is_the_share_of_the_moving_run(truth):
    """Estimates of seconds 20 to 25 cover a quarter of the 20 s in motion; slow ones all."""
    assert epoch_errors(run(np.arange(20.0, 25.01, 0.05)), truth).covered == pytest.approx(
        0.25, abs=0.01
    )
    assert epoch_errors(run(np.arange(0.0, 31.0, 1.0) + 1e-7), truth).covered > 0.99
    late = epoch_errors(run(np.arange(100.0, 110.0)), truth)
    assert late.covered == 0.0
    assert len(late.time_s) == 0


def test_nees_leaves_out_what_claims_nothing(truth):
    time = np.arange(11.0, 14.0, 1.0)
    estimate = run(time, 0.5)
    estimate.sigma_along[:] = [0.25, 0.0, np.nan]
    np.testing.assert_allclose(nees_along(epoch_errors(estimate, truth)), [4.0], rtol=1e-3)

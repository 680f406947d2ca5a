"""Deviations of the built track: their size, smoothness, and that a circuit still closes."""

import numpy as np
import pytest

from track_localization.sim.coaster.as_built import build, smooth_process


@pytest.mark.parametrize('closed', [True, False])
def test_process_has_unit_variance_and_the_covariance_asked_for(closed):
    """Over 300 draws, lag covariances follow exp(-d^2 / 2 l^2) within their sampling error."""
    rng = np.random.default_rng(11)
    draws = [smooth_process(rng, 400.0, 10.0, closed, 1) for _ in range(300)]
    at = np.array([[p(np.array([100.0 + d]))[0, 0] for d in (0.0, 5.0, 10.0, 20.0)] for p in draws])
    expected = np.exp(-0.5 * (np.array([0.0, 5.0, 10.0, 20.0]) / 10.0) ** 2)
    np.testing.assert_allclose(at.T @ at[:, 0] / 300, expected, atol=0.17)


def test_closed_process_comes_round_smoothly():
    """Value and slope agree across the join."""
    process = smooth_process(np.random.default_rng(1), 300.0, 8.0, True, 2)
    eps = 1e-6
    np.testing.assert_allclose(
        process(np.array([300.0 - eps])), process(np.array([eps])), atol=1e-5
    )
    np.testing.assert_allclose(
        process(np.array([300.0 - eps]), 1), process(np.array([eps]), 1), atol=1e-3
    )


def deviations(seed: int, closed: bool, **change):
    values = {
        'cross_m': 0.01,
        'cross_correlation_m': 8.0,
        'along_m': 0.02,
        'along_correlation_m': 40.0,
        'stretch': 1.2e-4,
        'roll_rad': 0.002,
        **change,
    }
    return build(np.random.default_rng(seed), 800.0, closed, **values)


def test_sizes_are_those_of_the_config():
    """Cross-track 10 mm on both axes, roll 2 mrad, over 60 tracks."""
    s = np.arange(5.0, 795.0, 5.0)
    drawn = [deviations(seed, True) for seed in range(60)]
    cross = np.array([d.cross(s) for d in drawn])
    assert cross.std() == pytest.approx(0.010, rel=0.05)
    assert np.array([d.roll(s) for d in drawn]).std() == pytest.approx(0.002, rel=0.05)


def test_stretch_grows_with_distance_to_either_sign_and_a_circuit_takes_it_back():
    """1.2e-4 of 600 m is 72 mm; the last 15 % of a circuit return to zero."""
    along = [deviations(seed, True, along_m=0.0).along for seed in range(30)]
    mid = np.array([float(a(np.array([600.0]))[0, 0]) for a in along])
    np.testing.assert_allclose(np.abs(mid), 1.2e-4 * 590.0, rtol=1e-2)
    assert {1.0, -1.0} == set(np.sign(mid))
    end = [abs(float(a(np.array([800.0 - 1e-6]))[0, 0])) for a in along]
    assert max(end) < 1e-6
    open_end = deviations(3, False, along_m=0.0).along(np.array([800.0]))
    assert abs(float(open_end[0, 0])) == pytest.approx(1.2e-4 * 790.0, rel=1e-2)


def test_nothing_deviates_when_all_is_zero():
    """The built track is then the design."""
    none = deviations(5, True, cross_m=0.0, along_m=0.0, stretch=0.0, roll_rad=0.0)
    s = np.arange(0.0, 800.0, 7.0)
    assert not none.cross(s).any()
    assert not none.along(s).any()
    assert not none.roll(s).any()

"""The filters that tell what the paper's scenario allows: optimal where they claim to be."""

import numpy as np
import pytest

from track_localization.cli.maglev.reproduce_floor import linear_optimum, optimal
from track_localization.settings import override
from track_localization.sim.maglev import scenario, simulate_maglev

RUNS = 60


def errors(name, floor, **changes):
    """Return errors and claimed sigmas (RUNS, N) [m] over seeded runs."""
    config = override(scenario(name), {k.replace('__', '.'): v for k, v in changes.items()})
    rows, sigmas = [], []
    for seed in range(300, 300 + RUNS):
        run = simulate_maglev(config, seed)
        found = floor(run, config)
        rows.append(found.chainage - np.interp(found.time_s, run.time_s, run.chainage))
        sigmas.append(found.sigma_along)
    return np.array(rows), np.array(sigmas)


def test_the_optimum_is_as_good_as_it_claims():
    """
    Its NEES is chi-square: over 60 runs of 100 correlated seconds its mean is 1 within 5 %.

    The start is left out: what the filter begins with are the readings, not draws of its prior.
    """
    error, sigma = errors('paper', optimal)
    nees = (error / sigma)[:, 10:] ** 2
    assert nees.mean() == pytest.approx(1.0, abs=0.05)


def test_the_optimum_settles_where_the_riccati_equation_does():
    """The steady state solves P = (I - K H) (F P F' + Q), found here by iterating information."""
    config = scenario('paper')
    run = simulate_maglev(config, 1)
    F = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    G = np.array([1.0 / 6.0, 0.5, 1.0])
    measured = np.diag([100.0, 100.0, 0.0])
    P = np.eye(3)
    for _ in range(500):
        P = np.linalg.inv(np.linalg.inv(F @ P @ F.T + 0.001 * np.outer(G, G)) + measured)
    assert optimal(run, config).sigma_along[-1] == pytest.approx(np.sqrt(P[0, 0]), rel=1e-6)


def test_the_best_linear_filter_is_as_good_as_it_claims():
    """Its errors are not normal, for single misses are counted, but their variance is told."""
    error, sigma = errors('paper_missed', linear_optimum)
    late = slice(40, None)
    assert np.mean(error[:, late] ** 2) == pytest.approx(np.mean(sigma[:, late] ** 2), rel=0.2)
    assert np.abs(np.mean(error[:, late])) < 0.1


def test_without_misses_a_counter_is_half_a_pitch_behind_and_no_more():
    """Then the counter's error does not grow: everything stays within a crossing's distance."""
    error, sigma = errors('paper_missed', linear_optimum, loop__missed=0.0)
    assert np.abs(error).max() < 0.2
    assert np.abs(np.mean(error)) < 0.01
    assert sigma[:, -1].max() < 0.06


def test_sensors_out_of_step_are_refused():
    run = simulate_maglev(scenario('line'), 1)
    with pytest.raises(ValueError, match='in step'):
        optimal(run, scenario('line'))

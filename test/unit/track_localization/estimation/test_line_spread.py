"""A vehicle whose place is uncertain, compared with the line: against a brute-force Bayes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from track_localization.estimation import line_updates
from track_localization.track.centreline import Centreline
from track_localization.track.line_map import LineMap

SIGMA = 0.004


def flat_bend(begin, sharpening):
    """Level line: straight, then from ``begin`` on a clothoid; its yaw by chainage."""

    def yaw(s):
        return 0.5 * sharpening * np.maximum(s - begin, 0.0) ** 2

    s = np.arange(0.0, 120.01, 0.05)
    front = np.stack([np.cos(yaw(s)), np.sin(yaw(s)), 0.0 * s], axis=1)
    R = np.stack([front, np.cross([0.0, 0.0, 1.0], front), np.full_like(front, [0, 0, 1])], axis=2)
    path = np.vstack([np.zeros(3), np.cumsum(0.5 * (front[1:] + front[:-1]) * 0.05, axis=0)])
    return yaw, LineMap(Centreline(s[::5], path[::5], R[::5], False, 120.0), SIGMA, 0.1)


def on_a_level_line(s, yaw):
    C = Rotation.from_euler('z', yaw).as_matrix()
    return np.concatenate([[s, 10.0], C.ravel(), np.eye(3).ravel(), np.zeros(10)])


def bayes(s0, sigma, measured, yaw, variance):
    """Mean and standard deviation of the chainage after a yaw was seen, on a fine grid."""
    s = np.linspace(s0 - 8.0 * sigma, s0 + 8.0 * sigma, 40001)
    weight = -0.5 * ((s - s0) / sigma) ** 2 - 0.5 * (measured - yaw(s)) ** 2 / variance
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    mean = weight @ s
    return mean, np.sqrt(weight @ (s - mean) ** 2)


def matched(ref, table, s0, sigma, measured, tilt_sigma, spread_m=0.4):
    """Belief on the chainage (mean, sigma) after one comparison that stands for 10 m of line."""
    x = on_a_level_line(s0, measured)
    P = np.diag(np.repeat([sigma**2, 1e-8, tilt_sigma**2, 1e-12], [1, 1, 3, 13]))
    settings = np.array([0.5, 1e6, spread_m, 60.0])
    line_updates.match_attitude(x, P, 1.0, *ref.args(table), settings, np.zeros(3))
    return x[0], np.sqrt(P[0, 0])


@pytest.mark.parametrize('true', [52.0, 54.0, 56.5])
def test_wide_belief_on_a_steady_bend_follows_bayes(ref, true):
    """sigma_s = 3 m on a bend of 1/40 m to 1/25 m: mean and sigma are those of the grid."""
    yaw, table = flat_bend(10.0, 8e-4)
    expected, sigma = bayes(54.0, 3.0, yaw(true), yaw, 0.02**2 + SIGMA**2)
    got = matched(ref, table, 54.0, 3.0, float(yaw(true)), 0.02)
    assert got[0] == pytest.approx(expected, abs=0.2)
    assert got[1] == pytest.approx(sigma, rel=0.25)


@pytest.mark.parametrize('measured', [0.01, 0.02])
def test_moments_over_a_bend_give_the_best_linear_estimate(ref, measured):
    """A belief that reaches from the straight into the bend: against moments on a fine grid."""
    yaw, table = flat_bend(57.0, 1e-3)
    s0, sigma = 60.0, 3.0
    s = np.linspace(s0 - 24.0, s0 + 24.0, 40001)
    weight = np.exp(-0.5 * ((s - s0) / sigma) ** 2)
    weight /= weight.sum()
    mean = weight @ yaw(s)
    cross = weight @ ((s - s0) * (yaw(s) - mean))
    variance = weight @ (yaw(s) - mean) ** 2 + 0.003**2 + SIGMA**2
    expected = s0 + cross / variance * (measured - mean)
    left = np.sqrt(sigma**2 - cross**2 / variance)
    got = matched(ref, table, s0, sigma, measured, 0.003)
    assert got[0] == pytest.approx(expected, abs=0.1)
    assert got[1] == pytest.approx(left, rel=0.05)
    # The slope at the mean alone is off by more than a metre and too sure of it.
    by_slope = matched(ref, table, s0, sigma, measured, 0.003, spread_m=1e3)
    assert abs(by_slope[0] - expected) > 1.0
    assert by_slope[1] < 0.85 * left


def test_wide_belief_before_a_bend_learns_of_it(ref):
    """Where the mean is the line does not turn yet: its slope tells nothing, the moments do."""
    yaw, table = flat_bend(60.0, 1e-3)
    truth, _ = bayes(60.0, 3.0, 0.02, yaw, 0.003**2 + SIGMA**2)
    got = matched(ref, table, 60.0, 3.0, 0.02, 0.003)
    by_slope = matched(ref, table, 60.0, 3.0, 0.02, 0.003, spread_m=1e3)
    assert truth > 65.0
    assert by_slope[0] < 60.5
    assert 63.5 < got[0] < truth
    assert got[0] + 2.0 * got[1] > truth


def test_wide_belief_is_not_overconfident_over_seeds(ref):
    """Error over sigma of 400 draws over the onset of a bend: the filter's sigma covers them."""
    rng = np.random.default_rng(8)
    yaw, table = flat_bend(60.0, 1e-3)
    squares = []
    for _ in range(400):
        true = 62.0 + 3.0 * rng.normal()
        seen = float(yaw(true) + np.hypot(0.003, SIGMA) * rng.normal())
        s, sigma = matched(ref, table, 62.0, 3.0, seen, 0.003)
        squares.append(((s - true) / sigma) ** 2)
    # One degree of freedom, not quite a Gaussian: 400 draws have a standard error of 0.07.
    assert 0.7 < np.mean(squares) < 1.3


def test_a_bend_that_is_not_felt_is_not_told_anew_at_every_comparison(ref):
    """
    Straight on before a bend, while a vehicle at 1 m/s is compared twenty times in a metre.

    All that is seen is that it is not in the bend yet: how far before it, the truth of 4 m (1.6
    prior sigmas) included, must stay inside two sigmas.
    """
    _, table = flat_bend(57.0, 0.05)
    x = on_a_level_line(58.0, 0.0)
    x[1] = 1.0
    P = np.diag(np.repeat([2.5**2, 1e-8, 0.002**2, 1e-12], [1, 1, 3, 13]))
    settings = np.array([0.5, 9.0, 0.4, 60.0])
    for _ in range(20):
        line_updates.match_attitude(x, P, 0.05, *ref.args(table), settings, np.zeros(3))
    assert x[0] < 58.0
    assert abs(x[0] - 54.0) < 2.0 * np.sqrt(P[0, 0])

"""Strapdown navigation on motions whose truth is a formula."""

import numpy as np
import pytest

from track_localization.estimation import strapdown
from track_localization.estimation.imu import ImuSeries

G = 9.80665


def series(time_s, force, rate):
    n = len(time_s)
    return ImuSeries(time_s, np.broadcast_to(force, (n, 3)), np.broadcast_to(rate, (n, 3)))


@pytest.mark.parametrize('yaw', [0.0, 1.0, -2.5])
@pytest.mark.parametrize('force', [(0, 0, G), (0, G, 0), (0, 0, -G), (1.0, -2.0, 9.0), (G, 0, 0.1)])
def test_level_puts_the_force_upward_and_the_x_axis_on_its_heading(force, yaw):
    force = np.array(force, dtype=float)
    R = strapdown.level(force, yaw)
    np.testing.assert_allclose(R @ force, [0, 0, np.linalg.norm(force)], atol=1e-9)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    x = R[:2, 0]
    if np.linalg.norm(x) > 0.2:
        assert np.arctan2(x[1], x[0]) == pytest.approx(yaw, abs=1e-9)


def test_level_refuses_a_force_of_no_length():
    with pytest.raises(ValueError, match='no direction'):
        strapdown.level(np.zeros(3))


def test_attitude_of_a_constant_turn():
    time_s = np.linspace(0.0, 10.0, 1001)
    bias = np.array([0.01, -0.02, 0.03])
    turn = bias + np.array([0.0, 0.0, 0.3])
    R = strapdown.integrate_attitude(series(time_s, [0, 0, G], turn), np.eye(3), bias)
    heading = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    np.testing.assert_allclose(np.unwrap(heading), 0.3 * time_s, atol=1e-9)


def test_dead_reckoning_of_a_circle():
    """A car on a circle of 20 m at 10 m/s feels v^2/r to the left and comes back to its start."""
    v, r, dt = 10.0, 20.0, 0.01
    steps = 1256
    p, velocity, R = np.zeros(3), np.array([v, 0.0, 0.0]), np.eye(3)
    f, w, g = np.array([0, v * v / r, G]), np.array([0, 0, v / r]), np.array([0, 0, -G])
    for k in range(1, steps + 1):
        p, velocity, R = strapdown.dead_reckon_one(p, velocity, R, f, w, g, dt)
        angle = v / r * k * dt
        truth = [r * np.sin(angle), r * (1 - np.cos(angle)), 0.0]
        np.testing.assert_allclose(p, truth, atol=2e-3)


def test_rest_is_found_and_a_smooth_lift_is_not_taken_for_it():
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, 30.0, 0.01)
    force = np.tile([0.0, 0.0, G], (len(time_s), 1))
    rate = np.zeros_like(force)
    lift = (time_s > 10) & (time_s <= 20)  # climbing at 30 deg, as smooth as the station
    force[lift] = [G * np.sin(0.5), 0.0, G * np.cos(0.5)]
    shaken = time_s > 20
    force[shaken] += rng.normal(size=(shaken.sum(), 3)) * 2.0
    force += rng.normal(size=force.shape) * 0.012
    rate += rng.normal(size=force.shape) * 0.0012 + 0.004
    intervals = strapdown.find_rest(ImuSeries(time_s, force, rate))
    start, stop = intervals[0]
    assert start == 0
    assert 9.0 < time_s[stop] < 10.6
    assert all(time_s[b - 1] < 20.6 for _, b in intervals)


def test_no_rest_in_a_turning_body():
    time_s = np.arange(0.0, 5.0, 0.01)
    assert strapdown.find_rest(series(time_s, [0, 0, G], [0, 0, 0.2])) == []
    assert strapdown.find_rest(series(time_s[:2], [0, 0, G], [0, 0, 0.0])) == []

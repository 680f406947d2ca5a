"""Errors at the ends of windows, on ways whose every point is known."""

from __future__ import annotations

import numpy as np
import pytest

from track_localization.evaluation.windows import Way, dead_reckoned, end_errors, figures

RADIUS, SPEED = 100.0, 10.0
RATE = SPEED / RADIUS


def place(t):
    """Where a car is that goes round a circle anticlockwise from its east."""
    t = np.asarray(t, float)
    return RADIUS * np.stack([np.cos(RATE * t), np.sin(RATE * t), 0.0 * t], axis=1)


@pytest.fixture
def circle():
    t = np.arange(0.0, 200.0)
    v = SPEED * np.stack([-np.sin(RATE * t), np.cos(RATE * t), 0.0 * t], axis=1)
    return Way(t, place(t), v, RATE * t + 0.5 * np.pi)


def test_a_way_is_known_between_its_samples_too(circle):
    """A straight line between samples would be 0.12 m off; the cubic's error is 1/384 rate^4."""
    t = np.linspace(0.0, 199.0, 1000)
    np.testing.assert_allclose(circle.position(t), place(t), atol=1e-4)


def test_errors_split_into_the_cars_own_axes(circle):
    """At the circle's east the car heads north: an error to the west is to its left."""
    P = np.array([[[4.0, 0.0], [0.0, 1.0]]])
    ends = end_errors(np.array([0.0]), np.array([0.0]), np.array([[97.0, 2.0]]), P, circle)
    assert ends.along[0] == pytest.approx(2.0)
    assert ends.cross[0] == pytest.approx(3.0)
    assert ends.horizontal[0] == pytest.approx(np.sqrt(13.0))
    assert ends.sigma[0] == pytest.approx(np.sqrt(5.0))
    assert ends.nees[0] == pytest.approx(9.0 / 4.0 + 4.0 / 1.0)


def test_figures_of_an_honest_claim(circle, rng):
    """20000 draws of their own covariance: error/sigma 1, 95.4 % inside, to a hundredth."""
    n = 20000
    t = np.full(n, 50.0)
    P = np.array([[4.0, 1.5], [1.5, 2.0]])
    drawn = place(t)[:, :2] + rng.multivariate_normal(np.zeros(2), P, n)
    found = figures(end_errors(t, t, drawn, np.broadcast_to(P, (n, 2, 2)), circle))
    assert found['windows'] == n
    assert found['error/sigma'] == pytest.approx(1.0, abs=0.01)
    assert found['in 2 sigma'] == pytest.approx(0.954, abs=0.01)


def test_without_a_claim_there_is_none(circle):
    found = figures(end_errors(np.zeros(3), np.zeros(3), place(np.zeros(3)), None, circle))
    assert found['max'] == pytest.approx(0.0)
    assert np.isnan(found['error/sigma'])
    assert np.isnan(found['in 2 sigma'])


def test_perfect_sensors_reckon_perfectly(circle):
    t = np.arange(0.0, 199.0, 0.1)
    begins = np.array([3.3, 60.0])
    rates, speeds = np.full(len(t), RATE), np.full(len(t), SPEED)
    ends = dead_reckoned(begins, 30.0, circle, (t, rates), (t, speeds))
    # Chords of 0.1 s instead of arcs are 1e-5 shorter.
    np.testing.assert_allclose(ends, place(begins + 30.0)[:, :2], atol=0.01)


def test_a_fast_odometer_reckons_too_far(circle):
    """One per cent of a whole round and a half is 1 % of the way, bent as the way is."""
    t = np.arange(0.0, 199.0, 0.1)
    rates, speeds = np.full(len(t), RATE), np.full(len(t), 1.01 * SPEED)
    ends = dead_reckoned(np.array([0.0]), 30.0 * np.pi, circle, (t, rates), (t, speeds))
    # Half a round beyond the whole one: the chord is two radii to the west, and 1 % more.
    np.testing.assert_allclose(ends[0] - [RADIUS, 0.0], [-2.02 * RADIUS, 0.0], atol=0.1)

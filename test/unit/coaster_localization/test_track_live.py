"""The live track filter: laps, starts that are told, and estimates with the right turning."""

from __future__ import annotations

import numpy as np
import pytest

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_live import LapCounter, LiveTrackFilter
from track_localization.estimation.imu import ImuSample

ROUND_M = 80.0 * np.pi


def laps_of(counter: LapCounter, chainages, sigma: float = 0.1) -> list[int]:
    """Return at which of the chainages a lap was completed."""
    return [i for i, s in enumerate(chainages) if counter.push(s, sigma)]


def test_every_passing_of_the_end_is_a_lap():
    counter = LapCounter(100.0)
    assert laps_of(counter, np.arange(10.0, 350.0)) == [90, 190, 290]
    assert counter.completed == 3


def test_a_start_about_zero_is_no_lap():
    """A train at -0.05 m, told as 99.95 m, that leaves over zero has completed nothing."""
    for first in (-0.05, 99.95, 0.05):
        counter = LapCounter(100.0)
        assert laps_of(counter, first + np.arange(0.0, 99.0)) == []
        assert len(laps_of(counter, first + np.arange(99.0, 102.0))) == 1


def test_noise_about_the_end_is_one_lap():
    counter = LapCounter(100.0)
    s = 50.0 + np.minimum(np.arange(0.0, 100.0), 50.0)
    noise = np.random.default_rng(1).normal(0.0, 0.1, 100)
    assert len(laps_of(counter, s + noise)) == 1


def test_rolling_back_over_the_end_and_on_again_is_one_lap():
    counter = LapCounter(100.0)
    there = np.arange(50.0, 103.0)
    assert len(laps_of(counter, np.concatenate([there, there[::-1][:20], there[-20:]]))) == 1


def test_a_place_found_anew_on_another_lap_is_no_lap():
    """The filter ends lap 1 at 130 m; found anew, it is at 31 m, and rides on."""
    counter = LapCounter(100.0)
    found = np.concatenate([np.arange(10.0, 130.0), np.arange(31.0, 90.0)])
    assert laps_of(counter, found) == [90]
    assert laps_of(counter, [99.0, 100.5]) == [1]


def test_told_a_place_the_laps_so_far_are_kept():
    counter = LapCounter(100.0)
    laps_of(counter, np.arange(10.0, 130.0))
    counter.begin()
    assert laps_of(counter, np.arange(80.0, 130.0)) == [20]
    assert counter.completed == 2
    counter.reset()
    assert counter.completed == 0


@pytest.fixture
def live(circle):
    return LiveTrackFilter(circle, TrackFilterConfig())


def run(live: LiveTrackFilter, circle, rows: range, bias: float = 0.0):
    """Push rows of the circle; return all estimates and all smoothed ones."""
    estimates, smoothed = [], []
    for i in rows:
        rate = circle.angular_rate[i] + np.array([0.0, 0.0, bias])
        estimates += live.push(ImuSample(circle.time_s[i], circle.specific_force[i], rate))
        smoothed += live.smoothed()
    return estimates, smoothed


def test_the_turning_is_the_train_s_own_without_the_gyro_s_bias(live, circle):
    """A gyro 0.005 rad/s off, as its rest shows: what is given out is the train's 0.3 rad/s."""
    estimates, smoothed = run(live, circle, range(1500), bias=0.005)
    for estimate in [*estimates[::20], *smoothed]:
        i = round(estimate.time_s * 100)
        assert estimate.angular_rate[2] == pytest.approx(circle.angular_rate[i, 2], abs=2e-3)


def test_smoothed_estimates_come_in_order_a_second_late(live, circle):
    """One for each epoch (0.05 s) from the rest on; a batch waits for five epochs at most."""
    _, smoothed = run(live, circle, range(1500))
    stamps = np.array([estimate.time_s for estimate in smoothed])
    assert np.diff(stamps) == pytest.approx(0.05, abs=1e-9)
    assert 1.0 <= circle.time_s[1499] - stamps[-1] <= 1.25 + 1e-9
    assert live.diagnostics()['lag_latency_s'] == pytest.approx(1.0, abs=0.06)


def test_called_late_the_same_is_smoothed(circle):
    """Whether after each sample or after all of them."""
    at_once, late = (LiveTrackFilter(circle, TrackFilterConfig()) for _ in range(2))
    _, expected = run(at_once, circle, range(1200))
    for i in range(1200):
        late.push(ImuSample(circle.time_s[i], circle.specific_force[i], circle.angular_rate[i]))
    smoothed = late.smoothed()
    assert [e.time_s for e in smoothed] == [e.time_s for e in expected]
    for a, b in zip(smoothed, expected, strict=True):
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_array_equal(a.angular_rate, b.angular_rate)


def test_after_a_reset_the_same_ride_gives_the_same(live, circle):
    first, _ = run(live, circle, range(800))
    live.reset()
    assert live.diagnostics()['status'].startswith('waiting')
    again, _ = run(live, circle, range(800))
    np.testing.assert_array_equal(again[-1].x, first[-1].x)
    np.testing.assert_array_equal(again[-1].P, first[-1].P)


def test_a_place_in_map_becomes_the_nearest_chainage_with_its_own_doubt(live, circle):
    assert live.set_start_position(np.array([0.0, 41.0, 0.0]), np.diag([0.09, 4.0, 4.0])) is None
    estimates, _ = run(live, circle, range(150))
    assert estimates[-1].chainage == pytest.approx(0.25 * ROUND_M, abs=0.05)
    assert estimates[-1].sigma_along == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize(
    ('place', 'problem'),
    [((40.0, 4.0, 0.0), None), ((60.0, 0.0, 0.0), 'off_track'), ((40.0, 0.0, 30.0), 'off_track')],
)
def test_a_place_far_off_the_track_is_no_start(live, place, problem):
    """Five sigmas and 5 m: 10 m here."""
    assert live.set_start_position(np.array(place), np.eye(3)) == problem

"""Two rides by chainage, against closed forms and against simulated truth."""

import itertools

import numpy as np
import pytest

from coaster_localization.comparing import (
    UNRUN,
    Element,
    between_places,
    compare,
    equal_stretches,
    judge,
    rider_force,
)
from coaster_localization.ride_passes import SmoothedRide
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_map import line_map
from coaster_localization.track_rides import filter_ride
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.settings import override
from track_localization.sim.coaster import CoasterSimConfig, simulate_coaster
from track_localization.track.centreline import Centreline
from track_localization.track.line_map import LineMap


@pytest.fixture(scope='module')
def straight():
    s = np.linspace(0.0, 400.0, 801)
    position = np.stack([s, 0.0 * s, 0.0 * s], axis=1)
    line = Centreline(s, position, np.tile(np.eye(3), (len(s), 1, 1)), False, 400.0)
    return LineMap(line, 0.004)


def steady(line, speed, from_m=0.0, to_m=400.0, sigma_s=0.05, sigma_v=0.03, start_s=0.0):
    """Return a ride at a steady speed, known to sigma_s [m] and sigma_v [m/s]."""
    t = np.arange(0.0, (to_m - from_m) / speed, 0.05)
    x = np.zeros((len(t), 30))
    x[:, 0], x[:, 1] = from_m + speed * t, speed
    x[:, 2:11] = x[:, 11:20] = np.eye(3).ravel()
    P = np.zeros((len(t), 18, 18))
    P[:, 0, 0], P[:, 1, 1] = sigma_s**2, sigma_v**2
    imu_t = start_s + np.arange(0.0, t[-1] + 0.01, 0.01)
    force = np.tile([0.0, 0.0, 9.80665], (len(imu_t), 1))
    return SmoothedRide(start_s + t, x, P, line), ImuSeries(imu_t, force, np.zeros_like(force))


def test_steady_rides_differ_by_what_they_should(straight):
    """20 and 19 m/s: 1 m/s slower, and 100 m take 0.263 s longer; clocks do not matter."""
    (found,), notes = compare(steady(straight, 20.0), steady(straight, 19.0, start_s=500.0))
    assert notes == []
    np.testing.assert_allclose(found.speed_difference, -1.0, atol=1e-9)
    np.testing.assert_allclose(
        found.time_difference, found.chainage * (1.0 / 19.0 - 1.0 / 20.0), atol=1e-6
    )
    np.testing.assert_allclose(found.sigma, 0.03 * np.sqrt(2.0), atol=1e-9)
    (verdict,) = judge(found, [Element('drop', 100.0, 200.0)])
    assert verdict.difference == pytest.approx(-1.0)
    assert verdict.time_difference == pytest.approx(100.0 / 19.0 - 100.0 / 20.0)
    # Entering and leaving are known to 0.05 m each: sqrt(2) 0.05 m / 100 m of either speed.
    by_time = np.hypot(20.0, 19.0) * np.sqrt(2.0) * 0.05 / 100.5
    assert verdict.half_width == pytest.approx(1.96 * by_time, rel=1e-3)
    assert verdict.significant


def test_a_difference_within_its_error_is_not_significant(straight):
    rides = steady(straight, 20.0, sigma_s=1.0, sigma_v=0.2), steady(straight, 19.9)
    (found,), _ = compare(*rides)
    assert not judge(found, [Element('short', 100.0, 110.0)])[0].significant


def test_a_ride_that_ends_early_is_compared_where_both_ran(straight):
    (found,), notes = compare(steady(straight, 20.0), steady(straight, 20.0, to_m=150.0))
    assert found.chainage[-1] == pytest.approx(149.0, abs=1.0)
    assert any('ride B is missing on 250 m' in note or 'B is missing' in note for note in notes)
    far, near = judge(found, [Element('far', 200.0, 300.0), Element('near', 20.0, 120.0)])
    assert far.remark == UNRUN
    assert not far.significant
    assert near.remark == ''


def test_rides_without_a_common_stretch_are_refused(straight):
    with pytest.raises(DataError, match='in common'):
        compare(steady(straight, 20.0, to_m=100.0), steady(straight, 20.0, from_m=200.0))


def test_force_keeps_what_riders_feel_and_its_place(straight):
    """1 Hz passes without delay; at 5 Hz 3 dB are lost; 25 Hz is gone."""
    ride, imu = steady(straight, 20.0)
    t = imu.time_s
    inside = (t > 3.0) & (t < t[-1] - 3.0)
    for hertz, gain in ((1.0, 1.0), (5.0, np.sqrt(0.5)), (25.0, 0.0)):
        wave = np.sin(2.0 * np.pi * hertz * t)
        force = imu.specific_force + wave[:, None] * [0.0, 1.0, 0.0]
        felt = rider_force(ride, ImuSeries(t, force, imu.angular_rate))[inside]
        share = float(felt[:, 1] @ wave[inside] / (wave[inside] @ wave[inside]))
        assert share == pytest.approx(gain, abs=0.02)
        np.testing.assert_allclose(felt[:, 2], 9.80665, atol=1e-6)


def test_a_recording_too_slow_for_forces_is_refused(straight):
    ride, imu = steady(straight, 20.0)
    with pytest.raises(DataError, match='few for forces'):
        rider_force(ride, imu[::10])


def test_elements_cover_the_line():
    assert [(e.from_m, e.to_m) for e in equal_stretches(100.0, 4)] == [
        (0.0, 25.0),
        (25.0, 50.0),
        (50.0, 75.0),
        (75.0, 100.0),
    ]
    cut = between_places(('b', 'a', 'a2', 'z'), np.array([60.0, 30.0, 33.0, 95.0]), 100.0)
    assert [(e.name, e.from_m, e.to_m) for e in cut] == [
        ('start to a', 0.0, 30.0),
        ('a to b', 30.0, 60.0),
        ('b to end', 60.0, 100.0),
    ]


def test_intervals_hold_the_truth():
    """Three rides over one built track: no more 95 % intervals are wrong than chance allows."""
    config, changes = TrackFilterConfig(), {'track.build_seed': 1}
    rides = [
        simulate_coaster('launch', override(CoasterSimConfig(), changes), s) for s in (1, 2, 3)
    ]
    line = line_map(rides[0].design, config)
    pairs = []
    for ride in rides:
        filtered = filter_ride(ride.imu, line, float(ride.design.chainage[0]), config)
        pairs.append((SmoothedRide.of(filtered), ride.imu))
    right = total = 0
    for i, j in itertools.combinations(range(3), 2):
        found = compare(pairs[i], pairs[j])[0][0]
        speeds = []
        for k in (i, j):
            truth = rides[k].truth
            s = np.unwrap(truth.chainage, period=line.length)
            moving = truth.speed > 0.2
            speeds.append(np.interp(found.chainage, s[moving], truth.speed[moving]))
        for verdict in judge(found, equal_stretches(line.length)[1:-1]):
            e = verdict.element
            inside = (found.chainage >= e.from_m) & (found.chainage <= e.to_m)
            true = float((speeds[1] - speeds[0])[inside].mean())
            right += abs(verdict.difference - true) < verdict.half_width
            total += 1
    assert total == 24
    # Of 24 such intervals 19 or fewer are right with a chance of less than 1 %.
    assert right >= 20


def test_a_shuttle_is_compared_pass_by_pass():
    config, changes = TrackFilterConfig(), {'track.build_seed': 1}
    pairs = []
    for seed in (1, 2):
        ride = simulate_coaster('shuttle', override(CoasterSimConfig(), changes), seed)
        line = line_map(ride.design, config)
        filtered = filter_ride(ride.imu, line, float(ride.design.chainage[0]), config)
        pairs.append((SmoothedRide.of(filtered), ride.imu))
    found, _ = compare(*pairs)
    # Back to where it is launched, over the top and to the end, back again, into the station.
    assert [c.forward for c in found] == [False, True, False, True]
    # Each pass begins when the one before has ended.
    for before, after in itertools.pairwise(found):
        assert np.nanmin(after.a.time_s) > np.nanmax(before.a.time_s) - 1.0

"""The train's motion against closed forms."""

import dataclasses

import numpy as np
import pytest

from track_localization import GRAVITY
from track_localization.sim.coaster.dynamics import Conditions, run_train
from track_localization.sim.coaster.elements import grade, straight
from track_localization.sim.coaster.kernels import RELEASE_S
from track_localization.sim.coaster.layout import lay, to_track
from track_localization.sim.coaster.ride_plan import Phase, RidePlan, Train, Zone
from track_localization.track.centreline import Centreline
from track_localization.track.track_file import TrackFile

SLOPE = np.radians(20.0)
BARE = Train(cars=5, car_length_m=2.0, friction=0.0, drag_area_m2=0.0, mass_kg=5000.0)
NOTHING = Zone('trim', -9.0, -8.0)


def incline(length: float = 400.0) -> Centreline:
    """Return a straight line that falls at 20 degrees."""
    s = np.arange(0.0, length, 0.5)
    front = np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
    left = np.array([0.0, 1.0, 0.0])
    axes = [np.tile(a, (len(s), 1)) for a in (front, left, np.cross(front, left))]
    return Centreline.from_track(TrackFile(s[:, None] * front, *axes))


def after_release(run, until: float = 12.0):
    """Return (t, v) from one second past the soft release on, with v taken as known there."""
    i, j = np.searchsorted(run.time_s, [1.0, until])
    return run.time_s[i:j] - run.time_s[i], run.v[i:j]


def plan(train: Train, *zones: Zone, start: float = 20.0, until: float = 1e6) -> RidePlan:
    """Return a ride that is over when row 1 reaches ``until``."""
    phases = (Phase(1, 'at', at_m=until),)
    return RidePlan(train=train, start_m=start, zones=zones or (NOTHING,), phases=phases)


def test_free_fall_on_an_incline():
    """Without friction, v grows by g sin(slope)."""
    t, v = after_release(run_train(incline(), plan(BARE, until=300.0)), 10.0)
    np.testing.assert_allclose(v, v[0] + GRAVITY * np.sin(SLOPE) * t, atol=1e-6)


def test_rolling_friction_on_an_incline():
    """With friction, by g (sin - mu cos)."""
    train = dataclasses.replace(BARE, friction=0.02)
    t, v = after_release(run_train(incline(), plan(train, until=300.0)), 10.0)
    slow = GRAVITY * (np.sin(SLOPE) - 0.02 * np.cos(SLOPE))
    np.testing.assert_allclose(v, v[0] + slow * t, atol=1e-5)


def test_drag_and_head_wind_give_the_terminal_speed():
    """Terminal speed is sqrt(2 m g sin / (rho CdA)) through the air, less the head wind."""
    train = dataclasses.replace(BARE, drag_area_m2=150.0)
    still = run_train(incline(1500.0), plan(train, until=1200.0))
    terminal = np.sqrt(2.0 * 5000.0 * GRAVITY * np.sin(SLOPE) / (1.2 * 150.0))
    i = np.searchsorted(still.time_s, 40.0)
    assert still.v[i] == pytest.approx(terminal, rel=1e-4)
    windy = run_train(
        incline(1500.0), plan(train, until=1200.0), Conditions(wind_mps=(-4.0 / np.cos(SLOPE), 0.0))
    )
    assert windy.v[i] == pytest.approx(terminal - 4.0, rel=1e-4)


def test_energy_between_two_levels():
    """From flat to flat, speed squared grows by 2 g times the drop, whatever the train's length."""
    layout = lay([*straight(60.0), *grade(-20.0, 40.0, 15.0, 20.0), *straight(200.0)])
    line = Centreline.from_track(to_track(layout))
    for cars in (1, 8):
        train = dataclasses.replace(BARE, cars=cars)
        push = Zone('tyres', 0.0, 45.0, 3.0, 2.0)
        run = run_train(line, plan(train, push, start=22.0, until=210.0))
        before = run.v[np.searchsorted(run.s, 58.0)]
        after = run.v[np.searchsorted(run.s, 200.0)]
        gained = after**2 - before**2
        assert gained == pytest.approx(2.0 * GRAVITY * 20.0, rel=1e-4)


def test_long_train_hangs_over_the_crest():
    """While its middle is still level the long train waits; the short one is off already."""
    layout = lay([*straight(60.0), *grade(-20.0, 40.0, 15.0, 20.0), *straight(200.0)])
    line = Centreline.from_track(to_track(layout))
    push = Zone('tyres', 0.0, 45.0, 3.0, 2.0)
    speeds = []
    for cars in (1, 8):
        run = run_train(
            line, plan(dataclasses.replace(BARE, cars=cars), push, start=22.0, until=80.0)
        )
        speeds.append(run.v[np.searchsorted(run.s, 75.0)])
    assert speeds[0] > speeds[1] + 2.0


def test_launch_does_force_times_length_of_work():
    """On the level a launch of length L gives v^2 = v0^2 + 2 a L, also by a factor on its force."""
    line = Centreline.from_track(to_track(lay(straight(300.0))))
    zones = (Zone('tyres', 0.0, 40.0, 3.0, 2.0), Zone('launch', 60.0, 110.0, 99.0, 6.0))
    for factor in (1.0, 1.1):
        run = run_train(line, plan(BARE, *zones, until=140.0), Conditions(launch=factor))
        before, after = run.v[np.searchsorted(run.s, [58.0, 130.0])]
        assert after**2 - before**2 == pytest.approx(2.0 * 6.0 * factor * 50.0, rel=1e-3)


def test_brake_aims_at_its_speed_and_chain_keeps_its_own():
    """A brake ends at its speed; a chain drags at its speed times the factor drawn."""
    layout = lay([*straight(50.0), *grade(12.0, 25.0, 12.0, 12.0), *straight(60.0)])
    line = Centreline.from_track(to_track(layout))
    zones = (
        Zone('tyres', 0.0, 60.0, 2.5, 1.5),
        Zone('chain', 45.0, 120.0, 2.0, 12.0),
    )
    run = run_train(line, plan(BARE, *zones, until=90.0), Conditions(chain=1.05))
    assert run.v[np.searchsorted(run.s, 80.0)] == pytest.approx(2.1, abs=0.4)
    level = Centreline.from_track(to_track(lay(straight(300.0))))
    zones = (
        Zone('tyres', 0.0, 40.0, 3.0, 2.0),
        Zone('launch', 60.0, 110.0, 99.0, 4.0),
        Zone('brake', 150.0, 220.0, 5.0, 0.0, 5.0),
    )
    run = run_train(level, plan(BARE, *zones, until=218.0))
    assert run.v[np.searchsorted(run.s, 215.0)] == pytest.approx(5.0, abs=0.05)


def test_station_stops_row_one_at_its_mark():
    """The train stops within 10 cm of the stopping point and the run ends there."""
    level = Centreline.from_track(to_track(lay(straight(200.0))))
    zones = (
        Zone('tyres', 0.0, 95.0, 3.0, 2.0, 2.0),
        Zone('station', 100.0, 160.0, 3.0, 1.0, 1.5, 140.0),
    )
    course = dataclasses.replace(plan(BARE, *zones), phases=(Phase(),))
    run = run_train(level, course)
    assert run.outcome == 0
    assert run.s[-1] == pytest.approx(140.0, abs=0.1)
    assert abs(run.v[-1]) < 1e-3


def test_train_that_cannot_make_the_hill_rolls_back():
    """The outcome says so instead of a ride that never happened."""
    layout = lay([*straight(60.0), *grade(10.0, 25.0, 12.0, 12.0), *straight(40.0)])
    line = Centreline.from_track(to_track(layout))
    run = run_train(line, plan(BARE, Zone('tyres', 0.0, 40.0, 3.0, 2.0)))
    assert run.outcome == 1


def test_train_without_drive_is_stuck():
    """Twenty seconds without motion end the run."""
    level = Centreline.from_track(to_track(lay(straight(100.0))))
    run = run_train(level, plan(BARE))
    assert run.outcome == 2


def test_reversal_comes_back_with_the_same_speed():
    """Up a slope and back without friction: speeds mirror; phases turn the ride round."""
    layout = lay([*straight(150.0), *grade(30.0, 40.0, 15.0, 15.0), *straight(5.0)])
    line = Centreline.from_track(to_track(layout))
    zones = (
        Zone('launch', 30.0, 60.0, 99.0, 6.0, phase=0),
        Zone('station', 20.0, 100.0, 30.0, 1.0, 9.0, 50.0, phase=1),
    )
    course = RidePlan(
        train=BARE, start_m=36.0, zones=zones, phases=(Phase(1, 'reversal'), Phase(-1, 'stop'))
    )
    run = run_train(line, course)
    top = int(np.argmax(run.s))
    there = run.v[np.searchsorted(run.s[:top], 140.0)]
    back = run.v[top + np.searchsorted(-run.s[top:], -140.0)]
    assert back == pytest.approx(-there, rel=1e-3)
    assert run.outcome == 0
    assert run.s[-1] == pytest.approx(50.0, abs=0.1)


def test_hold_between_phases():
    """A caught train is brought to rest and held for the time asked, then let go."""
    zones = (NOTHING,)
    course = RidePlan(
        train=BARE,
        start_m=20.0,
        zones=zones,
        phases=(Phase(1, 'at', at_m=60.0, hold_s=3.0), Phase(1, 'at', at_m=120.0)),
    )
    run = run_train(incline(), course)
    resting = np.flatnonzero((np.abs(run.v) < 1e-9) & (run.time_s > RELEASE_S))
    assert len(resting) * 0.002 == pytest.approx(3.0, abs=0.05)
    assert run.outcome == 0

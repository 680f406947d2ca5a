"""The coaster's line from its design ride: where it is, and how fast a train usually is there."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_map import line_map, passes, regime_changes
from track_localization.estimation import line_rows
from track_localization.sim.coaster.simulate import built_in_model
from track_localization.track import line_map as columns
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.line_map import LineMap

CONFIG = TrackFilterConfig()
RADIUS = 60.0


def level_ride(s):
    """Ride (100 Hz) on a level circle of RADIUS by its chainage (N,)."""
    a = s / RADIUS
    zero, yaw = np.zeros_like(a), a + 0.5 * np.pi
    t = np.arange(len(s)) / 100.0
    v = np.gradient(s, t)
    return DesignRide(
        time_s=t,
        chainage=s,
        position=RADIUS * np.stack([np.cos(a), np.sin(a), zero], axis=1),
        quaternion=np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1),
        velocity=np.stack([-v * np.sin(a), v * np.cos(a), zero], axis=1),
        specific_force=np.stack([zero, v * v / RADIUS, zero + 9.80665], axis=1),
        angular_rate=np.stack([zero, zero, v / RADIUS], axis=1),
    )


def chainage_of(speed):
    return np.concatenate([[0.0], np.cumsum(speed[:-1] / 100.0)])


@pytest.mark.parametrize('name', ['looping', 'shuttle'])
def test_line_of_a_design_ride_is_the_seats_path(name):
    """Where the design ride was, the line is: its position to a centimetre, its attitude."""
    design = built_in_model(name).design
    table = line_map(design, CONFIG)
    assert table.closed == (name == 'looping')
    # A second run up the shuttle's spike goes on where the line, its longest run, ends.
    inside = design.chainage < table.length if not table.closed else np.isfinite(design.chainage)
    assert inside.mean() > 0.97
    for k in np.flatnonzero(inside)[::331]:
        s = float(design.chainage[k])
        i, share = line_rows.row_of(table.rows, table.step_m, table.closed, s)
        place = (1.0 - share) * table.position[i] + share * table.position[i + 1]
        assert np.linalg.norm(place - design.position[k]) < 0.01
        R = line_rows.attitude_at(table.rows, table.step_m, table.closed, s)
        off = Rotation.from_matrix(R).inv() * Rotation.from_quat(design.quaternion[k])
        assert off.magnitude() < 2e-3
    assert (table.rows[:, columns.SIGMA] == CONFIG.attitude_sigma).all()


def test_force_of_the_design_ride_moves_a_vehicle_as_designed():
    """The simulator's own force at the seat gives the design's second derivative of chainage."""
    design = built_in_model('looping').design
    table = line_map(design, CONFIG)
    rate = np.gradient(design.chainage, design.time_s)
    wanted = np.gradient(rate, design.time_s)
    # Drives and brakes take hold within a sample or two; there a numeric derivative says little.
    smooth = np.abs(np.gradient(wanted, design.time_s)) < 10.0
    rows = np.flatnonzero(smooth & (rate > 1.0))[::40]
    got = [
        line_rows.acceleration(
            table.rows,
            *(table.step_m, table.closed, design.chainage[k], rate[k]),
            *design.specific_force[k],
        )
        for k in rows
    ]
    off = np.abs(np.array(got) - wanted[rows])
    assert len(rows) > 150
    assert np.median(off) < 0.005
    assert np.percentile(off, 99.0) < 0.05


def test_usual_speed_is_the_designs_rate_of_chainage():
    """By the design ride at its own chainages; nothing where it stands or creeps."""
    design = built_in_model('looping').design
    table = line_map(design, CONFIG)
    rate = np.gradient(design.chainage, design.time_s)
    usual = np.interp(design.chainage % table.length, table.chainage, table.rows[:, columns.SPEED])
    fast = rate > 1.5
    off = np.abs(usual - rate)[fast]
    assert np.isfinite(off).mean() > 0.99
    assert np.nanmax(off) < 0.15
    stands = int(design.chainage[0] / table.step_m)
    assert np.isnan(table.rows[stands - 2 : stands + 1, columns.SPEED]).all()
    known = np.isfinite(table.rows[:, columns.SPEED])
    assert known.mean() > 0.95
    assert table.rows[known, columns.SPEED].min() >= 0.5


def test_speed_is_less_certain_where_it_changes():
    """Its standard deviation is how much it differs 0.7 m further on."""
    v = 6.0 + 3.0 * np.sin(np.arange(3000) / 300.0)
    design = level_ride(chainage_of(v))
    table = line_map(design, CONFIG)
    s = np.linspace(30.0, 120.0, 50)
    speed = np.interp(s, design.chainage, v)
    slope = np.interp(s, design.chainage, np.gradient(v, design.chainage))
    row = np.round(s / table.step_m).astype(int)
    np.testing.assert_allclose(table.rows[row, columns.SPEED], speed, atol=0.02)
    np.testing.assert_allclose(table.rows[row, columns.SPEED_SIGMA], 0.7 * np.abs(slope), atol=0.01)


def test_track_that_is_run_both_ways_has_a_speed_for_each():
    """The shuttle climbs its first lift backward at one speed and rolls through it otherwise."""
    design = built_in_model('shuttle').design
    table = line_map(design, CONFIG)
    s, rate = design.chainage, np.gradient(design.chainage, design.time_s)
    for place in (40.0, 150.0):
        i = int(place / table.step_m)
        passes_here = rate[:-1][np.diff(np.sign(s - place)) != 0]
        for column, way in ((columns.SPEED, 1.0), (columns.BACK, -1.0)):
            there = passes_here[way * passes_here > 0.05]
            usual = table.rows[i, column]
            if len(there) and np.ptp(there) < 0.04 * abs(there).max():
                assert usual == pytest.approx(there.mean(), rel=0.03)
            elif len(there) > 1 and np.ptp(there) > 0.06 * abs(there).max():
                assert np.isnan(usual)
    assert np.isfinite(table.rows[:, columns.BACK]).any()
    assert np.isfinite(table.rows[:, columns.SPEED]).any()


def test_laps_that_differ_tell_no_speed():
    """Two laps of a circuit at 10 and at 14 m/s: no usual speed; at 10 and 10.2: their middle."""
    lap = 2.0 * np.pi * RADIUS
    for second, known in ((14.0, False), (10.2, True)):
        step = np.full(12000, 0.1)
        s = np.cumsum(step)
        step[s > lap] = second / 100.0
        s = np.cumsum(step)
        table = line_map(level_ride(s[s < 2.0 * lap]), CONFIG)
        speed = table.rows[200:-200, columns.SPEED]
        assert table.closed
        if known:
            np.testing.assert_allclose(speed, 10.1, atol=0.11)
        else:
            assert np.isnan(speed).all()


def test_no_speed_where_none_is_wanted():
    table = line_map(built_in_model('looping').design, dataclasses.replace(CONFIG, speed_sigma=0.0))
    assert np.isnan(table.rows[:, columns.SPEED]).all()
    assert (table.rows[:, columns.RENEWAL] == 0.0).all()


def test_pace_is_renewed_where_a_drive_ends():
    """Tyres keep 4 m/s for 50 m, then the train falls: about 50 m the deviation decays by e^-3."""
    design = level_ride(np.linspace(0.0, 300.0, 3000))
    table = LineMap(Centreline.from_design_ride(design), 0.004)
    s = table.chainage
    speed = np.sqrt(4.0**2 + 2.0 * 2.5 * np.clip(s - 50.0, 0.0, None))
    renewal = regime_changes(speed, table)
    where = s[renewal > 0.0]
    assert 47.0 < where.min() < where.max() < 53.0
    # The filters of the kernel integrate it epoch by epoch: |v| T per metre.
    assert renewal.sum() * table.step_m == pytest.approx(3.0, abs=0.1)
    free = np.sqrt(10.0**2 + 2.0 * 2.5 * s)
    assert (regime_changes(free, table) == 0.0).all()
    fast = np.full_like(s, 20.0)
    assert (regime_changes(fast, table) == 0.0).all()


def test_pace_is_renewed_where_a_brake_lets_go():
    """A brake leaves the train 4 m/s, whatever it had; coasting slows it by 0.15 m/s^2 after."""
    design = level_ride(np.linspace(0.0, 300.0, 3000))
    table = LineMap(Centreline.from_design_ride(design), 0.004)
    s = table.chainage
    speed = np.sqrt(16.0 - 2.0 * 0.15 * (s - 60.0).clip(0.0, 30.0))
    braked = s < 60.0
    speed[braked] = np.sqrt(16.0 + 2.0 * 4.0 * (60.0 - s[braked]))
    renewal = regime_changes(speed, table)
    where = s[renewal > 0.0]
    # Half a change, 2 m, to both sides of where it lets go; the speed is smoothed over 1 m.
    assert where.min() == pytest.approx(58.5, abs=0.6)
    assert (renewal[(s > 59.0) & (s < 61.5)] > 0.0).all()
    assert (renewal[(s > 63.0) & (s < 86.0)] == 0.0).all()


def test_passes_are_met_both_ways():
    """Places of a ride every few metres, with the speed and sense it has there."""
    t = np.arange(0.0, 20.0, 0.01)
    s = 100.0 - 80.0 * np.cos(t * np.pi / 20.0 * 2.0)
    design = level_ride(s)
    got = passes(design)
    rate = 80.0 * np.pi / 10.0 * np.sin(np.arccos(np.clip((100.0 - got[:, 0]) / 80.0, -1, 1)))
    np.testing.assert_allclose(np.abs(got[:, 1]), rate, atol=0.3)
    assert (got[:, 1] > 1.0).sum() > 30
    assert (got[:, 1] < -1.0).sum() > 30
    assert np.abs(np.diff(got[:, 0])).max() < 9.0
    assert np.abs(got[:, 1]).min() > 0.3

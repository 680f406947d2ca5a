"""A ride cut into passes: laps, shuttles, stops and small rollbacks."""

import numpy as np
import pytest

from coaster_localization.ride_passes import split_passes
from track_localization.track.centreline import Centreline
from track_localization.track.line_map import LineMap


@pytest.fixture(scope='module')
def ring(circle):
    return LineMap(Centreline.from_design_ride(circle), 0.004)


@pytest.fixture(scope='module')
def straight():
    s = np.linspace(0.0, 200.0, 401)
    position = np.stack([s, 0.0 * s, 0.0 * s], axis=1)
    line = Centreline(s, position, np.tile(np.eye(3), (len(s), 1, 1)), False, 200.0)
    return LineMap(line, 0.004)


def test_laps_of_a_circuit_are_passes(ring):
    """From 20 m on, two laps and a half: cut where the chainage begins anew."""
    s = np.arange(20.0, 2.5 * ring.length, 0.7)
    found = split_passes(s, ring)
    assert [p.forward for p in found] == [True, True, True]
    assert found[0].chainage[0] == pytest.approx(20.0)
    for p in found:
        assert (np.diff(p.chainage) > 0.0).all()
        assert p.chainage[-1] <= ring.length
    assert found[1].chainage[-1] - found[1].chainage[0] > ring.length - 1.5
    assert sum(len(p.rows) for p in found) == len(s)


def test_a_shuttle_turns_round(straight):
    """There, back and there again; the passes meet where it turned."""
    s = np.concatenate([np.arange(0, 150, 0.5), np.arange(150, 30, -0.5), np.arange(30, 180, 0.5)])
    found = split_passes(s, straight)
    assert [p.forward for p in found] == [True, False, True]
    assert found[1].chainage[[0, -1]] == pytest.approx([150.0, 30.0])
    grid = np.array([10.0, 100.0, 160.0])
    back = found[1].on(grid, np.arange(len(s), dtype=float))
    assert np.isnan(back[[0, 2]]).all()
    assert s[round(back[1])] == pytest.approx(100.0)


def test_a_stop_and_a_small_rollback_are_no_turn(straight):
    """It stands, rolls back 1 m, goes on: one pass, each place when the train last left it."""
    s = np.concatenate([np.arange(0, 80, 0.5), np.full(50, 79.5), np.arange(79.5, 78.5, -0.1)])
    s = np.concatenate([s, np.arange(78.5, 150.0, 0.5)])
    found = split_passes(s, straight)
    assert len(found) == 1
    assert (np.diff(found[0].chainage) > 0.0).all()


def test_a_train_that_stays_has_no_pass(straight):
    rng = np.random.default_rng(2)
    assert split_passes(10.0 + 0.05 * rng.standard_normal(500), straight) == []

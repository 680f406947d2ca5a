"""The methods by name over one simulated run."""

import numpy as np
import pytest

from track_localization.cli.train.reproduce_runs import measurements
from track_localization.sim.train import scenario, simulate_train
from track_localization.track.centreline import Centreline
from train_localization.config import TrainConfig
from train_localization.methods import (
    MAP,
    METHODS,
    ROBUST,
    SMOOTHED,
    GivenStart,
    modes_of,
    run_methods,
)


@pytest.fixture(scope='module')
def run():
    return simulate_train(scenario('paper'), 1)


@pytest.fixture(scope='module')
def start(run):
    s = run.start
    return GivenStart(s.time_s, s.position, s.quaternion, s.covariance)


@pytest.fixture(scope='module')
def heard(run):
    return list(measurements(run))


@pytest.fixture(scope='module')
def found(run, heard, start):
    begun = []
    track = Centreline.from_track(run.track)
    results = list(
        run_methods(heard, TrainConfig(), track, run.datum, METHODS, begun.append, start)
    )
    assert begun == list(METHODS)
    return {result.name: result for result in results}


def test_every_method_follows_the_train(run, found):
    """Ten estimates a second from the start on; 2 km in the plane would be another line."""
    assert list(found) == list(METHODS)
    for result in found.values():
        t = result.trajectory
        assert (np.diff(t.time_s) > 0.0).all()
        assert len(t) > 9.0 * run.duration_s
        before = t[t.time_s < run.outages[0][0]]
        off = before.position - run.truth().position_at(before.time_s)
        # 1 m class fixes; nothing should be lost before the outage.
        assert np.median(np.hypot(off[:, 0], off[:, 1])) < 5.0
        assert result.velocity_covariance.shape == (len(t), 3, 3)
        assert result.runtime_s > 0.0
        assert not any('early' in note for note in result.notes)


def test_chainage_comes_with_a_track(run, found, heard, start):
    near = found[MAP].trajectory
    true = np.interp(near.time_s, run.time_s, run.chainage)
    assert np.median(np.abs(near.chainage - true)) < 2.0
    (without,) = run_methods(heard[:3000], TrainConfig(), None, run.datum, [ROBUST], start=start)
    assert without.trajectory.chainage is None


def test_modes_change_with_the_satellites(run, found):
    begin, end = run.outages[0]
    for name, mode in (('ins', 'SINS'), (ROBUST, 'SINS/DR'), (SMOOTHED, 'SINS/DR')):
        changes = found[name].modes
        assert [m for _, m in changes] == ['BDS/SINS', mode, 'BDS/SINS']
        # It is noticed when fixes have been missing for some seconds, and with the next fix.
        assert begin < changes[1][0] < begin + 5.0
        assert end < changes[2][0] < end + 2.5


def test_without_a_track_robust_is_smoothed_and_the_map_left_out(run, heard, start):
    found = list(
        run_methods(heard[:3000], TrainConfig(), None, run.datum, (MAP, SMOOTHED), None, start)
    )
    assert [result.name for result in found] == [SMOOTHED]
    assert any(ROBUST in note for note in found[0].notes)


def test_a_smoothed_run_costs_its_forward_run_too(found):
    assert found[SMOOTHED].runtime_s > found[MAP].runtime_s


def test_nothing_heard_gives_nothing_and_says_so(run):
    for result in run_methods([], TrainConfig(), None, run.datum, METHODS):
        assert len(result.trajectory) == 0
        assert result.modes == modes_of([]) == []
        assert any('no estimate' in note for note in result.notes)

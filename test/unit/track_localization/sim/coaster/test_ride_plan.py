"""Ride plans as files: round trip, the shipped ones, and what is said of bad ones."""

from pathlib import Path

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.sim.coaster import TRACKS
from track_localization.sim.coaster.ride_plan import RidePlan, Zone, read_plan, write_plan
from track_localization.sim.coaster.tracks import built_in
from track_localization.track.track_file import read_track

SHIPPED = Path(__file__).parents[5] / 'config' / 'tracks'


@pytest.mark.parametrize('name', TRACKS)
def test_shipped_files_are_the_built_in_tracks(name, tmp_path):
    """config/tracks is what ``simulate coaster --ship`` writes now."""
    track = built_in(name)
    assert read_plan(SHIPPED / f'{name}.yaml') == track.plan
    file = read_track(SHIPPED / f'{name}.csv')
    np.testing.assert_allclose(file.position, track.file.position, atol=1e-6)
    np.testing.assert_allclose(file.up, track.file.up, atol=1e-6)
    write_plan(tmp_path / 'again.yaml', track.plan, track.title)
    assert (tmp_path / 'again.yaml').read_text() == (SHIPPED / f'{name}.yaml').read_text()


def test_defaults_stand_in_for_what_is_not_said(tmp_path):
    """A short file is enough: one zone."""
    path = tmp_path / 'ride.yaml'
    path.write_text('zones:\n- {kind: tyres, start_m: 0, end_m: 50, speed_mps: 2, accel_mps2: 1}\n')
    plan = read_plan(path)
    assert plan.zones == (Zone('tyres', 0.0, 50.0, 2.0, 1.0),)
    assert plan.train == RidePlan().train
    assert len(plan.phases) == 1


BAD = {
    'zones: []': 'zones: none given',
    'zones: 5': 'zones: expected a list',
    'zones: [7]': r'zones\[0\]: expected',
    'zones: [{kind: rocket, end_m: 5}]': r'zones\[0\].*rocket',
    'zones: [{kind: tyres, end_m: five}]': r'zones\[0\].*end_m',
    'zones: [{kind: tyres, end_m: 5, begin: 2}]': r'zones\[0\].*begin',
    'zones: [{kind: tyres, start_m: 9, end_m: 5}]': r'zones\[0\] \(tyres\): end_m must lie beyond',
    'train: {cars: 0}\nzones: [{kind: tyres, end_m: 5}]': 'cars',
    'train: 5\nzones: [{kind: tyres, end_m: 5}]': 'train: expected',
    'speed: 5\nzones: [{kind: tyres, end_m: 5}]': 'unknown setting',
    'phases: [{ends: never}]\nzones: [{kind: tyres, end_m: 5}]': r'phases\[0\].*never',
    'zones: [': 'not YAML',
}


@pytest.mark.parametrize('text', BAD)
def test_bad_plans_are_explained(text, tmp_path):
    """The error names the file, the entry and the field."""
    path = tmp_path / 'ride.yaml'
    path.write_text(text)
    with pytest.raises(DataError, match=BAD[text]) as caught:
        read_plan(path)
    assert str(path) in str(caught.value)


def test_block_stop_needs_a_block():
    """The shuttle has none."""
    with pytest.raises(DataError, match='block'):
        built_in('shuttle').plan.with_block_stop(20.0)

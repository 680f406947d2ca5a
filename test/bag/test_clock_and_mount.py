"""``evaluate`` and ``locate`` where markers and events have a clock of their own."""

import csv
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from track_localization.cli.evaluate import main as evaluate
from track_localization.cli.locate import main as locate
from track_localization.io.bags import BagWriter
from track_localization.io.tables import write_markers
from track_localization.sim.coaster import scenario, simulate_coaster
from track_localization.track.design_ride import write_design_ride

METHOD = 'track_filter_smoothed'


@pytest.fixture(scope='module')
def sim():
    return simulate_coaster('looping', scenario('clock_offset'), 2)


@pytest.fixture(scope='module')
def folder(sim, tmp_path_factory):
    """Return a folder with the ride and three events, at the ground's times of markers."""
    folder = tmp_path_factory.mktemp('ride')
    with BagWriter(folder / 'bag') as bag:
        bag.write_imu('imu/data_raw', sim.imu)
    write_design_ride(folder / 'design_ride.csv', sim.design)
    write_markers(folder / 'markers.csv', sim.markers)
    rows = [f'{t:.6f},{n}' for t, n in zip(sim.markers.time_s, sim.markers.name, strict=True)]
    (folder / 'events.csv').write_text('\n'.join(['time_s,name', *rows[::5]]) + '\n')
    return folder


def event_of(sim):
    """Return when by the ground's clock the true ride is at a fast place, and its chainage."""
    fast = int(np.argmax(sim.truth.speed))
    time_s = float(sim.truth.time_s[fast]) + sim.clock_offset_s
    return f'{time_s:.4f},{float(sim.truth.chainage[fast]):.3f}'


def places(folder, tmp_path, *arguments):
    output = tmp_path / 'places.csv'
    events = ['--events', str(folder / 'events.csv'), '--output', str(output)]
    assert locate([str(folder / 'bag'), *events, *arguments]) == 0
    return list(csv.DictReader(output.read_text().splitlines()))


def test_events_of_the_grounds_clock_are_located(sim, folder, tmp_path, capsys):
    """
    At the markers' own times the train is at the markers: within 0.3 m and within the interval.

    Without either way to the clock these events, nearly two seconds off, are tens of metres off.
    """
    for arguments in (['--clock-from-markers'], ['--clock-event', event_of(sim)]):
        for place in places(folder, tmp_path, *arguments):
            assert place['nearest_marker'] == place['name']
            distance = float(place['marker_distance_m'])
            assert distance < 0.3
            assert distance < float(place['chainage_95_m']) + 0.1
        said = capsys.readouterr().err
        assert '(95 %)' in said
        assert 'mount found: roll, pitch, yaw' in said
    uncorrected = [float(p['marker_distance_m']) for p in places(folder, tmp_path)]
    assert min(uncorrected) > 1.0


def test_a_place_that_is_never_passed_exits_with_1(folder, capsys):
    events = ['--events', str(folder / 'events.csv')]
    assert locate([str(folder / 'bag'), *events, '--clock-event', '60,9000']) == 1
    assert '9000 m is never passed' in capsys.readouterr().err


def test_markers_are_needed_where_they_give_the_clock(sim, tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_imu('imu/data_raw', sim.imu)
    write_design_ride(tmp_path / 'design_ride.csv', sim.design)
    (tmp_path / 'events.csv').write_text('time_s,name\n60.0,bang\n')
    events = ['--events', str(tmp_path / 'events.csv')]
    assert locate([str(tmp_path / 'bag'), *events, '--clock-from-markers']) == 1
    assert 'no markers.csv' in capsys.readouterr().err


def test_evaluate_tells_clock_and_mount(sim, folder, tmp_path, capsys):
    """Offset within four of its sigmas; the mount within 0.6 deg of the simulator's."""
    arguments = ['--methods', METHOD, '--no-plots', '--output', str(tmp_path / 'out')]
    event = ['--clock-event', event_of(sim)]
    assert evaluate(['coaster', str(folder / 'bag'), *arguments, *event]) == 0
    entry = json.loads((tmp_path / 'out' / 'metrics.json').read_text())['methods'][METHOD]
    error = entry['markers_clock_offset_s'] + sim.clock_offset_s
    assert abs(error) < 4.0 * entry['markers_clock_offset_sigma_s'] < 0.02
    R_bm = Rotation.from_euler('ZYX', entry['mount_rpy_deg'][::-1], degrees=True).as_matrix()
    assert np.rad2deg(Rotation.from_matrix(R_bm @ sim.R_bm.T).magnitude()) < 0.6
    said = capsys.readouterr().out
    offset = round(-1e3 * sim.clock_offset_s)
    assert any(f'{ms} ms +- ' in said for ms in range(offset - 8, offset + 9))
    assert 'clock event: the train passed' in said
    assert 'into the parameter file' in said

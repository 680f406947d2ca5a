"""``evaluate`` and ``locate`` over a simulated ride, from the command line to the files."""

import csv
import dataclasses
import json
import shutil

import numpy as np
import pytest

from track_localization.cli.evaluate import main as evaluate
from track_localization.cli.locate import main as locate
from track_localization.io.bags import BagWriter, list_topics, read_imu, read_odometry
from track_localization.io.tables import (
    Markers,
    read_markers,
    read_trajectory,
    write_markers,
)
from track_localization.io.tum import read_tum
from track_localization.settings import override
from track_localization.sim.coaster import CoasterSimConfig, simulate_coaster
from track_localization.track.design_ride import write_design_ride
from track_localization.track.track_file import write_track

METHODS = ('imu', 'dtw_z', 'srdtw_z', 'eskf', 'eskf_smoothed')
QUICK = ['--methods', 'dtw_z', '--no-plots']


@pytest.fixture(scope='module')
def ride(tmp_path_factory):
    """Return a folder as ``simulate`` leaves it: a ride of the launch coaster, seed 3."""
    folder = tmp_path_factory.mktemp('ride')
    config = override(CoasterSimConfig(), {'ride.dwell_before_s': (6.0, 6.0)})
    simulated = simulate_coaster('launch', config, 3)
    with BagWriter(folder / 'bag') as bag:
        bag.write_imu('imu/data_raw', simulated.imu)
        bag.write_odometry('ground_truth/odometry', simulated.truth)
    write_track(folder / 'track.csv', simulated.track)
    write_design_ride(folder / 'design_ride.csv', simulated.design)
    marks = simulated.markers
    write_markers(folder / 'markers.csv', Markers(marks.time_s, marks.name, marks.position))
    return folder


@pytest.fixture(scope='module')
def evaluated(ride, tmp_path_factory):
    """Return the folder that a full evaluation wrote."""
    output = tmp_path_factory.mktemp('evaluated')
    arguments = ['--methods', ','.join(METHODS), '--output', str(output)]
    assert evaluate(['coaster', str(ride / 'bag'), *arguments]) == 0
    return output


def metrics_of(folder):
    return json.loads((folder / 'metrics.json').read_text())


def copy_of(ride, tmp_path, *without):
    folder = tmp_path / 'copy'
    shutil.copytree(ride, folder)
    for name in without:
        (folder / name).unlink()
    return folder


def test_every_file_is_there(evaluated):
    for name in METHODS:
        rows = read_trajectory(evaluated / f'trajectory_{name}.csv')
        poses = read_tum(evaluated / f'trajectory_{name}.tum')
        assert len(poses) == len(rows) > 1000
    topics = list_topics(evaluated / 'results')
    assert {f'/{name}/odometry' for name in METHODS} < set(topics)
    assert {'/ground_truth/odometry', '/srdtw/pose', '/imu/data_raw'} < set(topics)
    fused = read_odometry(evaluated / 'results', 'eskf_smoothed/odometry')
    assert len(fused) == len(read_trajectory(evaluated / 'trajectory_eskf_smoothed.csv'))
    pictures = {path.name for path in evaluated.glob('*.png')}
    assert {'fig6_matching.png', 'fig12_paths.png', 'error_along_track.png'} <= pictures


def test_metrics_agree_with_the_files(ride, evaluated):
    """Marker and mean errors, worked out again from the written trajectory, bag and markers."""
    metrics = metrics_of(evaluated)
    assert metrics['system'] == 'coaster'
    assert set(metrics['methods']) == set(METHODS)
    estimate = read_trajectory(evaluated / 'trajectory_eskf_smoothed.csv')
    truth = read_odometry(ride / 'bag')
    markers = read_markers(ride / 'markers.csv')
    there = np.stack(
        [np.interp(markers.time_s, estimate.time_s, estimate.position[:, k]) for k in range(3)], 1
    )
    at_markers = np.linalg.norm(there - markers.position, axis=1)
    entry = metrics['methods']['eskf_smoothed']
    assert entry['markers_m']['mean'] == pytest.approx(at_markers.mean(), abs=1e-4)
    assert entry['markers_m']['max'] == pytest.approx(at_markers.max(), abs=1e-4)
    part = truth[np.linalg.norm(truth.velocity, axis=1) > 0.5]
    part = part[(part.time_s >= estimate.time_s[0]) & (part.time_s <= estimate.time_s[-1])]
    there = np.stack(
        [np.interp(part.time_s, estimate.time_s, estimate.position[:, k]) for k in range(3)], 1
    )
    error = np.linalg.norm(there - part.position, axis=1)
    assert entry['position_m']['mean'] == pytest.approx(error.mean(), rel=1e-3)
    assert entry['position_m']['p95'] == pytest.approx(np.percentile(error, 95), rel=1e-3)
    assert entry['ratio_to_matching']['markers_m'] > 0.0
    assert entry['real_time_factor'] == pytest.approx(
        entry['runtime_s'] / metrics['data']['duration_s']
    )


def test_fused_beats_its_parts(evaluated):
    """IMU alone drifts off by hundreds of metres; fused stays within a few on this ride."""
    methods = metrics_of(evaluated)['methods']
    assert methods['imu']['position_m']['max'] > 100.0
    assert methods['eskf_smoothed']['position_m']['mean'] < 3.0
    assert methods['eskf_smoothed']['markers_m']['median'] < 1.0


def test_report_needs_nothing_from_outside(evaluated):
    text = (evaluated / 'report.html').read_text()
    assert 'src="http' not in text
    assert 'href=' not in text
    assert text.count('data:image/png;base64,') == len(list(evaluated.glob('*.png')))
    assert all(name in text for name in (*METHODS, 'design_ride.csv', 'matcher.rate_hz'))


def test_without_truth_markers_remain(ride, tmp_path, capsys):
    folder = copy_of(ride, tmp_path)
    shutil.rmtree(folder / 'bag')
    imu, _ = read_imu(ride / 'bag')
    with BagWriter(folder / 'bag') as bag:
        bag.write_imu('phone/imu', imu)
    arguments = [str(folder / 'bag'), *QUICK, '--output', str(tmp_path / 'out')]
    assert evaluate(['coaster', *arguments, '--remap', 'imu/data_raw:=/phone/imu']) == 0
    entry = metrics_of(tmp_path / 'out')['methods']['dtw_z']
    assert 'markers_m' in entry
    assert not {'position_m', 'along_m', 'nees_mean', 'inside_2_sigma'} & set(entry)
    assert 'No ground truth' in capsys.readouterr().out
    assert (tmp_path / 'out' / 'trajectory_dtw_z.csv').exists()
    assert evaluate(['coaster', *arguments, '--truth-topic', 'gps/odom', '--remap',
                     'imu/data_raw:=/phone/imu']) == 1  # fmt: skip
    assert 'gps/odom' in capsys.readouterr().err


def test_without_markers_the_ride_remains(ride, tmp_path, capsys):
    folder = copy_of(ride, tmp_path, 'markers.csv', 'track.csv')
    storage = next((folder / 'bag').glob('*.mcap'))
    assert evaluate(['coaster', str(storage), *QUICK, '--output', str(tmp_path / 'out')]) == 0
    entry = metrics_of(tmp_path / 'out')['methods']['dtw_z']
    assert 'position_m' in entry
    assert 'markers_m' not in entry
    assert 'No markers.csv' in capsys.readouterr().out


def test_a_config_file_is_used(ride, tmp_path):
    config = tmp_path / 'coaster.yaml'
    config.write_text('srdtw_matcher:\n  ros__parameters:\n    matcher.rate_hz: 20.0\n')
    arguments = [str(ride / 'bag'), *QUICK, '--config', str(config), '--output', str(tmp_path)]
    assert evaluate(['coaster', *arguments]) == 0
    matched = read_trajectory(tmp_path / 'trajectory_dtw_z.csv')
    assert np.median(np.diff(matched.time_s)) == pytest.approx(0.05)
    assert 'matcher.rate_hz: 20.0 Hz   (default 50.0)' in (tmp_path / 'report.html').read_text()


@pytest.mark.parametrize(
    ('without', 'broken', 'words'),
    [
        ('design_ride.csv', '', ['design_ride.csv', '--design-ride']),
        ('', 'design_ride.csv', ['design_ride.csv', 'column']),
        ('', 'markers.csv', ['markers.csv', 'time_s']),
        ('', 'track.csv', ['track.csv']),
    ],
)
def test_files_missing_or_wrong_exit_with_1(ride, tmp_path, capsys, without, broken, words):
    folder = copy_of(ride, tmp_path, *([without] if without else []))
    if broken:
        (folder / broken).write_text('a,b\n1.0,2.0\n')
    output = tmp_path / 'out'
    assert evaluate(['coaster', str(folder / 'bag'), *QUICK, '--output', str(output)]) == 1
    said = capsys.readouterr().err
    assert said.startswith('error: ')
    assert all(word in said for word in words)
    assert not (output / 'metrics.json').exists()


def test_no_bag_exits_with_1_and_wrong_usage_with_2(tmp_path, capsys):
    assert evaluate(['coaster', str(tmp_path / 'none')]) == 1
    assert 'none' in capsys.readouterr().err
    for arguments in (
        ['coaster'],
        ['submarine', 'bag'],
        ['coaster', 'bag', '--methods', 'srdtw_w'],
        ['coaster', 'bag', '--remap', 'imu'],
    ):
        with pytest.raises(SystemExit) as error:
            evaluate(arguments)
        assert error.value.code == 2


def test_locate_answers_what_it_can(ride, tmp_path, capsys):
    """Events at three markers: each is found near its marker, the fourth is out of the ride."""
    markers = read_markers(ride / 'markers.csv')
    events = tmp_path / 'events.csv'
    rows = [f'{markers.time_s[k]:.6f},event {k}' for k in (2, 7, 12)]
    events.write_text('\n'.join(['time_s,name', *rows, '5.0,before']))
    places = tmp_path / 'places.csv'
    arguments = [str(ride / 'bag'), '--events', str(events), '--output', str(places)]
    assert locate([*arguments, '--method', 'eskf']) == 0
    assert 'outside the recording' in capsys.readouterr().out
    with places.open() as file:
        found = list(csv.DictReader(file))
    assert found[3]['x_m'] == ''
    assert found[3]['remark'].startswith('outside')
    for row, k in zip(found, (2, 7, 12), strict=False):
        position = np.array([float(row[c]) for c in ('x_m', 'y_m', 'z_m')])
        assert np.linalg.norm(position - markers.position[k]) < 3.0
        assert 0.0 < float(row['chainage_95_m']) < 10.0


def test_places_that_cannot_be_written_are_told_before_the_work(ride, tmp_path, capsys):
    events = tmp_path / 'events.csv'
    events.write_text('time_s,name\n5.0,bang\n')
    out = str(events / 'places.csv')
    assert locate([str(ride / 'bag'), '--events', str(events), '--output', out]) == 1
    said = capsys.readouterr().err
    assert f'error: --output {out}: cannot be made' in said
    assert 'locating' not in said


@pytest.mark.parametrize('fault', ['none', 'zeros', 'deg'])
def test_methods_that_need_an_unusable_gyro_are_left_out(ride, evaluated, tmp_path, capsys, fault):
    """The match on z is as good as with a gyro; nothing else is tabulated."""
    folder = copy_of(ride, tmp_path)
    imu, _ = read_imu(ride / 'bag')
    factor = {'none': np.nan, 'zeros': 0.0, 'deg': 180.0 / np.pi}[fault]
    with BagWriter(folder / 'bag', overwrite=True) as bag:
        bag.write_imu(
            'imu/data_raw', dataclasses.replace(imu, angular_rate=imu.angular_rate * factor)
        )
    out = tmp_path / 'out'
    arguments = ['coaster', str(folder / 'bag'), '--no-plots', '--output', str(out)]
    assert evaluate([*arguments, '--methods', 'dtw_z,eskf,track_filter']) == 0
    said = capsys.readouterr().out
    assert 'left out, as they need the gyro: eskf, track_filter (' in said
    assert set(metrics_of(out)['methods']) == {'dtw_z'}
    found, whole = (metrics_of(f)['methods']['dtw_z']['markers_m'] for f in (out, evaluated))
    assert found['mean'] == pytest.approx(whole['mean'], rel=0.1)
    assert evaluate([*arguments, '--methods', 'eskf']) == 1
    assert 'error: eskf: cannot be run' in capsys.readouterr().err


def test_without_gravity_nothing_is_run(ride, tmp_path, capsys):
    folder = copy_of(ride, tmp_path)
    imu, _ = read_imu(ride / 'bag')
    force = imu.specific_force - imu.specific_force[:300].mean(axis=0)
    with BagWriter(folder / 'bag', overwrite=True) as bag:
        bag.write_imu('imu/data_raw', dataclasses.replace(imu, specific_force=force))
    out = tmp_path / 'out'
    assert evaluate(['coaster', str(folder / 'bag'), *QUICK, '--output', str(out)]) == 1
    assert 'gravity was removed. Record' in capsys.readouterr().err.splitlines()[-1]
    assert not out.exists()

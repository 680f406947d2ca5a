"""``evaluate train`` over simulated runs, from the command line to the files."""

import json
import shutil
import struct

import numpy as np
import pytest
import yaml

from track_localization.cli.evaluate import main as evaluate
from track_localization.cli.simulate import main as simulate
from track_localization.io import codec
from track_localization.io.bags import BagWriter, list_topics, raw_messages, read_odometry
from track_localization.io.tables import read_trajectory
from track_localization.io.tum import read_tum
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train

METHODS = ('ins', 'paper', 'robust', 'robust_map', 'smoothed')
SEED = 3
SHORT = {
    'motion.distance_m': 4400.0,
    'motion.duration_s': 80.0,
    'gnss.outage_s': '40 60',
}
"""The paper's scenario in 80 s with 20 s without satellites."""
QUICK = ['--methods', 'robust', '--no-plots']


def simulated(folder, name='paper', **changes):
    """Simulate into ``folder`` by the command line; return the run itself, its truth included."""
    values = SHORT | changes
    values = {k: f'[{v.replace(" ", ", ")}]' if ' ' in str(v) else v for k, v in values.items()}
    given = [part for key, value in values.items() for part in ('--set', f'{key}={value}')]
    arguments = ['--scenario', name, '--seed', str(SEED), *given, '--output', str(folder)]
    assert simulate(['train', *arguments]) == 0
    return simulate_train(override(scenario(name), values), SEED)


@pytest.fixture(scope='module')
def ride(tmp_path_factory):
    """Return (folder as ``simulate`` leaves it, the simulated run)."""
    folder = tmp_path_factory.mktemp('ride')
    return folder, simulated(folder)


@pytest.fixture(scope='module')
def evaluated(ride, tmp_path_factory):
    """Return the folder that a full evaluation wrote."""
    output = tmp_path_factory.mktemp('evaluated')
    assert evaluate(['train', str(ride[0] / 'bag'), '--output', str(output)]) == 0
    return output


def metrics_of(folder):
    return json.loads((folder / 'metrics.json').read_text())


def changed(ride, tmp_path, change, files=('track.csv', 'datum.yaml')):
    """
    Write the ride anew, each message as ``change(topic, cdr)`` gives it back; None drops it.

    ``files`` stand beside it. Return the bag.
    """
    folder = tmp_path / 'changed'
    folder.mkdir()
    for name in files:
        shutil.copy(ride[0] / name, folder)
    with BagWriter(folder / 'bag') as bag:
        for topic, kind, time_ns, cdr in raw_messages(ride[0] / 'bag'):
            after = change(topic, cdr)
            if after is not None:
                bag.write_raw(topic, kind, time_ns, after)
    return folder / 'bag'


def without(*topics):
    return lambda topic, cdr: None if topic in topics else cdr


def level_errors(folder, name, run):
    """Return stamps and level errors (N,) of a written trajectory."""
    rows = read_trajectory(folder / f'trajectory_{name}.csv')
    off = rows.position - run.truth().position_at(rows.time_s)
    level = np.hypot(off[:, 0], off[:, 1])
    return rows.time_s[np.isfinite(level)], level[np.isfinite(level)]


def test_every_file_is_there(evaluated):
    for name in METHODS:
        rows = read_trajectory(evaluated / f'trajectory_{name}.csv')
        assert len(read_tum(evaluated / f'trajectory_{name}.tum')) == len(rows) > 600
        assert len(read_odometry(evaluated / 'results', f'{name}/odometry')) == len(rows)
    topics = set(list_topics(evaluated / 'results'))
    sensors = {'/imu/data_raw', '/gnss/fix', '/gnss/quality', '/wheel/twist', '/initialpose'}
    assert sensors | {'/ground_truth/odometry'} < topics
    pictures = {path.name for path in evaluated.glob('*.png')}
    wanted = {'way.png', 'error_by_time.png', 'level_error.png', 'speeds.png', 'modes.png'}
    assert wanted == pictures
    report = (evaluated / 'report.html').read_text()
    assert report.count('data:image/png;base64,') == len(pictures)


def test_metrics_agree_with_the_files_and_the_simulated_truth(ride, evaluated):
    metrics, run = metrics_of(evaluated), ride[1]
    assert metrics['system'] == 'train'
    assert list(metrics['methods']) == list(METHODS)
    assert metrics['data']['start_told']
    begin, end = metrics['data']['outages_s'][0]
    # Fixes come once a second: the last before the outage, the first after it.
    assert run.outages[0][0] - 1.1 < begin <= run.outages[0][0]
    assert run.outages[0][1] <= end < run.outages[0][1] + 4.1
    for name, entry in metrics['methods'].items():
        time, level = level_errors(evaluated, name, run)
        inside = (time >= begin) & (time < end)
        assert entry['horizontal_m']['median'] == pytest.approx(np.median(level), rel=0.01)
        assert entry['horizontal_m']['max'] == pytest.approx(level.max(), abs=1e-4)
        (passage,) = entry['outages']
        assert passage['max_m'] == pytest.approx(level[inside].max(), abs=1e-4)
        assert passage['end_m'] == pytest.approx(level[inside][-1], abs=1e-4)
        ends = passage['along_end_m'], passage['cross_end_m']
        assert np.hypot(*ends) == pytest.approx(passage['end_m'], rel=1e-6)
        assert entry['outage']['horizontal_m']['median'] == pytest.approx(
            np.median(level[inside]), rel=0.02
        )
        assert entry['covered'] > 0.95
        assert entry['real_time_factor'] == pytest.approx(
            entry['runtime_s'] / metrics['data']['duration_s']
        )
    assert metrics['methods']['robust']['rejected']['gnss']['no_fix'] >= 20


def test_robust_is_bounded_all_the_way(ride, evaluated):
    """
    Level errors: 4 m with fixes, 6 m through 20 s without.

    The fixes' own error is 0.85 m on either axis, and 4 m are four of their sigmas; 0.6 deg of yaw
    that the start may be off by, hardly corrected in 40 s, are 10 m a kilometre.
    """
    for name in ('robust', 'robust_map', 'smoothed'):
        time, level = level_errors(evaluated, name, ride[1])
        inside = (time >= ride[1].outages[0][0]) & (time < ride[1].outages[0][1] + 4.0)
        assert level[~inside].max() < 4.0
        assert level[inside].max() < 6.0
        assert np.diff(time).max() < 0.25


def test_the_tables_name_every_method_and_the_floor(ride, tmp_path, capsys):
    arguments = ['--methods', 'robust,smoothed', '--no-plots', '--output', str(tmp_path / 'out')]
    assert evaluate(['train', str(ride[0] / 'bag'), *arguments]) == 0
    said = capsys.readouterr().out
    for words in ('through the outages', 'fix before', 'along 95 %', 'NEES / 3', 'SINS/DR',
                  'no_fix', 'x real time', 'made of robust_map'):  # fmt: skip
        assert words in said
    assert not list((tmp_path / 'out').glob('*.png'))


@pytest.mark.parametrize(
    ('missing', 'words'),
    [
        ('/wheel/twist', 'No wheel/twist in the bag'),
        ('/gnss/quality', 'No gnss/quality in the bag'),
        ('/initialpose', None),
    ],
)
def test_without_a_topic_it_runs_and_says_so(ride, tmp_path, capsys, missing, words):
    """
    Whatever is left gives a trajectory over most of the run.

    Without its odometer the train coasts: 40 m are 0.2 m/s^2 over 20 s, twenty times what the
    platform's tilt of 0.1 deg pulls it by.
    """
    bag = changed(ride, tmp_path, without(missing))
    out = tmp_path / 'out'
    assert evaluate(['train', str(bag), *QUICK, '--output', str(out)]) == 0
    if words is not None:
        assert words in capsys.readouterr().out
    time, level = level_errors(out, 'robust', ride[1])
    assert np.ptp(time) > 0.8 * ride[1].duration_s
    assert level.max() < 40.0


def test_without_truth_figures_are_left_out(ride, tmp_path, capsys):
    bag = changed(ride, tmp_path, without('/ground_truth/odometry'))
    out = tmp_path / 'out'
    assert evaluate(['train', str(bag), *QUICK, '--output', str(out)]) == 0
    entry = metrics_of(out)['methods']['robust']
    assert not {'position_m', 'horizontal_m', 'outage', 'nees_mean'} & set(entry)
    assert entry['modes']
    assert 'No ground truth' in capsys.readouterr().out


def test_without_a_track_the_map_is_left_out(ride, tmp_path, capsys):
    bag = changed(ride, tmp_path, lambda _, cdr: cdr, files=('datum.yaml',))
    out = tmp_path / 'out'
    arguments = ['--methods', 'robust_map,robust', '--no-plots', '--output', str(out)]
    assert evaluate(['train', str(bag), *arguments]) == 0
    assert list(metrics_of(out)['methods']) == ['robust']
    assert 'robust_map is left out' in capsys.readouterr().out
    only = ['--methods', 'robust_map', '--output', str(tmp_path / 'none')]
    assert evaluate(['train', str(bag), *only]) == 1
    assert 'robust_map needs a track.csv' in capsys.readouterr().err


def test_without_a_datum_map_begins_at_the_first_fix(ride, tmp_path, capsys):
    """The start that is told cannot be placed then; the train finds its own."""
    bag = changed(ride, tmp_path, lambda _, cdr: cdr, files=())
    out = tmp_path / 'out'
    assert evaluate(['train', str(bag), *QUICK, '--output', str(out)]) == 0
    said = capsys.readouterr().out
    assert 'No datum.yaml' in said
    assert 'no datum says where map is' in said
    assert not metrics_of(out)['data']['start_told']
    time, level = level_errors(out, 'robust', ride[1])
    # Everything is off by what lies between the first fix and the truth's origin, and by no more.
    run = ride[1]
    away = np.interp(run.gnss.time_s[0], run.time_s, run.position[:, 0])
    away = np.hypot(away, np.interp(run.gnss.time_s[0], run.time_s, run.position[:, 1]))
    before = level[time < run.outages[0][0]]
    assert away > 20.0
    assert np.abs(before - away).max() < 6.0


def test_garbage_is_counted_by_sensor_and_reason(ride, tmp_path):
    """NaN samples and speeds, negative variances; the numbers stand at the end of messages."""
    seen = {'/imu/data_raw': 0, '/wheel/twist': 0}

    def spoil(topic, cdr):
        if topic not in seen:
            return cdr
        seen[topic] += 1
        data = bytearray(cdr)
        if topic == '/imu/data_raw' and seen[topic] % 500 == 0:
            struct.pack_into('<d', data, len(data) - 12 * 8, float('nan'))
        if topic == '/wheel/twist' and seen[topic] % 50 == 0:
            struct.pack_into('<d', data, len(data) - 36 * 8, -1.0)
        return bytes(data)

    bag = changed(ride, tmp_path, spoil)
    out = tmp_path / 'out'
    assert evaluate(['train', str(bag), *QUICK, '--output', str(out)]) == 0
    rejected = metrics_of(out)['methods']['robust']['rejected']
    assert rejected['imu']['not_finite'] == seen['/imu/data_raw'] // 500
    assert rejected['wheel']['bad_variance'] == seen['/wheel/twist'] // 50


def test_a_truncated_bag_is_evaluated_as_far_as_it_goes(ride, tmp_path, capsys):
    content = next((ride[0] / 'bag').glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[: len(content) // 2])
    shutil.copy(ride[0] / 'datum.yaml', tmp_path)
    out = tmp_path / 'out'
    assert evaluate(['train', str(cut), *QUICK, '--output', str(out)]) == 0
    metrics = metrics_of(out)
    assert 0.2 * ride[1].duration_s < metrics['data']['duration_s'] < 0.8 * ride[1].duration_s
    assert metrics['data']['rejected']['bag']['unreadable'] >= 1
    assert 'unreadable' in capsys.readouterr().out


@pytest.mark.parametrize('kind', ['empty', 'none', 'other', 'type', 'datum', 'strange'])
def test_what_cannot_be_used_is_told_with_the_remedy(ride, tmp_path, capsys, kind):
    bag, more = tmp_path / 'bag', []
    words = {
        'empty': ['bag.mcap', 'empty'],
        'none': ['bag', 'no such file'],
        'other': ['imu/data_raw', '/radar/twist', '--remap'],
        'type': ['/gnss/fix', codec.TWIST, 'NavSatFix', '--remap'],
        'datum': ['datum.yaml', 'latitude_deg', 'number'],
        'strange': ['--remap odo', 'wheel/twist'],
    }[kind]
    if kind == 'empty':
        bag = tmp_path / 'bag.mcap'
        bag.touch()
    elif kind in ('other', 'type'):
        wanted = ['wheel/twist'] if kind == 'other' else ['wheel/twist', 'imu/data_raw']
        with BagWriter(bag) as writer:
            for topic, name, time_ns, cdr in raw_messages(ride[0] / 'bag', wanted):
                place = topic if kind == 'type' else 'radar/twist'
                writer.write_raw(place, name, time_ns, cdr)
                if topic == 'wheel/twist':
                    writer.write_raw('gnss/fix', name, time_ns, cdr)
    elif kind == 'datum':
        shutil.copytree(ride[0] / 'bag', bag)
        (tmp_path / 'datum.yaml').write_text('latitude_deg: north\n')
    elif kind == 'strange':
        bag, more = ride[0] / 'bag', ['--remap', 'odo:=/wheel']
    out = tmp_path / 'out'
    assert evaluate(['train', str(bag), *QUICK, *more, '--output', str(out)]) == 1
    said = capsys.readouterr().err
    assert 'error: ' in said
    assert all(word in said for word in words)
    assert not (out / 'metrics.json').exists()


def test_settings_of_file_and_command_line_are_told_in_the_report(ride, tmp_path):
    config = tmp_path / 'train.yaml'
    section = {'train_kf': {'ros__parameters': {'imu': {'grade': 'tactical'}}}}
    config.write_text(yaml.safe_dump(section))
    arguments = [*QUICK, '--config', str(config), '--set', 'wheel.sigma_mps=0.3']
    bag = str(ride[0] / 'bag')
    assert evaluate(['train', bag, *arguments, '--output', str(tmp_path / 'out')]) == 0
    report = (tmp_path / 'out' / 'report.html').read_text()
    assert 'imu.grade: tactical   (default industrial)' in report
    assert 'wheel.sigma_mps: 0.3 m/s   (default' in report


def test_bad_data_of_every_kind_is_survived(tmp_path):
    """Scenario ``bad``: NaN, wrong stamps, gaps, a stuck odometer, far fixes without covariance."""
    short = {'motion.legs': 1, 'motion.stand_s': 10.0, 'motion.leg_m': '4000 4500'}
    short = {**short, 'terrain.tunnels': '0 0', 'terrain.cuttings': '0 0'}
    run = simulated(tmp_path, 'bad', **{**short, 'gnss.outage_s': '0 0'})
    out = tmp_path / 'out'
    assert evaluate(['train', str(tmp_path / 'bag'), *QUICK, '--output', str(out)]) == 0
    entry = metrics_of(out)['methods']['robust']
    assert {'imu', 'wheel', 'gnss'} <= set(entry['rejected'])
    time, level = level_errors(out, 'robust', run)
    # Three fixes in a row are 80 m off, and a stuck odometer that is believed for 15 s of braking
    # at 0.7 m/s^2 is 79 m wrong.
    assert np.median(level) < 3.0
    assert level.max() < 60.0
    assert np.ptp(time) > 0.5 * run.duration_s

"""``evaluate maglev`` over simulated runs, from the command line to the files."""

import json
import shutil
import struct
from pathlib import Path

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
from track_localization.sim.maglev import scenario, simulate_maglev

METHODS = ('paper', 'robust', 'kalman')
SEED = 5
SHORT = {'line.length_m': 2600.0, 'line.stops_m': '0 1300 2600'}
"""A run of three minutes over two balises with one stop; the errors are those of ``line``."""
QUICK = ['--methods', 'robust', '--no-plots']
SHIPPED = Path(__file__).parents[2] / 'bags' / 'maglev_line'


def simulated(folder, name='line', **changes):
    """Simulate into ``folder`` by the command line; return the run itself, its truth included."""
    values = SHORT | changes
    given = [part for key, value in values.items() for part in ('--set', f'{key}={value}')]
    arguments = ['--scenario', name, '--seed', str(SEED), *given, '--output', str(folder)]
    assert simulate(['maglev', *arguments]) == 0
    return simulate_maglev(override(scenario(name), values), SEED)


@pytest.fixture(scope='module')
def ride(tmp_path_factory):
    """Return (folder as ``simulate`` leaves it, the simulated run)."""
    folder = tmp_path_factory.mktemp('ride')
    return folder, simulated(folder)


@pytest.fixture(scope='module')
def evaluated(ride, tmp_path_factory):
    """Return the folder that a full evaluation wrote."""
    output = tmp_path_factory.mktemp('evaluated')
    assert evaluate(['maglev', str(ride[0] / 'bag'), '--output', str(output)]) == 0
    return output


def metrics_of(folder):
    return json.loads((folder / 'metrics.json').read_text())


def changed(ride, tmp_path, change):
    """
    Write the ride anew, each message as ``change(topic, cdr)`` gives it back; None drops it.

    The table stands beside it. Return the bag.
    """
    folder = tmp_path / 'changed'
    folder.mkdir()
    shutil.copy(ride[0] / 'balises.csv', folder)
    with BagWriter(folder / 'bag') as bag:
        for topic, kind, time_ns, cdr in raw_messages(ride[0] / 'bag'):
            after = change(topic, cdr)
            if after is not None:
                bag.write_raw(topic, kind, time_ns, after)
    return folder / 'bag'


def errors_of(folder, name, run):
    """Return stamps, chainage errors and sigmas of a written trajectory while the train moves."""
    rows = read_trajectory(folder / f'trajectory_{name}.csv')
    speed = np.interp(rows.time_s, run.time_s, run.speed, left=0.0, right=0.0)
    true = np.interp(rows.time_s, run.time_s, run.chainage)
    moves = speed > 0.5
    return rows.time_s[moves], (rows.chainage - true)[moves], rows.sigma_along[moves]


def test_every_file_is_there(evaluated):
    for name in METHODS:
        rows = read_trajectory(evaluated / f'trajectory_{name}.csv')
        assert len(read_tum(evaluated / f'trajectory_{name}.tum')) == len(rows) > 1000
        assert len(read_odometry(evaluated / 'results', f'{name}/odometry')) == len(rows)
    topics = set(list_topics(evaluated / 'results'))
    assert {'/loop/pose', '/radar/twist', '/balise/pose', '/ground_truth/odometry'} < topics
    pictures = {path.name for path in evaluated.glob('*.png')}
    assert {'error_along_track.png', 'speeds.png', 'health.png'} < pictures
    report = (evaluated / 'report.html').read_text()
    assert report.count('data:image/png;base64,') == len(pictures)


def test_metrics_agree_with_the_files_and_the_simulated_truth(ride, evaluated):
    metrics = metrics_of(evaluated)
    assert metrics['system'] == 'maglev'
    assert set(metrics['methods']) == set(METHODS)
    for name, entry in metrics['methods'].items():
        time, error, sigma = errors_of(evaluated, name, ride[1])
        # Half a dozen epochs stand on the border between rest and motion.
        close = {'rel': 0.01}
        assert entry['position_m']['rmse'] == pytest.approx(np.sqrt(np.mean(error**2)), **close)
        assert entry['along_m']['p95'] == pytest.approx(np.percentile(np.abs(error), 95), **close)
        assert entry['position_m']['max'] == pytest.approx(np.abs(error).max(), abs=1e-4)
        assert entry['nees_mean'] == pytest.approx(np.mean((error / sigma) ** 2), rel=0.02)
        assert entry['inside_2_sigma'] == pytest.approx(
            np.mean(np.abs(error) <= 2.0 * sigma), abs=0.01
        )
        later = error[time >= ride[1].balise.time_s[0]]
        since = entry['from_first_balise']['position_m']
        assert since['rmse'] == pytest.approx(np.sqrt(np.mean(later**2)), **close)
        assert since['max'] == pytest.approx(np.abs(later).max(), abs=1e-4)
        assert entry['real_time_factor'] == pytest.approx(
            entry['runtime_s'] / metrics['data']['duration_s']
        )
        # Sensors that fall silent together leave gaps of up to 2 s.
        assert entry['covered'] > 0.97


def test_robust_stays_on_the_line_all_the_way(ride, evaluated):
    """
    Every epoch from the first balise on is within 1 m (the paper's claim) and 5 sigma.

    A run of another seed misses the 1 m only when hundreds of crossings are lost in one go; 5
    sigma, where 3600 epochs of a Gaussian reach 3.6, allows for the modes of the posterior.
    """
    time, error, sigma = errors_of(evaluated, 'robust', ride[1])
    later = time >= ride[1].balise.time_s[0]
    assert np.abs(error[later]).max() < 1.0
    assert (np.abs(error) < 5.0 * sigma).all()
    assert np.diff(time).max() < 25.0  # nothing is left out but the stop


def test_a_line_with_curves_is_in_map(tmp_path):
    """Positions are on the simulated line; the chainage is the distance along it, not x."""
    run = simulated(tmp_path, 'curved')
    out = tmp_path / 'out'
    assert evaluate(['maglev', str(tmp_path / 'bag'), *QUICK, '--output', str(out)]) == 0
    rows = read_trajectory(out / 'trajectory_robust.csv')
    truth = run.truth()
    there = truth.position_at(rows.time_s)
    along = np.interp(rows.time_s, run.time_s, run.chainage)
    inside = np.isfinite(there[:, 0])
    off = np.linalg.norm(rows.position - there, axis=1)[inside]
    # A place on the line that is wrong by d along it is off by d in space, and by nothing else.
    np.testing.assert_allclose(off, np.abs(rows.chainage - along)[inside], atol=0.02)
    assert np.ptp(truth.position[:, 1]) > 50.0
    entry = metrics_of(out)['methods']['robust']
    assert entry['from_first_balise']['position_m']['max'] < 1.0


@pytest.mark.parametrize(
    ('missing', 'words', 'bound_m'),
    [
        # All that is left is the radar: 3 % for 15 s of slip and 1 % of its scale over 1 km.
        ('/loop/pose', 'without the loop', 23.0),
        ('/radar/twist', 'without the radar', 1.0),
        # What the start is known to, 1 m twice, and a metre for all that the loop has lost.
        ('/balise/pose', 'without the balise', 3.0),
    ],
)
def test_without_a_sensor_it_runs_and_says_so(ride, tmp_path, capsys, missing, words, bound_m):
    """Whatever is left gives a trajectory over most of the run, bounded once a balise was heard."""
    bag = changed(ride, tmp_path, lambda topic, cdr: None if topic == missing else cdr)
    out = tmp_path / 'out'
    assert evaluate(['maglev', str(bag), '--no-plots', '--output', str(out)]) == 0
    assert words in capsys.readouterr().out
    for name in METHODS:
        assert (out / f'trajectory_{name}.csv').exists()
    time, error, _ = errors_of(out, 'robust', ride[1])
    assert np.ptp(time) > 0.6 * np.ptp(ride[1].time_s)
    assert np.abs(error[time >= ride[1].balise.time_s[0]]).max() < bound_m


def test_without_truth_figures_are_left_out(ride, tmp_path, capsys):
    bag = changed(ride, tmp_path, lambda topic, cdr: None if topic.startswith('/ground') else cdr)
    out = tmp_path / 'out'
    assert evaluate(['maglev', str(bag), *QUICK, '--output', str(out)]) == 0
    entry = metrics_of(out)['methods']['robust']
    assert not {'position_m', 'speed_mps', 'nees_mean', 'from_first_balise'} & set(entry)
    assert entry['runtime_s'] > 0.0
    assert 'No ground truth' in capsys.readouterr().out


def test_garbage_is_counted_by_sensor_and_reason(ride, tmp_path):
    """NaN readings, negative variances and repeated messages; the numbers stand at the end."""
    seen = {'/loop/pose': 0, '/radar/twist': 0}

    def spoil(topic, cdr):
        if topic not in seen:
            return cdr
        seen[topic] += 1
        data = bytearray(cdr)
        if topic == '/loop/pose' and seen[topic] % 100 == 0:
            struct.pack_into('<d', data, len(data) - 43 * 8, float('nan'))
        if topic == '/radar/twist' and seen[topic] % 100 == 0:
            struct.pack_into('<d', data, len(data) - 36 * 8, -1.0)
        return bytes(data)

    bag = changed(ride, tmp_path, spoil)
    out = tmp_path / 'out'
    assert evaluate(['maglev', str(bag), '--no-plots', '--output', str(out)]) == 0
    for name in METHODS:
        rejected = metrics_of(out)['methods'][name]['rejected']
        assert rejected['loop']['not_finite'] == seen['/loop/pose'] // 100
        assert rejected['radar']['bad_variance'] == seen['/radar/twist'] // 100
    time, error, _ = errors_of(out, 'robust', ride[1])
    assert np.abs(error[time >= ride[1].balise.time_s[0]]).max() < 1.0


def test_a_truncated_bag_is_evaluated_as_far_as_it_goes(ride, tmp_path, capsys):
    content = next((ride[0] / 'bag').glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[: len(content) // 2])
    shutil.copy(ride[0] / 'balises.csv', tmp_path)
    out = tmp_path / 'out'
    assert evaluate(['maglev', str(cut), *QUICK, '--output', str(out)]) == 0
    metrics = metrics_of(out)
    whole = float(np.ptp(ride[1].loop.arrival_s))
    assert 0.2 * whole < metrics['data']['duration_s'] < 0.8 * whole
    assert metrics['data']['rejected']['bag']['unreadable'] >= 1
    assert 'unreadable' in capsys.readouterr().out


@pytest.mark.parametrize('kind', ['empty', 'none', 'coaster', 'type', 'table'])
def test_what_cannot_be_used_is_told_with_the_remedy(ride, tmp_path, capsys, kind):
    bag = tmp_path / 'bag'
    words = {
        'empty': ['bag.mcap', 'empty'],
        'none': ['bag', 'no such file'],
        'coaster': ['loop/pose', '/imu/data_raw', '--remap'],
        'type': ['/radar/twist', codec.POSE, codec.TWIST, '--remap'],
        'table': ['balises.csv', 'line 4', 'stands in line 3'],
    }[kind]
    if kind == 'empty':
        bag = tmp_path / 'bag.mcap'
        bag.touch()
    elif kind == 'coaster':
        message = codec.TYPESTORE.types[codec.IMU]
        assert message is not None
        with BagWriter(bag) as writer:
            writer.write_raw('imu/data_raw', codec.IMU, 10**12, bytes(400))
    elif kind == 'type':
        with BagWriter(bag) as writer:
            for topic, name, time_ns, cdr in raw_messages(ride[0] / 'bag', ['loop/pose']):
                writer.write_raw(topic, name, time_ns, cdr)
                writer.write_raw('radar/twist', name, time_ns, cdr)
    elif kind == 'table':
        shutil.copytree(ride[0] / 'bag', bag)
        rows = (ride[0] / 'balises.csv').read_text().splitlines()
        (tmp_path / 'balises.csv').write_text('\n'.join([*rows[:3], rows[2]]) + '\n')
    out = tmp_path / 'out'
    assert evaluate(['maglev', str(bag), *QUICK, '--output', str(out)]) == 1
    said = capsys.readouterr().err
    assert said.startswith('error: ')
    assert all(word in said for word in words)
    assert not (out / 'metrics.json').exists()


def test_another_seed_of_the_filters_is_told_in_the_report(ride, tmp_path):
    config = tmp_path / 'maglev.yaml'
    section = {'maglev_federated_pf': {'ros__parameters': {'seed': 4}}}
    config.write_text(yaml.safe_dump(section))
    arguments = [*QUICK, '--config', str(config), '--set', 'particles=300']
    bag = str(ride[0] / 'bag')
    assert evaluate(['maglev', bag, *arguments, '--output', str(tmp_path / 'out')]) == 0
    report = (tmp_path / 'out' / 'report.html').read_text()
    assert 'seed: 4   (default 1)' in report
    assert 'particles: 300   (default 1000)' in report


def test_the_shipped_bag_is_small_and_evaluates_as_it_is(tmp_path):
    """
    Its balises are found in it; the place is good to the paper's metre from the first one on.

    ``run_info.yaml`` tells that the loop loses dozens of crossings in it, 0.2 m each: whoever
    took the count at its word would be off by more.
    """
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 2_000_000
    told = yaml.safe_load((SHIPPED / 'run_info.yaml').read_text())
    lost = sum(count for _, count in told['injected']['loop']['bursts'])
    assert lost * told['config']['loop']['pitch_m'] > 2.0
    assert f'--seed {told["seed"]} ' in (SHIPPED / 'README.md').read_text()
    assert evaluate(['maglev', str(SHIPPED), *QUICK, '--output', str(tmp_path)]) == 0
    metrics = metrics_of(tmp_path)
    assert metrics['data']['files']['balises'] == str(SHIPPED / 'balises.csv')
    entry = metrics['methods']['robust']
    assert entry['from_first_balise']['position_m']['max'] < 1.0
    assert entry['covered'] > 0.97

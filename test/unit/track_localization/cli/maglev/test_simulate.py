"""The command ``simulate maglev``: files, exit codes, messages."""

import numpy as np
import pytest
import yaml

from track_localization.cli.simulate import main
from track_localization.io.bags import list_topics, messages, read_odometry
from track_localization.io.codec import POSE, TWIST
from track_localization.io.sensors import ScalarTopic, read_sensors
from track_localization.settings import override
from track_localization.sim.maglev import scenario, simulate_maglev
from track_localization.track.balise_table import read_balises
from track_localization.track.centreline import Centreline
from track_localization.track.track_file import read_track

SHORT = {'line.length_m': 1400.0, 'line.stops_m': '0 600 1400', 'balise.spacing_m': 250.0}
SHORT['balise.first_m'] = 250.0
SENSORS = (
    ScalarTopic('loop', 'loop/pose', POSE),
    ScalarTopic('radar', 'radar/twist', TWIST),
    ScalarTopic('balise', 'balise/pose', POSE),
)


def simulated(out, *args, name='line'):
    settings = [part for k, v in SHORT.items() for part in ('--set', f'{k}={v}')]
    return main(['maglev', '--scenario', name, *settings, *args, '--output', str(out)])


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a simulated run's folder, on a line with curves."""
    out = tmp_path_factory.mktemp('run')
    assert simulated(out, '--seed', '5', name='curved') == 0
    return out


@pytest.fixture(scope='module')
def wanted():
    return simulate_maglev(override(scenario('curved'), SHORT), 5)


def test_writes_everything(folder):
    assert list_topics(folder / 'bag') == {
        '/loop/pose': POSE,
        '/radar/twist': TWIST,
        '/balise/pose': POSE,
        '/ground_truth/odometry': 'nav_msgs/msg/Odometry',
    }
    assert {p.name for p in folder.iterdir()} == {
        'bag',
        'balises.csv',
        'track.csv',
        'run_info.yaml',
    }


def test_run_info_tells_how_it_was_made(folder, wanted):
    """Seed, scenario, every setting, and what was injected."""
    info = yaml.safe_load((folder / 'run_info.yaml').read_text())
    assert (info['system'], info['scenario'], info['seed']) == ('maglev', 'curved', 5)
    assert info['line_length_m'] == 1400.0
    assert info['config']['balise']['spacing_m'] == 250.0
    assert info['config']['delivery']['latency_s'] == [0.010, 0.030]
    assert info['injected'] == wanted.info


def test_bag_holds_the_simulated_run(folder, wanted):
    """Every message, to the stamps' nanosecond, in the order of arrival; frames as agreed."""
    readings = read_sensors(folder / 'bag', SENSORS)
    assert not readings.rejected
    names = [name for name, _ in wanted.arrivals()]
    assert list(readings.sensor) == names
    for name, stream in (('loop', wanted.loop), ('radar', wanted.radar), ('balise', wanted.balise)):
        rows = np.flatnonzero(np.array(names) == name)
        order = np.argsort(stream.arrival_s, kind='stable')
        for got, expected in zip(
            (readings.time_s, readings.arrival_s, readings.value, readings.variance),
            stream.columns(),
            strict=True,
        ):
            np.testing.assert_allclose(got[rows], expected[order], rtol=1e-15, atol=2e-9)
        frames = {readings.frame[i] for i in rows}
        if name == 'balise':
            assert [readings.frame[i] for i in rows] == [
                f'balise_{wanted.balise.id[i]}' for i in order
            ]
        else:
            assert frames == {'track' if name == 'loop' else 'base_link'}


def test_the_file_itself_is_in_order_of_log_time(folder):
    logged = [ns for _, ns, _ in messages(folder / 'bag')]
    assert (np.diff(logged) >= 0).all()


def test_truth_lies_on_the_line_of_the_track(folder, wanted):
    """Position by the file's line at the true chainage; body-frame speed ahead."""
    truth = read_odometry(folder / 'bag')
    np.testing.assert_allclose(truth.time_s, wanted.time_s, atol=2e-9)
    line = Centreline.from_track(read_track(folder / 'track.csv'))
    np.testing.assert_allclose(line.position(wanted.chainage), truth.position, atol=1e-4)
    np.testing.assert_allclose(truth.speed, wanted.speed, atol=1e-12)
    ahead = np.sum(truth.velocity * line.tangent(wanted.chainage), axis=1)
    np.testing.assert_allclose(ahead, wanted.speed, atol=1e-4)


def test_balise_table(folder):
    table = read_balises(folder / 'balises.csv')
    np.testing.assert_array_equal(table.chainage, [250.0, 500.0, 750.0, 1000.0, 1250.0])
    np.testing.assert_array_equal(table.sigma, 0.05)


def test_a_straight_run_leaves_no_track_of_the_one_before(tmp_path):
    """Else ``evaluate`` would take the old line for this one's."""
    assert simulated(tmp_path, name='curved') == 0
    assert (tmp_path / 'track.csv').exists()
    assert simulated(tmp_path, name='line') == 0
    assert not (tmp_path / 'track.csv').exists()
    other = tmp_path / 'other'
    other.mkdir()
    (other / 'track.csv').write_text('mine')
    assert simulated(other, name='line') == 0
    assert (other / 'track.csv').read_text() == 'mine'


def test_same_seed_same_readings(tmp_path, folder):
    assert simulated(tmp_path / 'again', '--seed', '5', name='curved') == 0
    first, again = (
        [(topic, ns) for topic, ns, _ in messages(f / 'bag')] for f in (folder, tmp_path / 'again')
    )
    assert first == again
    values = [read_sensors(f / 'bag', SENSORS).value for f in (folder, tmp_path / 'again')]
    np.testing.assert_array_equal(*values)


def test_list(capsys):
    assert main(['maglev', '--list']) == 0
    text = capsys.readouterr().out
    for name in ('line', 'paper_missed', 'wrongid20', 'loopfrozen', 'curved', 'long'):
        assert f'\n  {name} ' in text


def test_help_lists_every_setting(capsys):
    """Name, default, unit and meaning."""
    with pytest.raises(SystemExit) as caught:
        main(['maglev', '--help'])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert 'loop.pitch_m = 0.2 m' in text
    assert 'delivery.late_s = [0.2, 1.0] s' in text
    assert 'motion.speed_mps = 27.8 m/s' in text


@pytest.mark.parametrize(
    'args',
    [
        [],
        ['--output', 'x', '--scenario', 'hail'],
        ['--output', 'x', '--set', 'loop.pitch=3'],
        ['--output', 'x', '--set', 'loop.pitch_m'],
        ['--output', 'x', '--set', 'loop.pitch_m=-1'],
        ['--output', 'x', '--set', 'loop.pitch_m=wide'],
        ['--output', 'x', '--set', 'motion.dwell_s=[1, 2, 3]'],
        ['--output', 'x', '--set', 'motion.profile=flying'],
        ['--output', 'x', '--seed', 'one'],
        ['--output', 'x', '--seed', '-3'],
    ],
)
def test_wrong_usage_exits_with_2(args, tmp_path, monkeypatch):
    """Nothing is written."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main(['maglev', *args])
    assert caught.value.code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('args', 'reason'),
    [
        (['--set', 'motion.dwell_s=[9, 3]'], 'lesser first'),
        (['--set', 'line.stops_m=0 9000'], 'line.length_m'),
        (['--set', 'balise.first_m=8000'], 'a line needs a balise'),
    ],
)
def test_unusable_settings_exit_with_1(args, reason, tmp_path, monkeypatch, capsys):
    """The reason is on stderr, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    assert main(['maglev', *args, '--output', 'out']) == 1
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_output_that_cannot_be_made(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert simulated(tmp_path / 'file' / 'out') == 1
    assert '--output' in capsys.readouterr().err

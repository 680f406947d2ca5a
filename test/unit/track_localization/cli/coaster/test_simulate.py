"""The simulate command: files, exit codes, messages."""

import numpy as np
import pytest
import yaml

from track_localization.cli.simulate import main
from track_localization.io.bags import list_topics, read_imu, read_odometry
from track_localization.io.tables import read_markers
from track_localization.sim.coaster import CoasterSimConfig, simulate_coaster
from track_localization.track.design_ride import read_design_ride
from track_localization.track.track_file import read_track

SHORT = ['--set', 'ride.dwell_before_s=[2, 2]', '--set', 'imu.rate_hz=50']


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a simulated ride's folder."""
    out = tmp_path_factory.mktemp('ride')
    assert main(['coaster', '--track', 'mine', '--seed', '5', *SHORT, '--output', str(out)]) == 0
    return out


def test_writes_everything(folder):
    """The bag has both topics; the tables stand beside it; ride_info says how it was made."""
    assert list_topics(folder / 'bag') == {
        '/imu/data_raw': 'sensor_msgs/msg/Imu',
        '/ground_truth/odometry': 'nav_msgs/msg/Odometry',
    }
    info = yaml.safe_load((folder / 'ride_info.yaml').read_text())
    assert (info['track'], info['seed'], info['scenario']) == ('mine', 5, 'nominal')
    assert info['config']['imu']['rate_hz'] == 50.0
    assert len(read_markers(folder / 'markers.csv')) == 16


def test_bag_holds_the_simulated_ride(folder):
    """What is read back is what the library simulates, to the stamps' nanosecond."""
    from track_localization.settings import override

    config = override(CoasterSimConfig(), {'ride.dwell_before_s': (2.0, 2.0), 'imu.rate_hz': 50.0})
    ride = simulate_coaster('mine', config, 5)
    imu, rejected = read_imu(folder / 'bag')
    assert not any(rejected.values())
    np.testing.assert_allclose(imu.time_s, ride.imu.time_s, atol=2e-9)
    np.testing.assert_allclose(imu.specific_force, ride.imu.specific_force)
    truth = read_odometry(folder / 'bag')
    np.testing.assert_allclose(truth.position, ride.truth.position)
    design = read_design_ride(folder / 'design_ride.csv')
    np.testing.assert_allclose(design.position, ride.design.position, atol=1e-6)
    np.testing.assert_allclose(
        read_track(folder / 'track.csv').position, ride.track.position, atol=1e-8
    )


def test_own_track_with_its_ride_plan(folder, tmp_path):
    """A track file and a ride.yaml give a design ride: the same as the built-in's."""
    assert main(['coaster', '--ship', str(tmp_path / 'tracks')]) == 0
    out = tmp_path / 'own'
    args = ['--track', str(folder / 'track.csv'), '--ride', str(tmp_path / 'tracks' / 'mine.yaml')]
    assert main(['coaster', *args, '--seed', '5', *SHORT, '--output', str(out)]) == 0
    own, built = (read_design_ride(f / 'design_ride.csv') for f in (out, folder))
    assert len(own) == len(built)
    np.testing.assert_allclose(own.position, built.position, atol=1e-3)
    np.testing.assert_allclose(own.specific_force, built.specific_force, atol=0.02)


def test_list(capsys):
    """Tracks and scenarios, without writing anything."""
    assert main(['coaster', '--list']) == 0
    text = capsys.readouterr().out
    assert 'wooden' in text
    assert 'clip4g' in text


def test_help_lists_every_setting(capsys):
    """Name, default, unit and meaning."""
    with pytest.raises(SystemExit) as caught:
        main(['coaster', '--help'])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert 'imu.accel_bias = 0.04 m/s^2' in text
    assert 'ride.dwell_before_s = [8.0, 40.0] s' in text


@pytest.mark.parametrize(
    'args',
    [
        [],
        ['maglevator', '--output', 'x'],
        ['coaster'],
        ['coaster', '--output', 'x', '--scenario', 'hail'],
        ['coaster', '--output', 'x', '--set', 'imu.bias=3'],
        ['coaster', '--output', 'x', '--set', 'imu.rate_hz'],
        ['coaster', '--output', 'x', '--set', 'imu.rate_hz=-5'],
        ['coaster', '--output', 'x', '--seed', 'one'],
        ['coaster', '--output', 'x', '--seed', '-3'],
    ],
)
def test_wrong_usage_exits_with_2(args, tmp_path, monkeypatch):
    """Nothing is written."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main(args)
    assert caught.value.code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('args', 'reason'),
    [
        (['--track', 'nowhere.csv'], 'neither a file nor one of'),
        (['--track', 'bad.csv', '--ride', 'ride.yaml'], 'missing'),
        (['--track', 'bad.csv'], '--ride'),
        (['--track', 'mine', '--ride', 'none.yaml'], 'no such file'),
        (['--track', 'mine', '--ride', 'ride.yaml'], 'came to rest'),
        (['--track', 'shuttle', '--scenario', 'blockstop'], 'block'),
    ],
)
def test_unusable_data_exits_with_1(args, reason, tmp_path, monkeypatch, capsys):
    """The reason is on stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bad.csv').write_text('No.,PosX,PosY\n1,2,3\n')
    (tmp_path / 'ride.yaml').write_text('zones: [{kind: trim, end_m: 5}]')
    assert main(['coaster', *args, '--output', 'out']) == 1
    assert reason in capsys.readouterr().err


def test_output_that_cannot_be_made(tmp_path, capsys):
    (tmp_path / 'file').touch()
    out = str(tmp_path / 'file' / 'run')
    assert main(['coaster', '--track', 'mine', *SHORT, '--output', out]) == 1
    assert f'error: --output {out}: cannot be made' in capsys.readouterr().err
    assert main(['coaster', '--ship', out]) == 1
    assert f'error: --ship {out}: cannot be made' in capsys.readouterr().err

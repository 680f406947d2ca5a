"""The command ``simulate train``: files, exit codes, messages."""

import numpy as np
import pytest
import yaml

from track_localization.cli.simulate import main
from track_localization.geodesy import Datum, enu_from_geodetic
from track_localization.io.bags import list_topics, messages, read_odometry
from track_localization.io.codec import IMU, ODOMETRY, POSE, TWIST
from track_localization.io.gnss import DIAGNOSTICS, FIX, read_recorded
from track_localization.io.start_pose import read_start
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.track.centreline import Centreline
from track_localization.track.track_file import read_track

SHORT = {'motion.distance_m': 1650.0, 'motion.duration_s': 30.0, 'gnss.outage_s': [10.0, 20.0]}
SENSORS = {
    '/imu/data_raw': IMU,
    '/gnss/fix': FIX,
    '/gnss/quality': DIAGNOSTICS,
    '/wheel/twist': TWIST,
    '/ground_truth/odometry': ODOMETRY,
}


def simulated(out, *args, name='paper'):
    settings = [part for k, v in SHORT.items() for part in ('--set', f'{k}={v}')]
    return main(['train', '--scenario', name, *settings, *args, '--output', str(out)])


def wanted_of(name='paper', seed=5, **changes):
    changes = {k.replace('__', '.'): v for k, v in changes.items()}
    return simulate_train(override(scenario(name), {**SHORT, **changes}), seed)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a simulated run's folder."""
    out = tmp_path_factory.mktemp('run')
    assert simulated(out, '--seed', '5') == 0
    return out


@pytest.fixture(scope='module')
def wanted():
    return wanted_of()


def test_writes_everything(folder):
    assert list_topics(folder / 'bag') == {**SENSORS, '/initialpose': POSE}
    assert {p.name for p in folder.iterdir()} == {'bag', 'track.csv', 'datum.yaml', 'run_info.yaml'}


def test_run_info_tells_how_it_was_made(folder, wanted):
    """Seed, scenario, every setting, and what was injected."""
    info = yaml.safe_load((folder / 'run_info.yaml').read_text())
    assert (info['system'], info['scenario'], info['seed']) == ('train', 'paper', 5)
    assert info['config']['imu']['grade'] == 'industrial'
    assert info['config']['gnss']['outage_s'] == [10.0, 20.0]
    assert info['outages_s'] == [[1010.0, 1020.0]]
    assert info['injected'] == wanted.info


def test_datum(folder):
    """In degrees, as a user writes it."""
    datum = yaml.safe_load((folder / 'datum.yaml').read_text())
    assert datum == {'latitude_deg': 40.3458, 'longitude_deg': 116.0271, 'height_m': 500.0}


def test_bag_holds_the_simulated_run(folder, wanted):
    """Every message of every sensor; stamps to the nanosecond, angles to a nanometre on ground."""
    told = read_recorded(folder / 'bag')
    assert not told.rejected
    np.testing.assert_allclose(told.imu.time_s, wanted.imu.time_s, atol=2e-9)
    np.testing.assert_array_equal(told.imu.specific_force, wanted.imu.specific_force)
    np.testing.assert_array_equal(told.imu.angular_rate, wanted.imu.angular_rate)
    gnss, fixes = wanted.gnss, told.fixes
    np.testing.assert_allclose(fixes.time_s, gnss.time_s, atol=2e-9)
    np.testing.assert_allclose(told.arrival_s['gnss'], gnss.arrival_s, atol=2e-9)
    np.testing.assert_array_equal(fixes.valid, gnss.status)
    np.testing.assert_allclose(fixes.latitude, gnss.latitude, rtol=4e-16)
    np.testing.assert_allclose(fixes.longitude, gnss.longitude, rtol=4e-16)
    np.testing.assert_array_equal(fixes.height, gnss.height)
    np.testing.assert_array_equal(fixes.covariance[gnss.status], gnss.covariance[gnss.status])
    assert np.isnan(fixes.covariance[~gnss.status]).all()
    assert 8 < (~gnss.status).sum() < 12
    np.testing.assert_allclose(told.qualities.time_s, gnss.time_s, atol=2e-9)
    np.testing.assert_array_equal(told.qualities.satellites, gnss.satellites)
    np.testing.assert_allclose(told.qualities.hdop, gnss.hdop, atol=0.00501)
    wheel = wanted.wheel
    np.testing.assert_allclose(told.speeds.time_s, wheel.time_s, atol=2e-9)
    np.testing.assert_allclose(told.arrival_s['wheel'], wheel.arrival_s, atol=2e-9)
    np.testing.assert_array_equal(told.speeds.speed, wheel.speed)
    np.testing.assert_array_equal(told.speeds.variance, wheel.variance)


def test_frames_and_service(folder):
    frames = {}
    for topic, _, message in messages(folder / 'bag'):
        frames.setdefault(topic, set()).add(message.header.frame_id)
        if topic == '/gnss/fix':
            assert message.status.service == message.status.SERVICE_COMPASS
    assert frames == {
        '/imu/data_raw': {'imu_link'},
        '/gnss/fix': {'gnss'},
        '/gnss/quality': {'gnss'},
        '/wheel/twist': {'base_link'},
        '/ground_truth/odometry': {'map'},
        '/initialpose': {'map'},
    }


def test_the_file_itself_is_in_order_of_log_time(folder):
    """What is told of a fix comes just before it."""
    logged = [(topic, ns) for topic, ns, _ in messages(folder / 'bag')]
    assert (np.diff([ns for _, ns in logged]) >= 0).all()
    assert logged[0][0] == '/initialpose'
    receiver = [topic for topic, _ in logged if topic.startswith('/gnss')]
    assert receiver[::2] == ['/gnss/quality'] * (len(receiver) // 2)
    assert receiver[1::2] == ['/gnss/fix'] * (len(receiver) // 2)


def test_truth_fixes_and_track_lie_together(folder, wanted):
    """In ``map`` at the written datum: the truth as simulated, fixes and track near it."""
    truth = read_odometry(folder / 'bag')
    np.testing.assert_allclose(truth.time_s, wanted.time_s, atol=2e-9)
    np.testing.assert_array_equal(truth.position, wanted.position)
    np.testing.assert_allclose(truth.velocity, wanted.velocity, atol=1e-9)
    values = yaml.safe_load((folder / 'datum.yaml').read_text())
    datum = Datum(*np.radians([values['latitude_deg'], values['longitude_deg']]), 500.0)
    fixes = read_recorded(folder / 'bag').fixes
    good = fixes.valid
    places = enu_from_geodetic(fixes.latitude, fixes.longitude, fixes.height, datum)[good]
    off = np.linalg.norm(places - truth.position_at(fixes.time_s[good]), axis=1)
    assert np.median(off) < 4.0
    line = Centreline.from_track(read_track(folder / 'track.csv'))
    s = line.nearest(truth.position)
    assert np.linalg.norm(line.position(s) - truth.position, axis=1).max() < 2.0
    np.testing.assert_allclose(s, wanted.chainage, atol=0.2)


def test_an_aligned_start_is_told(folder, wanted):
    """Pose and covariance, rotations included; without one there is no such topic."""
    stamp, position, quaternion, covariance = read_start(folder / 'bag', 'initialpose')
    assert stamp == 1000.0
    np.testing.assert_array_equal(position, wanted.start.position)
    np.testing.assert_allclose(quaternion, wanted.start.quaternion, rtol=1e-15)
    np.testing.assert_array_equal(covariance, wanted.start.covariance)


def test_a_start_that_is_not_told_nor_a_wheel_nor_a_track(tmp_path):
    """Their topics and files are missing; a track of the run before is removed, not another's."""
    off = ('--set', 'survey.given=false', '--set', 'faults.no_wheel=true')
    off += ('--set', 'faults.no_quality=true')
    (tmp_path / 'mine').mkdir()
    (tmp_path / 'mine' / 'track.csv').write_text('mine')
    assert simulated(tmp_path / 'mine', *off) == 0
    assert (tmp_path / 'mine' / 'track.csv').read_text() == 'mine'
    assert simulated(tmp_path / 'run') == 0
    assert (tmp_path / 'run' / 'track.csv').exists()
    assert simulated(tmp_path / 'run', *off, name='moving') == 0
    assert not (tmp_path / 'run' / 'track.csv').exists()
    gone = ('/wheel/twist', '/gnss/quality')
    assert list_topics(tmp_path / 'run' / 'bag') == {
        topic: kind for topic, kind in SENSORS.items() if topic not in gone
    }


def test_bad_data_is_written_as_it_is(tmp_path):
    """NaN, stamps out of order, no covariance, no HDOP, a gap: nothing is mended on the way."""
    settings = {'faults.nan': 0.05, 'faults.time_jumps': 1, 'faults.imu_gap_s': 1.5}
    settings |= {'faults.no_covariance': True, 'faults.no_hdop': True, 'faults.stale_no_fix': True}
    args = [part for k, v in settings.items() for part in ('--set', f'{k}={v}')]
    assert simulated(tmp_path, '--seed', '5', *args) == 0
    told, wanted = read_recorded(tmp_path / 'bag'), wanted_of(**settings)
    np.testing.assert_allclose(told.imu.time_s, wanted.imu.time_s, atol=2e-9)
    assert (np.diff(told.imu.time_s) < -50.0).any()
    np.testing.assert_allclose(told.arrival_s['imu'], wanted.imu_arrival_s, atol=2e-9)
    for name in ('specific_force', 'angular_rate'):
        lost = np.isnan(getattr(wanted.imu, name)).any(axis=1)
        assert lost.any()
        np.testing.assert_array_equal(np.isnan(getattr(told.imu, name)).any(axis=1), lost)
    assert np.isnan(told.fixes.covariance).all()
    assert np.isnan(told.qualities.hdop).all()
    np.testing.assert_array_equal(told.qualities.satellites, wanted.gnss.satellites)
    assert np.isfinite(told.fixes.latitude[~told.fixes.valid]).all()
    np.testing.assert_array_equal(np.isnan(told.speeds.speed), np.isnan(wanted.wheel.speed))
    assert np.isnan(told.speeds.speed).any()


def test_same_seed_same_readings(tmp_path, folder):
    assert simulated(tmp_path / 'again', '--seed', '5') == 0
    assert simulated(tmp_path / 'other', '--seed', '6') == 0
    folders = (folder, tmp_path / 'again', tmp_path / 'other')
    first, again, other = ([(t, ns) for t, ns, _ in messages(f / 'bag')] for f in folders)
    assert first == again != other
    told = [read_recorded(f / 'bag') for f in folders]
    np.testing.assert_array_equal(told[0].imu.angular_rate, told[1].imu.angular_rate)
    assert (told[0].imu.angular_rate != told[2].imu.angular_rate).any()
    tables = [(f / 'track.csv').read_text() for f in folders]
    assert tables[0] == tables[1] != tables[2]


def test_list(capsys):
    assert main(['train', '--list']) == 0
    text = capsys.readouterr().out
    for name in (
        *('line', 'paper', 'slip', 'moving', 'mems', 'tactical', 'navigation'),
        *('wrongmap', 'bad'),
    ):
        assert f'\n  {name} ' in text


def test_help_lists_every_setting(capsys):
    """Name, default, unit and meaning."""
    with pytest.raises(SystemExit) as caught:
        main(['train', '--help'])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert 'odometer.pulse_m = 0.02 m' in text
    assert 'line.radius_m = [2200.0, 6000.0] m' in text
    assert 'imu.grade = industrial' in text


@pytest.mark.parametrize(
    'args',
    [
        [],
        ['--output', 'x', '--scenario', 'hail'],
        ['--output', 'x', '--set', 'odometer.pulse=3'],
        ['--output', 'x', '--set', 'odometer.pulse_m'],
        ['--output', 'x', '--set', 'odometer.pulse_m=-1'],
        ['--output', 'x', '--set', 'imu.grade=toy'],
        ['--output', 'x', '--set', 'gnss.outage_s=[1, 2, 3]'],
        ['--output', 'x', '--seed', 'one'],
        ['--output', 'x', '--seed', '-3'],
    ],
)
def test_wrong_usage_exits_with_2(args, tmp_path, monkeypatch):
    """Nothing is written."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main(['train', *args])
    assert caught.value.code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('args', 'reason'),
    [
        (['--set', 'odometer.slip_s=[4, 0.5]'], 'lesser first'),
    ],
)
def test_unusable_settings_exit_with_1(args, reason, tmp_path, monkeypatch, capsys):
    """The reason is on stderr, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    assert main(['train', *args, '--output', 'out']) == 1
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_output_that_cannot_be_made(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert simulated(tmp_path / 'file' / 'out') == 1
    assert '--output' in capsys.readouterr().err

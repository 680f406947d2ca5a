"""``evaluate maglev`` with methods of known errors: every figure worked out by hand."""

import csv
import json

import numpy as np
import pytest

from maglev_localization.methods import MethodResult
from track_localization.cli.maglev import evaluate
from track_localization.estimation.trajectory import Trajectory
from track_localization.io.bags import list_topics, raw_messages, read_odometry
from track_localization.io.tables import TRAJECTORY_COLUMNS, read_trajectory
from track_localization.io.tum import read_tum

HEALTH = [
    (1000.0, 'loop', 'ok'),
    (1000.0, 'radar', 'ok'),
    (1004.0, 'radar', 'silent'),
    (1006.5, 'radar', 'ok'),
]


def result(name: str, early_m: float, late_m: float, sigma_m: float = 0.5) -> MethodResult:
    """Estimates at 20 Hz, ``early_m`` ahead until balise A at 1007 s and ``late_m`` from it on."""
    time = np.arange(1000.0, 1021.8, 0.05)
    ridden = np.maximum(time - 1002.0, 0.0)
    s = 20.0 * ridden + np.where(time < 1007.0 - 1e-6, early_m, late_m)
    speed = np.where(ridden > 0.0, 20.0, 0.0) - 0.25
    zero = np.zeros_like(s)
    trajectory = Trajectory(
        time,
        np.stack([s, zero, zero], axis=1),
        chainage=s,
        speed=speed,
        sigma_along=np.full(len(s), sigma_m),
        sigma_speed=np.full(len(s), 0.1),
    )
    rejected = {'loop': {'gate': 7, 'not_finite': 1}} if name == 'robust' else {}
    return MethodResult(name, trajectory, rejected, 0.55, HEALTH, (f'a remark of {name}',))


RESULTS = {
    'paper': result('paper', 3.0, -2.0),
    'robust': result('robust', 0.6, 0.2),
    'kalman': result('kalman', 0.6, -0.2),
}


@pytest.fixture
def fake(monkeypatch):
    """Put the known results in the methods' place; return what they were called with."""
    called = []

    def run_methods(measurements, config, balises, line_length_m, methods, begin=None):
        called.append((measurements, config, balises, line_length_m, tuple(methods)))
        for name in methods:
            if begin is not None:
                begin(name)
            yield RESULTS[name]

    monkeypatch.setattr(evaluate, 'run_methods', run_methods)
    return called


def metrics_of(folder):
    return json.loads((folder / 'metrics.json').read_text())


def test_every_figure_by_hand(run, fake, tmp_path, capsys):
    """5 s at 0.6 m and 14.8 s at 0.2 m of error, with a claimed 0.5 m; rest at 0.6 m."""
    out = tmp_path / 'out'
    assert evaluate.main([str(run.bag), '--output', str(out), '--no-plots']) == 0
    metrics = metrics_of(out)
    assert metrics['system'] == 'maglev'
    assert metrics['bag'] == str(run.bag)
    assert metrics['commit']
    assert list(metrics['methods']) == ['paper', 'robust', 'kalman']
    robust = metrics['methods']['robust']
    early, late = 5.0, 14.8
    share = early / (early + late)
    square = share * 0.36 + (1 - share) * 0.04
    # One epoch of 396 stands on each of the edges: the shares are good to 1 %.
    for name in ('position_m', 'along_m'):
        assert robust[name]['rmse'] == pytest.approx(np.sqrt(square), rel=0.01)
        assert robust[name]['mean'] == pytest.approx(share * 0.6 + (1 - share) * 0.2, rel=0.01)
        assert robust[name]['median'] == pytest.approx(0.2, abs=1e-6)
        assert robust[name]['p95'] == pytest.approx(0.6, abs=1e-6)
        assert robust[name]['max'] == pytest.approx(0.6, abs=1e-6)
    assert robust['nees_mean'] == pytest.approx(square / 0.25, rel=0.02)
    assert robust['inside_2_sigma'] == 1.0
    assert robust['covered'] == pytest.approx(197.0 / 199.0)
    assert robust['standing_m']['mean'] == pytest.approx(0.6, abs=1e-6)
    assert robust['rejected'] == {'loop': {'gate': 7, 'not_finite': 1}}
    since = robust['from_first_balise']
    assert since['position_m']['rmse'] == pytest.approx(0.2, abs=1e-6)
    assert since['nees_mean'] == pytest.approx(0.16, abs=1e-6)
    assert since['speed_mps']['rmse'] == pytest.approx(0.25, abs=1e-6)
    paper = metrics['methods']['paper']
    assert paper['inside_2_sigma'] == 0.0
    assert paper['from_first_balise']['nees_mean'] == pytest.approx(16.0)
    # From the first message's arrival (10 ms late) to the last (20 ms late, 21.9 s on).
    assert metrics['data']['duration_s'] == pytest.approx(21.91, abs=1e-6)
    assert paper['runtime_s'] == 0.55
    assert paper['real_time_factor'] == pytest.approx(0.55 / 21.91)
    printed = capsys.readouterr()
    for word in ('RMSE', 'from the first balise on', 'refused', 'gate', 'a remark of paper',
                 'radar silent for 2.5 s', 'report.html'):  # fmt: skip
        assert word in printed.out
    assert 'method 1/3: paper' in printed.err


def test_what_is_left_behind(run, fake, tmp_path):
    out = tmp_path / 'out'
    assert evaluate.main([str(run.bag), '--output', str(out)]) == 0
    for name, known in RESULTS.items():
        with (out / f'trajectory_{name}.csv').open() as file:
            assert tuple(next(csv.reader(file))) == TRAJECTORY_COLUMNS
        rows = read_trajectory(out / f'trajectory_{name}.csv')
        np.testing.assert_allclose(rows.chainage, known.trajectory.chainage, atol=1e-6)
        np.testing.assert_allclose(rows.velocity[:, 0], known.trajectory.speed, atol=1e-6)
        np.testing.assert_allclose(rows.sigma_along, 0.5)
        np.testing.assert_allclose(rows.sigma_speed, 0.1)
        np.testing.assert_array_equal(rows.quaternion[0], [0.0, 0.0, 0.0, 1.0])
        assert len(read_tum(out / f'trajectory_{name}.tum')) == len(known.trajectory)
        fused = read_odometry(out / 'results', f'{name}/odometry')
        np.testing.assert_allclose(fused.position[:, 0], known.trajectory.chainage, atol=1e-9)
        np.testing.assert_allclose(fused.covariance[:, 0, 0], 0.25)
    assert set(list_topics(out / 'results')) == {
        *('/loop/pose', '/radar/twist', '/balise/pose', '/ground_truth/odometry'),
        *(f'/{name}/odometry' for name in RESULTS),
    }
    topics = ['loop/pose', 'radar/twist', 'balise/pose']
    assert list(raw_messages(out / 'results', topics)) == list(raw_messages(run.bag, topics))
    pictures = {path.name for path in out.glob('*.png')}
    assert pictures == {
        *('error_along_track.png', 'error_from_first_balise.png', 'error_distribution.png'),
        *('speeds.png', 'places.png', 'health.png'),
    }
    report = (out / 'report.html').read_text()
    assert report.count('data:image/png;base64,') == len(pictures)
    assert 'src="http' not in report
    assert all(word in report for word in (*RESULTS, 'balises.csv', 'loop.pitch_m', 'not_finite'))


def test_without_truth_there_are_trajectories_and_no_errors(run, fake, tmp_path, capsys):
    del run.topics['/ground_truth/odometry']
    run.write()
    assert evaluate.main([str(run.bag), '--output', str(tmp_path), '--methods', 'robust']) == 0
    entry = metrics_of(tmp_path)['methods']['robust']
    assert set(entry) == {'estimates', 'runtime_s', 'real_time_factor', 'rejected'}
    assert entry['estimates'] == len(RESULTS['robust'].trajectory)
    assert len(read_trajectory(tmp_path / 'trajectory_robust.csv')) == entry['estimates']
    pictures = {path.name for path in tmp_path.glob('*.png')}
    assert pictures == {'speeds.png', 'places.png', 'health.png'}
    assert 'No ground truth' in capsys.readouterr().out


def test_without_a_balise_heard_there_are_no_figures_from_it_on(run, fake, tmp_path, capsys):
    del run.topics['/balise/pose']
    run.write()
    assert evaluate.main([str(run.bag), '--output', str(tmp_path), '--no-plots']) == 0
    assert 'from_first_balise' not in metrics_of(tmp_path)['methods']['robust']
    said = capsys.readouterr()
    assert 'No balise/pose' in said.err
    assert 'figures from the first balise are left out' in said.out


def test_a_method_without_any_estimate(run, fake, tmp_path, monkeypatch, capsys):
    empty = Trajectory(np.empty(0), np.empty((0, 3)), chainage=np.empty(0), speed=np.empty(0),
                       sigma_along=np.empty(0))  # fmt: skip
    monkeypatch.setitem(
        RESULTS, 'kalman', MethodResult('kalman', empty, {}, 0.1, [], ('no start',))
    )
    assert evaluate.main([str(run.bag), '--output', str(tmp_path)]) == 0
    entry = metrics_of(tmp_path)['methods']['kalman']
    assert entry['estimates'] == 0
    assert 'position_m' not in entry
    assert 'kalman: no start' in capsys.readouterr().out
    assert (tmp_path / 'trajectory_kalman.csv').read_text().count('\n') == 1


def test_settings_and_measurements_reach_the_methods(run, fake, tmp_path):
    arguments = ['--set', 'particles=77', '--set', 'motion.start_known=false']
    arguments += ['--methods', 'kalman,robust', '--no-plots', '--output', str(tmp_path)]
    assert evaluate.main([str(run.bag), *arguments]) == 0
    ((measurements, config, balises, length, methods),) = fake
    assert len(measurements) == 220 + 220 + 3
    assert config.particles == 77
    assert config.motion.start_known is False
    assert balises.id == ('A', 'B', 'C')
    assert length == 0.0
    assert methods == ('kalman', 'robust')
    assert 'particles: 77   (default 1000)' in (tmp_path / 'report.html').read_text()


@pytest.mark.parametrize(
    'arguments',
    [
        [],
        ['bag', '--methods', 'eskf'],
        ['bag', '--methods', ''],
        ['bag', '--remap', 'loop/pose'],
        ['bag', '--set', 'particles'],
        ['bag', '--set', 'particle=5'],
        ['bag', '--set', 'particles=0'],
    ],
)
def test_wrong_usage_exits_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as error:
        evaluate.main(arguments)
    assert error.value.code == 2
    assert 'usage: evaluate maglev' in capsys.readouterr().err


def test_data_that_cannot_be_used_exit_with_1_and_leave_nothing(run, fake, tmp_path, capsys):
    run.write_balises('A,1.0,0.1', 'A,2.0,0.1')
    out = tmp_path / 'out'
    assert evaluate.main([str(run.bag), '--output', str(out)]) == 1
    said = capsys.readouterr()
    assert said.err.startswith('error: ')
    assert 'balises.csv: line 3' in said.err
    assert said.out == ''
    assert not out.exists()
    (tmp_path / 'file').touch()
    run.write_balises()
    assert evaluate.main([str(run.bag), '--output', str(tmp_path / 'file')]) == 1
    assert '--output' in capsys.readouterr().err

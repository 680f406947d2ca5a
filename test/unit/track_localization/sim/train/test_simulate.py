"""Whole runs: the scenarios, and what was agreed of them."""

import time

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.settings import override
from track_localization.sim.train import SCENARIOS, TrainSimConfig, scenario, simulate_train

QUICK = {'imu.rate_hz': 5.0, 'clock.truth_rate_hz': 10.0}


def run(name='line', seed=1, **changes):
    changes = {k.replace('__', '.'): v for k, v in changes.items()}
    return simulate_train(override(scenario(name), changes), seed)


def bits(simulated):
    g, w, i, lo = simulated.gnss, simulated.wheel, simulated.imu, simulated.local
    arrays = [simulated.position, simulated.quaternion, lo.latitude, simulated.track.position]
    arrays += [g.time_s, g.arrival_s, g.latitude, g.covariance, g.satellites, g.hdop]
    arrays += [w.time_s, w.arrival_s, w.speed, i.time_s, i.specific_force, i.angular_rate]
    return [a.tobytes() for a in arrays]


@pytest.mark.parametrize('name', SCENARIOS)
def test_every_scenario_runs_and_repeats(name):
    """Same seed, same bits; another seed, another line and other errors; shapes fit."""
    first, again, other = run(name, 3, **QUICK), run(name, 3, **QUICK), run(name, 4, **QUICK)
    assert bits(first) == bits(again)
    assert first.info == again.info
    shared = set(bits(first)) & set(bits(other))
    assert shared <= {first.imu.time_s.tobytes()}  # where both last as long
    n, k = len(first.time_s), len(first.gnss)
    assert first.position.shape == first.velocity.shape == (n, 3)
    assert first.quaternion.shape == first.local.quaternion.shape == (n, 4)
    assert first.gnss.covariance.shape == (k, 3, 3)
    assert first.gnss.status.dtype == bool
    assert first.time_s[0] == 1000.0
    assert len(first.imu_arrival_s) == len(first.imu)
    assert (np.diff(first.time_s) > 0.0).all()
    assert (np.diff(first.imu_arrival_s) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(first.quaternion, axis=1), 1.0)
    assert (np.sum(first.quaternion[1:] * first.quaternion[:-1], axis=1) > 0.0).all()
    assert np.degrees(first.datum[:2]) == pytest.approx([40.3458, 116.0271], abs=1e-9)


def test_the_nominal_errors_are_those_agreed():
    """The figures that goals are measured with: a milder one would void them."""
    for name in ('line', 'paper'):
        c = scenario(name)
        assert (c.imu.rate_hz, c.odometer.rate_hz, c.gnss.rate_hz) == (100.0, 10.0, 1.0)
        odometer = c.odometer
        assert (odometer.scale, odometer.scale_law) == (0.002, 'sign')
        assert (odometer.noise_m, odometer.pulse_m, odometer.mount_deg) == (0.005, 0.02, 0.3)
        assert (odometer.slip_share, odometer.slip_s) == ((0.03, 0.2), (0.5, 4.0))
        gnss = c.gnss
        assert np.hypot(gnss.drift_m, gnss.noise_m) == pytest.approx(0.85, abs=0.01)
        assert (gnss.outliers, gnss.outlier_m[1]) == (0.02, 80.0)
        assert gnss.outliers_covered >= gnss.outliers
        assert (c.line.radius_m, c.line.grade) == ((2200.0, 6000.0), 0.025)
        assert c.line.cant_deg > 0.0
        assert c.imu.grade == 'industrial'
    assert SCENARIOS['line'] == {}
    assert scenario('slip').odometer.slips_in_outage[0] >= 2


@pytest.mark.parametrize('name', ['paper', 'slip', 'navigation', 'tactical', 'mems', 'wrongmap'])
def test_the_papers_run(name):
    """200 s, 11 km, from 116.0271 E 40.3458 N, no satellites from 100 to 150 s."""
    simulated = run(name, 2)
    assert simulated.duration_s == 200.0
    assert simulated.chainage[-1] - simulated.chainage[0] == pytest.approx(11e3, abs=1e-3)
    assert 44.0 < simulated.speed.min() < simulated.speed.max() < 68.0
    assert np.degrees(simulated.local.latitude[0]) == pytest.approx(40.3458, abs=1e-9)
    assert np.degrees(simulated.local.longitude[0]) == pytest.approx(116.0271, abs=1e-9)
    assert simulated.outages == [(1100.0, 1150.0)]
    assert len(simulated.imu) == 20001
    assert len(simulated.wheel) in (1999, 2000)
    assert len(simulated.gnss) == 200
    assert simulated.start is not None
    grade = {'paper': 'industrial', 'slip': 'industrial', 'wrongmap': 'industrial'}.get(name, name)
    assert scenario(name).imu.grade == grade


def test_grades_share_the_run_and_all_other_errors():
    """So that they can be compared, seed by seed."""
    paper, mems = run('paper', 5), run('mems', 5)
    np.testing.assert_array_equal(paper.position, mems.position)
    np.testing.assert_array_equal(paper.gnss.latitude, mems.gnss.latitude)
    np.testing.assert_array_equal(paper.wheel.speed, mems.wheel.speed)
    assert (paper.imu.angular_rate != mems.imu.angular_rate).all()


def test_moving_starts_under_way_and_is_told_nothing():
    simulated = run('moving', 1, **QUICK)
    assert simulated.start is None
    assert simulated.speed[0] > 44.0
    assert simulated.outages == [(1300.0, 1350.0)]
    assert simulated.gnss.status[simulated.gnss.time_s < 1300.0].all()


@pytest.mark.parametrize('seed', range(5))
def test_line(seed):
    """15 to 22 minutes, a minute at rest first, tunnels, three satellites, stops, slips."""
    simulated = run('line', seed, **QUICK)
    assert 900.0 < simulated.duration_s < 1320.0
    still = simulated.time_s < 1060.0
    assert (simulated.speed[still] == 0.0).all()
    np.testing.assert_allclose(np.ptp(simulated.position[still], axis=0), 0.0, atol=1e-9)
    stops = np.flatnonzero(np.diff((simulated.speed == 0.0).astype(int)) == 1)
    assert len(stops) == 3
    assert len(simulated.outages) >= 3
    assert all(1060.0 < a < b < simulated.time_s[-1] for a, b in simulated.outages)
    assert (simulated.gnss.satellites == 3).any()
    assert len(simulated.info['wheel']['slips']) >= 2
    assert simulated.start is None


def test_lines_of_two_seeds_are_not_alike():
    a, b = run('line', 1, **QUICK), run('line', 2, **QUICK)
    assert a.chainage[-1] != b.chainage[-1]
    assert np.linalg.norm(a.track.position[2000] - b.track.position[2000]) > 100.0
    assert a.info['tunnels_m'] != b.info['tunnels_m']


def test_a_setting_of_one_sensor_leaves_the_others_alone():
    """Nor the truth: runs that differ in one error can be compared."""
    plain = run('line', **QUICK)
    noisy = run('line', **QUICK, gnss__noise_m=5.0, odometer__slips=30.0, imu__grade='mems')
    np.testing.assert_array_equal(plain.position, noisy.position)
    np.testing.assert_array_equal(plain.track.position, noisy.track.position)
    np.testing.assert_array_equal(plain.wheel.arrival_s, noisy.wheel.arrival_s)
    np.testing.assert_array_equal(plain.gnss.hdop, noisy.gnss.hdop)
    assert len(noisy.info['wheel']['slips']) > len(plain.info['wheel']['slips'])
    silent = run('line', **QUICK, gnss__outliers=0.0, gnss__outliers_covered=0.0)
    np.testing.assert_array_equal(plain.wheel.speed, silent.wheel.speed)
    np.testing.assert_array_equal(plain.imu.angular_rate, silent.imu.angular_rate)


def test_truth_is_a_trajectory():
    simulated = run('paper', **QUICK)
    truth = simulated.truth()
    np.testing.assert_array_equal(truth.position, simulated.position)
    np.testing.assert_array_equal(truth.chainage, simulated.chainage)
    assert len(truth) == len(simulated.time_s)


def test_twenty_minutes_take_seconds():
    """CPU time, best of two: 120,000 IMU samples and as many rows of truth."""
    best = np.inf
    for seed in (1, 2):
        begin = time.process_time()
        simulated = run('line', seed)
        best = min(best, time.process_time() - begin)
    assert len(simulated.imu) > 90_000
    assert best < 5.0


@pytest.mark.parametrize(
    ('setting', 'value', 'said'),
    [
        ('odometer.slip_s', (4.0, 0.5), 'lesser first'),
        ('terrain.tunnels', (5, 3), 'lesser first'),
        ('imu.grade', 'toy', 'toy'),
        ('gnss.noise_m', -1.0, 'below'),
        ('imu.gyro_bias_dph', -2.0, 'below'),
    ],
)
def test_impossible_settings_are_explained(setting, value, said):
    with pytest.raises(DataError, match=said) as caught:
        simulate_train(override(TrainSimConfig(), {setting: value}), 1)
    assert setting in str(caught.value)


def test_lever_arms_need_not_be_in_order():
    """Three numbers are no range."""
    assert len(run('paper', **QUICK, gnss__lever_m=(3.0, -1.0, 2.0)).gnss) == 200


def test_unknown_scenario_and_negative_seed():
    with pytest.raises(DataError, match='known: line, paper'):
        scenario('hail')
    with pytest.raises(DataError, match='negative'):
        simulate_train(None, -1)

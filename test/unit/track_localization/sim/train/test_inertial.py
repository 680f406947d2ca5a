"""The IMU's errors, measured from outside: what it tells less what an ideal one does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.sim.train.grades import GRADES

DPH, MG = np.radians(1.0) / 3600.0, 9.80665e-3
NAMES = (
    *('gyro_bias_dph', 'angle_walk', 'accel_bias_mg', 'velocity_walk'),
    *('gyro_in_run_dph', 'accel_in_run_mg'),
)
PERFECT = {f'imu.{name}': 0.0 for name in NAMES}
SHORT = {'motion.distance_m': 1100.0, 'motion.duration_s': 20.0, 'gnss.outage_s': (0.0, 0.0)}
SHORT |= {'survey.given': False, 'clock.truth_rate_hz': 5.0}

SCENARIOS_MD = {
    'navigation': (0.01, 0.003, 0.05, 0.01, 0.01, 0.05, 0.005, 0.02),
    'tactical': (0.5, 0.05, 0.3, 0.03, 0.05, 0.3, 0.3, 0.05),
    'industrial': (5.0, 0.2, 1.0, 0.06, 0.1, 0.6, 2.0, 0.1),
    'mems': (50.0, 0.5, 3.0, 0.15, 0.3, 1.5, 10.0, 0.3),
}
"""Agreed: gyro bias, angle walk, accelerometer bias, velocity walk, level, yaw, in-run two."""


def run(seed, **changes):
    changes = {k.replace('__', '.'): v for k, v in changes.items()}
    return simulate_train(override(scenario('paper'), {**SHORT, **changes}), seed)


def errors(seed, **changes):
    """Return what accelerometer and gyro tell too much, (N, 3) each."""
    told = run(seed, **changes).imu
    true = run(seed, **{**changes, **PERFECT}).imu
    return told.specific_force - true.specific_force, told.angular_rate - true.angular_rate


def alone(**figures):
    """Return settings after which the IMU has only these errors."""
    return {**PERFECT, **{f'imu.{name}': value for name, value in figures.items()}}


def test_the_grades_are_those_agreed():
    """The figures that goals are measured with: a milder one would void them."""
    assert {name: tuple(grade) for name, grade in GRADES.items()} == SCENARIOS_MD
    config = scenario('paper').imu
    assert (config.grade, config.rate_hz, config.in_run_s) == ('industrial', 100.0, 300.0)
    assert all(getattr(config, name) == -1.0 for name in NAMES)


@pytest.mark.parametrize('grade', ['tactical', 'mems'])
def test_a_grade_has_all_its_errors(grade):
    """
    Rms over 40 runs and three axes, of means over 20 s, and the noise of one run.

    Sigma of the means is bias and wander together, 1 / sqrt(240) = 6.5 % uncertain; four of them.
    """
    f, w = zip(*(errors(seed, imu__grade=grade) for seed in range(40)), strict=True)
    dph, walk, mg, velocity, _, _, dph_run, mg_run = SCENARIOS_MD[grade]
    gyro = np.sqrt(np.mean([e.mean(axis=0) ** 2 for e in w]))
    accel = np.sqrt(np.mean([e.mean(axis=0) ** 2 for e in f]))
    white = np.radians(walk) / 60.0 / np.sqrt(20.0), velocity / 60.0 / np.sqrt(20.0)
    assert gyro == pytest.approx(np.hypot(np.hypot(dph, dph_run) * DPH, white[0]), rel=0.26)
    assert accel == pytest.approx(np.hypot(np.hypot(mg, mg_run) * MG, white[1]), rel=0.26)
    noise = [np.diff(e, axis=0).std() / np.sqrt(2.0) for e in (w[0], f[0])]
    assert noise[0] * 0.1 == pytest.approx(np.radians(walk) / 60.0, rel=0.04)
    assert noise[1] * 0.1 == pytest.approx(velocity / 60.0, rel=0.04)


def test_a_bias_is_constant():
    """N(0, 5 deg/h) and N(0, 1 mg) over 40 runs; within four sigma of the sigma."""
    settings = alone(gyro_bias_dph=5.0, accel_bias_mg=1.0)
    gyro, accel = [], []
    for seed in range(40):
        f, w = errors(seed, **settings)
        assert np.ptp(w, axis=0).max() < 1e-12
        assert np.ptp(f, axis=0).max() < 1e-12
        gyro.append(w[0] / DPH)
        accel.append(f[0] / MG)
    assert np.sqrt(np.mean(np.square(gyro))) == pytest.approx(5.0, rel=0.26)
    assert np.sqrt(np.mean(np.square(accel))) == pytest.approx(1.0, rel=0.26)
    assert abs(np.corrcoef(np.ravel(gyro), np.ravel(accel))[0, 1]) < 4 / np.sqrt(120)


def test_noise_adds_up_to_the_random_walk():
    """0.2 deg/sqrt(h) and 0.06 m/s/sqrt(h): sums over a second of 600 s are as far apart."""
    long = {'motion.distance_m': 33e3, 'motion.duration_s': 600.0}
    f, w = errors(1, **long, **alone(angle_walk=0.2, velocity_walk=0.06))
    angle = w[:60000].reshape(600, 100, 3).sum(axis=1) * 0.01
    speed = f[:60000].reshape(600, 100, 3).sum(axis=1) * 0.01
    assert angle.std() * 60.0 == pytest.approx(np.radians(0.2), rel=4 / np.sqrt(3600))
    assert speed.std() * 60.0 == pytest.approx(0.06, rel=4 / np.sqrt(3600))


def test_the_wandering_part_is_gauss_markov():
    """
    Unit variance from the first sample on, and 1 / e after the correlation time, here of 15 s.

    50 runs of 20 s and three axes: correlations are 8 % uncertain, sigmas 6 %.
    """
    settings = alone(gyro_in_run_dph=2.0, accel_in_run_mg=0.1)
    settings['imu.in_run_s'] = 15.0
    f, w = zip(*(errors(seed, **settings) for seed in range(50)), strict=True)
    for e, sigma in ((np.array(w) / DPH, 2.0), (np.array(f) / MG, 0.1)):
        first, last = e[:, 0].ravel(), e[:, 1500].ravel()
        assert first.std() == pytest.approx(sigma, rel=0.24)
        assert last.std() == pytest.approx(sigma, rel=0.24)
        assert np.mean(first * last) / sigma**2 == pytest.approx(np.exp(-1.0), abs=0.35)
        near = e[:, 150].ravel()
        assert np.mean(first * near) / sigma**2 == pytest.approx(np.exp(-0.1), abs=0.4)
        steps = np.diff(e, axis=1)  # a wander, not a noise: sqrt(2 / 1500) of sigma a step
        assert steps.std() == pytest.approx(sigma * np.sqrt(2.0 / 1500.0), rel=0.02)


def test_a_figure_of_its_own_overrides_the_grade():
    _, w = errors(1, **{**alone(gyro_bias_dph=-1.0), 'imu.grade': 'mems'})
    _, milder = errors(1, **alone(gyro_bias_dph=-1.0))
    np.testing.assert_allclose(w, 10.0 * milder, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(('name', 'level', 'yaw'), [('paper', 0.1, 0.6), ('mems', 0.3, 1.5)])
def test_the_start_is_off_by_as_much_as_the_grade_says(name, level, yaw):
    """60 runs: sigmas within four of theirs (6.5 and 9 %); covariances say the same."""
    theta, place = [], []
    for seed in range(60):
        simulated = simulate_train(override(scenario(name), SHORT), seed)
        start, true = simulated.start, Rotation.from_quat(simulated.quaternion[0])
        theta.append((Rotation.from_quat(start.quaternion) * true.inv()).as_rotvec())
        place.append(start.position - simulated.position[0])
        sigma = np.degrees(np.sqrt(np.diag(start.covariance)[3:]))
        np.testing.assert_allclose(sigma, [level, level, yaw])
        assert start.time_s == 1000.0
    off = np.degrees(np.sqrt(np.mean(np.square(theta), axis=0)))
    assert np.sqrt(np.mean(off[:2] ** 2)) == pytest.approx(level, rel=0.26)
    assert off[2] == pytest.approx(yaw, rel=0.36)
    off = np.sqrt(np.mean(np.square(place), axis=0))
    assert off[0] == pytest.approx(0.85, rel=0.36)
    assert off[2] == pytest.approx(1.6, rel=0.36)


def test_only_an_aligned_start_is_told():
    assert simulate_train(override(scenario('moving'), SHORT), 1).start is None
    assert run(1, start__level_deg=0.0, start__yaw_deg=0.0, start__given=True).start is not None


def test_standing_the_imu_feels_gravity_and_the_earths_turning():
    """Up 9.80 m/s^2 at 40.35 N and 500 m; 15.04 deg/h about the Earth's axis."""
    simulated = simulate_train(override(scenario('line'), {**PERFECT, 'motion.legs': 1}), 1)
    still = simulated.imu[: 50 * 100]
    np.testing.assert_allclose(np.ptp(still.specific_force, axis=0), 0.0, atol=1e-12)
    R = Rotation.from_quat(simulated.local.quaternion[0])
    lat = np.radians(40.3458)
    gravity = 9.780327 * (1 + 0.0053024 * np.sin(lat) ** 2 - 5.8e-6 * np.sin(2 * lat) ** 2)
    gravity -= 3.086e-6 * 500.0  # the international formula of 1980, and free air
    np.testing.assert_allclose(R.apply(still.specific_force[0]), [0.0, 0.0, gravity], atol=1e-5)
    spin = 2.0 * np.pi / 86164.0905 * np.array([0.0, np.cos(lat), np.sin(lat)])
    np.testing.assert_allclose(R.apply(still.angular_rate[0]), spin, atol=1e-9)

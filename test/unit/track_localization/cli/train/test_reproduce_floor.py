"""The best estimators there can be, where their errors are known in closed form."""

import math

import numpy as np
import pytest

from track_localization.cli.train import reproduce_floor
from track_localization.cli.train.reproduce_floor import System, best_errors, floor_errors, floors
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train

SEED, DRAWS = 5, 200

EXACT = {
    'imu.gyro_bias_dph': 1e-4,
    'imu.angle_walk': 1e-4,
    'imu.accel_bias_mg': 1e-4,
    'imu.velocity_walk': 1e-4,
    'imu.gyro_in_run_dph': 1e-4,
    'imu.accel_in_run_mg': 1e-4,
    'start.level_deg': 1e-4,
    'start.yaw_deg': 1e-4,
    'odometer.mount_deg': 1e-4,
    'odometer.noise_m': 1e-5,
}
"""Next to nothing is wrong but the fixes."""
STRAIGHT = {
    'line.radius_m': (1e6, 1e6),
    'line.turn_deg': (0.5, 0.5),
    'line.transition_m': (2000.0, 2000.0),
    'line.grade': 0.0,
    'line.cant_deg': 0.0,
    'motion.variation': 0.0,
}


def errors_of(with_map=False, draws=DRAWS, **settings):
    """Return run, stamps since its start and best errors; ``a__b`` sets ``a.b``."""
    told = {name.replace('__', '.'): value for name, value in settings.items()}
    config = override(scenario('paper'), {**EXACT, **told})
    run = simulate_train(config, SEED)
    time_s, errors = floor_errors(run, config, np.random.default_rng(SEED), draws, with_map)
    return run, time_s - time_s[0], errors


def test_a_constant_measured_again_and_again():
    """The posterior variance of a constant is 1 / (1 / P + n / R) once n are heard."""
    n, P, R = 20, 4.0, 9.0
    one = np.ones((n, 1, 1))
    system = System(np.array([[P]]), one[1:], 0.0 * one[1:], [np.eye(1)] * n, [np.array([R])] * n)
    errors = best_errors(system, np.random.default_rng(1), 4000)
    expected = [1.0 / (1.0 / P + (k + 1) / R) for k in range(n)]
    assert errors.P_filtered[:, 0, 0] == pytest.approx(expected)
    assert errors.P_smoothed[:, 0, 0] == pytest.approx(expected[-1])
    # 4000 draws know a variance to 1 / sqrt(2000), 1 sigma.
    assert errors.filtered.var(axis=(1, 2)) == pytest.approx(expected, rel=0.08)
    assert errors.smoothed.var(axis=(1, 2)) == pytest.approx(expected[-1], rel=0.08)


def test_a_walk_between_two_places_that_are_known():
    """A Brownian bridge over time 1 has the variance t (1 - t); before its end is known, t."""
    n = 11
    t = np.linspace(0.0, 1.0, n)
    F, Q = np.ones((n - 1, 1, 1)), np.full((n - 1, 1, 1), 1.0 / (n - 1))
    none = np.zeros((0, 1)), np.zeros(0)
    H, R = [none[0]] * (n - 1) + [np.eye(1)], [none[1]] * (n - 1) + [np.array([1e-12])]
    errors = best_errors(System(np.zeros((1, 1)), F, Q, H, R), np.random.default_rng(2), 4000)
    assert errors.P_filtered[:-1, 0, 0] == pytest.approx(t[:-1])
    assert errors.P_smoothed[:, 0, 0] == pytest.approx(t * (1.0 - t), abs=1e-9)
    assert errors.smoothed.var(axis=(1, 2)) == pytest.approx(t * (1.0 - t), rel=0.08, abs=1e-9)


def test_a_lasting_error_of_fixes_is_never_averaged_away():
    """With all else exact, start and fixes are two opinions, 0.85 and 0.8 m, until the end."""
    _, _, errors = errors_of(
        gnss__drift_s=(1e5, 1e5), terrain__open_hdop=(1.0, 1.0), gnss__outliers=0.0
    )
    expected = 1.0 / math.sqrt(0.85**-2 + 0.8**-2)
    for axis in (0, 1):
        # A drift of 1e5 s moves by 4 cm in 100 s, and leaves no more than that to be learnt.
        assert np.sqrt(errors.P_filtered[-1, axis, axis]) == pytest.approx(expected, rel=0.02)


BLIND = {
    'imu__angle_walk': 0.2,
    'imu__velocity_walk': 1e3,
    'start__horizontal_m': 1e-3,
    'gnss__outage_s': (0.0, 199.0),
    **{k.replace('.', '__'): v for k, v in STRAIGHT.items()},
}
"""Neither fixes nor accelerometers that tell anything."""


def across(run, time_s, errors, at_s=150.0):
    """Return sigma across the line as claimed and as drawn [m]."""
    k = int(np.searchsorted(time_s, at_s))
    ahead = run.local.velocity[0, :2] / np.hypot(*run.local.velocity[0, :2])
    left = np.array([-ahead[1], ahead[0]])
    claimed = math.sqrt(left @ errors.P_filtered[k][:2, :2] @ left)
    return claimed, np.std(left @ errors.filtered[k, :2])


def test_across_an_unknown_line_the_white_noise_of_gyros_adds_up(monkeypatch):
    """Where nobody says that the line is straight, variance across is q v^2 t^3 / 3."""
    monkeypatch.setattr(
        reproduce_floor, '_straight', lambda _, time_s: np.zeros(len(time_s), dtype=bool)
    )
    run, time_s, errors = errors_of(**BLIND)
    density, speed = math.radians(BLIND['imu__angle_walk']) / 60.0, float(run.speed.mean())
    claimed, drawn = across(run, time_s, errors)
    assert claimed == pytest.approx(density * speed * math.sqrt(150.0**3 / 3.0), rel=0.02)
    assert drawn == pytest.approx(claimed, rel=0.15)


def test_across_a_straight_line_it_does_not():
    """What is left is the course at the start, 0.05 deg, over the way."""
    run, time_s, errors = errors_of(**BLIND, start__yaw_deg=0.05, line__straight_m=(2e4, 2e4))
    way_m = float(np.interp(150.0, run.time_s - run.time_s[0], run.chainage) - run.chainage[0])
    claimed, drawn = across(run, time_s, errors)
    assert claimed == pytest.approx(math.radians(0.05) * way_m, rel=0.05)
    assert drawn == pytest.approx(claimed, rel=0.15)


def test_draws_are_what_their_covariance_says():
    """Mean NEES of the level position at the outage's end is 2, with map and without."""
    config = scenario('mems')
    run = simulate_train(config, SEED)
    for with_map in (False, True):
        rng = np.random.default_rng(SEED)
        time_s, errors = floor_errors(run, config, rng, 400, with_map)
        k = int(np.searchsorted(time_s, run.outages[0][1])) - 1
        for error, P in (
            (errors.filtered[k], errors.P_filtered[k]),
            (errors.smoothed[k], errors.P_smoothed[k]),
        ):
            nees = np.einsum('in,ij,jn->n', error[:2], np.linalg.inv(P[:2, :2]), error[:2])
            # 400 draws of chi-square(2): sigma of the mean 0.1.
            assert nees.mean() == pytest.approx(2.0, abs=0.35)


def test_reflections_are_told():
    """A run whose fixes are all reflections has none that are used: it coasts from its start."""
    _, _, none = errors_of(draws=1, gnss__outliers=1.0)
    _, _, all_lost = errors_of(draws=1, gnss__outage_s=(0.0, 200.0))
    assert none.P_filtered == pytest.approx(all_lost.P_filtered)


def test_floors_are_named_and_repeatable():
    config = scenario('paper')
    run = simulate_train(config, SEED)
    found = floors(run, config, SEED)
    assert found == floors(run, config, SEED)
    methods = ('robust', 'robust_map', 'smoothed', 'smoothed_map')
    drawn = reproduce_floor.DRAWS
    assert len(found) == 2 * len(methods) * drawn
    mean, untold = (
        {name: np.mean([found[f'{prefix}{name}.{k}'] for k in range(drawn)]) for name in methods}
        for prefix in ('', 'untold.')
    )
    assert mean['robust_map'] < 0.8 * untold['robust_map']
    assert mean['smoothed_map'] < mean['robust_map'] < mean['robust']
    assert mean['smoothed_map'] < mean['smoothed'] < mean['robust']

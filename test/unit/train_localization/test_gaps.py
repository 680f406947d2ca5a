"""An IMU that falls silent under way: what is unseen, by hand, and simulated runs without fixes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from track_localization.cli.train.reproduce_runs import Case, figures, measurements, results
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from train_localization import gaps
from train_localization.alignment import start_at
from train_localization.config import TrainConfig
from train_localization.gaps import GAP_MPS2, GAP_RADPS
from train_localization.measurements import GnssFix, WheelSpeed
from train_localization.paper_filter import PaperFilter
from train_localization.pipeline import TrainPipeline
from train_localization.robust_filter import RobustFilter
from train_localization.state import Fix, Stretch

BEGIN, V = np.array([0.7, 0.3, 100.0]), 50.0
UPRIGHT = so3.matrix_from_rpy(0.01, -0.02, 0.8)


def silent(method, gap_s):
    """Return a filter and its state after a gap, on a level line at 50 m/s."""
    filter_ = method(override(TrainConfig(), {'imu.grade': 'navigation'}))
    state = filter_.start(start_at(0.0, BEGIN, UPRIGHT, np.eye(6) * 1e-10, V, 1e-3))
    still = np.zeros((1, 3)), np.array([[0.0, 0.0, 9.8]])
    state = filter_.apply(state, Stretch(0.1, np.array([0.1]), *still))
    return filter_, filter_.apply(state, Stretch(0.1 + gap_s, np.array([0.1 + gap_s]), *still))


@pytest.mark.parametrize('gap_s', [0.5, 3.0])
def test_what_is_unseen_is_what_a_walk_between_two_known_rates_may_be(gap_s):
    """A bridge's integral varies by q^2 T^3 / 12; drawn here, not taken from the formula."""
    rng, steps = np.random.default_rng(1), 300
    walk = np.cumsum(rng.standard_normal((4000, steps)), axis=1) * math.sqrt(gap_s / steps)
    bridge = walk - walk[:, -1:] * np.arange(1, steps + 1) / steps
    drawn = bridge.mean(axis=1).std() * gap_s
    _, state = silent(RobustFilter, gap_s)
    sigma = np.sqrt(np.diag(state.P))
    np.testing.assert_allclose(sigma[6:9], drawn * np.array(GAP_RADPS), rtol=0.1)
    ahead = UPRIGHT[:, 0]
    assert math.sqrt(ahead @ state.P[3:6, 3:6] @ ahead) == pytest.approx(drawn * GAP_MPS2, rel=0.1)


def test_velocity_turns_with_the_train_in_a_gap():
    """Across its rails a train is as slow as before; the direction of its motion is not known."""
    _, state = silent(RobustFilter, 3.0)
    R = so3.matrix_from_quat(state.nav[6:])
    left, v = R[:, 1], R.T @ state.nav[3:6]
    across = np.zeros(len(state.P))
    across[3:6], across[6], across[8] = left, v[2], -v[0]
    assert math.sqrt(left @ state.P[3:6, 3:6] @ left) > 0.5
    assert math.sqrt(across @ state.P @ across) < 0.05


@pytest.mark.parametrize('method', [RobustFilter, PaperFilter])
def test_what_is_measured_in_a_gap_is_refused(method):
    """Where the train is at that time is not known."""
    filter_, state = silent(method, 0.1)
    for heard in (
        WheelSpeed(1.0, 60.0, 0.01),
        Fix(1.0, GnssFix(1.0, 0.7, 0.3, 100.0, np.eye(3)), 3),
    ):
        after = filter_.apply(state, heard)
        assert after.reason == 'imu_silent'
        np.testing.assert_array_equal(after.nav, state.nav)


def test_what_is_measured_before_the_next_sample_is_used():
    """100 Hz and a message 0.2 s ahead: no gap."""
    filter_, state = silent(RobustFilter, 0.1)
    assert filter_.apply(state, WheelSpeed(0.4, V, 0.01)).reason == ''


@pytest.mark.parametrize(('rate_hz', 'epoch_s'), [(100.0, 0.1), (100.0, 0.5), (2.0, 0.1)])
def test_a_gap_is_longer_than_a_step_and_than_the_time_between_samples(rate_hz, epoch_s):
    gap_s, time_s, count = gaps.shortest(epoch_s), 0.0, max(round(epoch_s * rate_hz), 1)
    for _ in range(100):
        stamps = time_s + np.arange(1, count + 1) / rate_hz
        gap_s = gaps.adapted(gap_s, epoch_s, stamps, time_s)
        time_s = float(stamps[-1])
    assert max(epoch_s, 1.0 / rate_hz) < gap_s < 3.0 * max(epoch_s, 1.0 / rate_hz, 0.1)


def deaf(seed, begin_s, gap_s, **settings):
    """Return run, estimator and what it told until 40 s after a gap of its IMU."""
    run = simulate_train(scenario('paper'), seed)
    begin = run.time_s[0] + begin_s
    pipeline, estimates = TrainPipeline(override(TrainConfig(), settings), None, run.datum), []
    assert pipeline.set_start(*dataclasses.astuple(run.start)) is None
    for m in measurements(run):
        if m.time_s > begin + gap_s + 40.0:
            break
        if not (isinstance(m, ImuSample) and begin < m.time_s < begin + gap_s):
            estimates += pipeline.push(m)
    return run, pipeline, estimates


def off(run, estimate):
    """Return the level error [m], and its NIS."""
    true = [np.interp(estimate.time_s, run.time_s, run.position[:, k]) for k in range(2)]
    error, P = estimate.position[:2] - true, estimate.covariance[:2, :2]
    return float(np.hypot(*error)), float(error @ np.linalg.solve(P, error))


@pytest.mark.parametrize('seed', [4, 12, 13])
def test_a_gap_in_an_outage_does_not_turn_the_train(seed):
    """40 s later the error is not far beyond what sigma says, and sigma no more than 100 m."""
    run, pipeline, estimates = deaf(seed, 107.0, 3.0)
    error, nis = off(run, estimates[-1])
    assert nis < 16.0
    assert error < 60.0
    assert np.sqrt(np.diag(estimates[-1].covariance)[:2]).max() < 100.0
    assert pipeline.rejected['wheel']['imu_silent'] > 25


@pytest.mark.parametrize('gap_s', [1.0, 3.8])
@pytest.mark.parametrize('method', ['robust', 'paper', 'ins'])
def test_fixes_put_right_what_was_unseen(method, gap_s):
    """Right after the gap sigma tells; ten seconds later nothing is left of it."""
    run, _, estimates = deaf(12, 30.0, gap_s, method=method)
    after = [e for e in estimates if e.time_s > run.time_s[0] + 30.0 + gap_s]
    assert off(run, after[1])[1] < 16.0
    late = [off(run, e)[0] for e in after if e.time_s > after[0].time_s + 10.0]
    assert max(late) < 5.0


def test_after_a_long_gap_the_filter_begins_anew():
    run, pipeline, estimates = deaf(12, 30.0, 5.0)
    times = np.array([e.time_s for e in estimates])
    silence = np.diff(times).max()
    assert 5.0 < silence < 20.0
    assert max(off(run, e)[0] for e in estimates[-100:]) < 5.0
    assert pipeline.mode == 'BDS/SINS'
    assert pipeline.rejected['imu'] == {'long_gap': 1}


@pytest.mark.parametrize('settings', [{'epoch_s': 0.5}, {'epoch_s': 1.0}])
def test_late_messages_count_however_long_a_step_is(settings):
    """Fixes and odometer 0.6 s late."""
    run = simulate_train(scenario('paper'), 12)
    pipeline = TrainPipeline(override(TrainConfig(), settings), None, run.datum)
    assert pipeline.set_start(*dataclasses.astuple(run.start)) is None
    late = sorted(
        (m for m in measurements(run) if m.time_s < run.time_s[0] + 60.0),
        key=lambda m: m.time_s + (0.0 if isinstance(m, ImuSample) else 0.6),
    )
    estimates = [e for m in late for e in pipeline.push(m)]
    assert off(run, estimates[-1])[0] < 5.0
    assert 'imu_silent' not in pipeline.rejected.get('wheel', {})


@pytest.mark.parametrize('seed', [4, 13])
def test_smoothing_bridges_a_gap_in_an_outage(seed):
    """What comes after tells of what was unseen: a few metres, and no false certainty."""
    run = simulate_train(override(scenario('paper'), {'faults.imu_gap_s': 3.0}), seed)
    ((_, result),) = results(run, Case('paper'), ('smoothed',))
    (outage,) = figures(result, run)['outages']
    assert outage['max_m'] < 5.0
    assert figures(result, run)['outage']['nees_position_over_3'] < 9.0

"""An IMU that falls silent under way: what is unseen, by hand, and simulated runs without fixes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from track_localization.cli.train.reproduce_runs import measurements
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
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


@pytest.fixture(scope='module', params=[4, 12, 13])
def gone(request):
    """A run, and an estimator that heard no IMU for 3 s in its outage."""
    run = simulate_train(scenario('paper'), request.param)
    begin = run.time_s[0] + 107.0
    pipeline, estimates = TrainPipeline(TrainConfig(), None, run.datum), []
    assert pipeline.set_start(*dataclasses.astuple(run.start)) is None
    for m in measurements(run):
        if not (isinstance(m, ImuSample) and begin < m.time_s < begin + 3.0):
            estimates += pipeline.push(m)
    return run, pipeline, estimates, begin


def test_a_gap_in_an_outage_does_not_turn_the_train(gone):
    """At its end, 40 s without fixes later, the error is not far beyond what sigma says."""
    run, pipeline, estimates, begin = gone
    last = max((e for e in estimates if e.time_s < begin + 42.0), key=lambda e: e.time_s)
    true = [np.interp(last.time_s, run.time_s, run.position[:, k]) for k in range(2)]
    error, P = last.position[:2] - true, last.covariance[:2, :2]
    assert error @ np.linalg.solve(P, error) < 16.0
    assert np.hypot(*error) < 60.0
    assert pipeline.rejected['wheel']['imu_silent'] > 25

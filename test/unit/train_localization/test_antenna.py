"""An antenna that is not where the IMU is: the run is the same as if it were, once it is told."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from track_localization.cli.train.reproduce_runs import measurements
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from train_localization.config import TrainConfig
from train_localization.pipeline import TrainPipeline

LEVER = (8.0, -1.0, 4.0)
TOLD = {'gnss.ahead_m': 8.0, 'gnss.left_m': -1.0, 'gnss.up_m': 4.0}


def places(lever, settings, given=True):
    """Return where the train is said to be, (N, 3), ten times a second until the outage."""
    run = simulate_train(override(scenario('paper'), {'gnss.lever_m': lever}), 17)
    pipeline = TrainPipeline(override(TrainConfig(), settings), None, run.datum)
    if given:
        assert pipeline.set_start(*dataclasses.astuple(run.start)) is None
    estimates = {}
    for m in measurements(run):
        if m.time_s > run.time_s[0] + 105.0:
            break
        estimates |= {round(e.time_s, 3): e.position for e in pipeline.push(m)}
    return np.array([estimates[t] for t in sorted(estimates)])


@pytest.mark.parametrize('method', ['robust', 'paper', 'ins'])
@pytest.mark.parametrize('given', [True, False])
def test_what_is_told_of_the_antenna_is_made_good(method, given):
    """Errors of the sensors are the same in both runs."""
    at_imu = places((0.0, 0.0, 0.0), {'method': method}, given)
    apart = places(LEVER, {'method': method, **TOLD}, given)
    assert len(apart) == len(at_imu) > 900
    np.testing.assert_allclose(apart[100:], at_imu[100:], atol=0.15)


def test_what_is_not_told_is_not():
    at_imu = places((0.0, 0.0, 0.0), {})
    apart = places(LEVER, {})
    assert np.linalg.norm(apart[-1] - at_imu[-1]) > 5.0

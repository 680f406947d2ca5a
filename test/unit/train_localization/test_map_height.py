"""A map whose heights are off: fixes know too little of heights to tell, and sigma says so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from track_localization.cli.train.reproduce_runs import measurements
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.track.centreline import Centreline
from train_localization.config import TrainConfig
from train_localization.pipeline import TrainPipeline

UP = np.array([0.0, 0.0, 1.0])


def heights(above_m, **settings):
    """Return error and sigma of the height with such a map, (N,) [m]."""
    run = simulate_train(scenario('paper'), 33)
    track = dataclasses.replace(run.track, position=run.track.position + above_m * UP)
    config = override(TrainConfig(), {'method': 'robust_map', **settings})
    pipeline = TrainPipeline(config, Centreline.from_track(track), run.datum)
    assert pipeline.set_start(*dataclasses.astuple(run.start)) is None
    found = [e for m in measurements(run) for e in pipeline.push(m)]
    time_s, up = np.array([(e.time_s, e.position[2]) for e in found]).T
    sigma = np.sqrt([e.covariance[2, 2] for e in found])
    settled = time_s > run.time_s[0] + 20.0
    return (up - np.interp(time_s, run.time_s, run.position[:, 2]))[settled], sigma[settled]


@pytest.mark.parametrize('above_m', [-3.0, 0.0, 3.0])
def test_sigma_says_how_little_is_known_of_heights(above_m):
    error, sigma = heights(above_m)
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 2.0
    assert 0.5 < sigma.mean() < 1.5


def test_a_map_of_known_heights_can_be_trusted():
    error, sigma = heights(0.0, **{'map.offset_sigma_up_m': 0.1})
    assert sigma.mean() < 0.3
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 2.0

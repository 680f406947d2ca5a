"""Every method over one recording: the same as the pipeline by itself, as a trajectory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from maglev_localization.config import METHODS as CHOICES
from maglev_localization.config import MaglevConfig
from maglev_localization.estimate import Estimate
from maglev_localization.measurements import BalisePassing
from maglev_localization.methods import METHODS, run_methods, trajectory_of
from maglev_localization.pipeline import MaglevPipeline

CONFIG = MaglevConfig(particles=100)


@pytest.fixture(scope='module')
def results(train):
    return {r.name: r for r in run_methods(train.measurements(), CONFIG, train.table, 3000.0)}


def test_all_methods_in_order(results):
    assert tuple(results) == METHODS
    assert set(METHODS) == set(CHOICES)


@pytest.mark.parametrize('name', METHODS)
def test_a_method_is_the_pipeline_with_that_setting(train, results, name):
    pipeline = MaglevPipeline(dataclasses.replace(CONFIG, method=name), train.table, 3000.0)
    estimates = [e for z in train.measurements() for e in pipeline.push(z)]
    result, last = results[name], estimates[-1]
    assert result.trajectory.chainage[-1] == last.chainage
    assert result.trajectory.speed[-1] == last.speed
    assert result.trajectory.sigma_along[-1] == last.sigma_along
    assert result.trajectory.sigma_speed[-1] == last.sigma_speed
    assert result.rejected == pipeline.rejected
    assert result.health == pipeline.health_changes()
    assert result.runtime_s > 0.0
    assert result.notes == ()


@pytest.mark.parametrize('name', METHODS)
def test_the_trajectory_runs_along_x(results, name):
    trajectory = results[name].trajectory
    n = len(trajectory.time_s)
    assert (np.diff(trajectory.time_s) > 0.0).all()
    assert np.array_equal(trajectory.position[:, 0], trajectory.chainage)
    assert np.array_equal(trajectory.velocity[:, 0], trajectory.speed)
    assert not trajectory.position[:, 1:].any()
    assert trajectory.covariance.shape == (n, 3, 3)
    only = np.zeros((n, 3, 3))
    only[:, 0, 0] = trajectory.sigma_along**2
    assert trajectory.covariance == pytest.approx(only, rel=1e-12)


def test_names_are_told_before_each_begins(train):
    told = []
    run = run_methods(
        train.measurements()[:500], CONFIG, train.table, 0.0, ('kalman', 'robust'), told.append
    )
    assert told == []
    assert next(run).name == 'kalman'
    assert told == ['kalman']
    assert next(run).name == 'robust'
    assert told == ['kalman', 'robust']


def test_no_estimate_is_said(train):
    """A start that never comes: the paper's filter with ids that nobody knows."""
    lost = [BalisePassing(1000.0 + k, 'nobody', 0.0, 0.01) for k in range(3)]
    (result,) = run_methods(lost, CONFIG, train.table, 3000.0, ('paper',))
    assert len(result.trajectory.time_s) == 0
    assert result.notes == ('no estimate at all: it never found a start',)
    assert result.rejected == {'balise': {'unknown_id': 3}}


def test_of_two_estimates_at_one_stamp_the_later_counts():
    """And stamps come in order, whatever the order of the estimates."""

    def estimate(time_s, s):
        return Estimate(time_s, np.array([s, 1.0, 0.0]), np.diag([s, 2.0, 3.0]))

    trajectory = trajectory_of([estimate(5.0, 1.0), estimate(4.0, 9.0), estimate(5.0, 4.0)])
    assert trajectory.time_s.tolist() == [4.0, 5.0]
    assert trajectory.chainage.tolist() == [9.0, 4.0]
    assert trajectory.sigma_along.tolist() == [3.0, 2.0]

"""Cutting series at extrema."""

import numpy as np
import pytest

from coaster_localization.segments import cut_points, matched_cut_points


def test_a_sine_is_cut_at_its_extrema():
    t = np.arange(1000) / 100.0
    expected = np.round((np.arange(10) + 0.5) * 100).astype(int).tolist()
    assert cut_points(np.sin(np.pi * t), 0.5).tolist() == [0, *expected, 1000]


def test_ripples_below_the_threshold_are_not_cut():
    t = np.arange(1000) / 100.0
    series = np.sin(np.pi * t) + 0.1 * np.sin(40 * t)
    assert len(cut_points(series, 0.5)) == 12
    assert len(cut_points(series, 0.05)) > 40


def test_neighbours_differ_by_more_than_the_threshold():
    series = np.cumsum(np.random.default_rng(1).normal(size=2000))
    cuts = cut_points(series, 3.0)[1:-1]
    steps = np.diff(series[cuts])
    assert (np.abs(steps) > 3.0).all()
    assert (np.sign(steps[1:]) == -np.sign(steps[:-1])).all()


def test_plateau_is_cut_in_its_middle():
    series = np.concatenate([np.linspace(0, 1, 11), np.ones(20), np.linspace(1, 0, 11)])
    assert cut_points(series, 0.3).tolist() == [0, 20, 42]


@pytest.mark.parametrize('series', [np.ones(50), np.arange(50.0), np.zeros(1), np.array([1, 2.0])])
def test_series_without_extrema_is_one_segment(series):
    assert cut_points(series, 0.1).tolist() == [0, len(series)]


def test_noise_raises_the_measured_threshold_only():
    t = np.arange(4000) / 100.0
    design = np.sin(np.pi * t)
    measured = design + np.random.default_rng(2).normal(0, 0.15, len(t))
    cuts_a, cuts_b = matched_cut_points(measured, design, 0.4)
    assert len(cut_points(measured, 0.4 * design.std())) > 2 * len(cuts_b)
    assert len(cuts_a) - 1 <= 1.2 * (len(cuts_b) - 1)
    assert len(cuts_b) == 42

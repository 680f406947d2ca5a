"""The paper's filter at balises, starts, jumps of the counter and gaps."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.maglev_paper import NO_BALISES, feed, make, settled

from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from track_localization.track.balise_table import BaliseTable


def test_balise_in_the_master_is_a_kalman_update():
    table = BaliseTable(('A',), np.array([401.0]), np.array([0.3]))
    filter_ = settled(table, balise='master')
    m, P = filter_.mean, filter_.covariance
    K = P[:, 0] / (P[0, 0] + 0.09 + 0.01)
    told = filter_.step(BalisePassing(1020.0, 'A', -0.2, 0.01))
    np.testing.assert_allclose(told.mean, m + K * (400.8 - m[0]), rtol=1e-9)
    np.testing.assert_allclose(told.covariance, P - np.outer(K, P[0]), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(filter_.mean, told.mean, rtol=1e-12)


def after_balise(balise):
    """Return errors of 10 s after a balise says that the loop has missed 0.6 m."""
    table = BaliseTable(('A',), np.array([410.0]), np.array([0.02]))
    filter_ = settled(table, balise=balise)
    filter_.step(BalisePassing(1020.47, 'A', 0.0, 1e-4))
    out = feed(filter_, [(20.0 * k, 20.0) for k in range(21, 31)], 1021.0)
    return out[:, 0] - (20.0 * np.arange(21, 31) + 0.6)


def test_balise_sets_the_loop_counter():
    """The train is 0.6 m ahead of its counter. Set by the balise, it stays right to 3 sigma."""
    assert np.abs(after_balise('rezero')).max() < 0.2
    # The master alone forgets: the absolute loop pulls it back within seconds.
    assert after_balise('master')[-1] == pytest.approx(-0.6, abs=0.1)


def test_balise_at_the_loops_stamp_goes_first():
    """A counter 5 m short, 50 sigma: the reading after the balise is taken as 5 m more."""
    table = BaliseTable(('A',), np.array([425.0]), np.array([0.02]))
    filter_ = settled(table)
    filter_.step(BalisePassing(1021.0, 'A', 0.0, 1e-4))
    means = feed(filter_, [(420.0 + 20.0 * k, 20.0) for k in range(10)], 1021.0)
    assert np.abs(means[:, 0] - (425.0 + 20.0 * np.arange(10))).max() < 0.2
    assert filter_.rejections.as_dict() == {}


def test_unknown_balise_is_counted_and_changes_nothing():
    filter_ = settled(NO_BALISES)
    before = filter_.mean
    assert filter_.step(BalisePassing(1020.2, 'Z', 0.0, 1e-4)) is None
    np.testing.assert_array_equal(filter_.mean, before)
    assert filter_.rejections.as_dict() == {'balise': {'unknown_id': 1}}


def test_time_going_backward_is_counted_and_changes_nothing():
    filter_ = settled(NO_BALISES)
    before = filter_.mean
    assert filter_.step(RadarSpeed(1019.5, 90.0, 0.01)) is None
    np.testing.assert_array_equal(filter_.mean, before)
    assert filter_.rejections.as_dict() == {'radar': {'backward_time': 1}}


def test_start_at_a_balise_where_the_place_is_not_known():
    """The counter began elsewhere; nothing comes out until a balise tells."""
    table = BaliseTable(('A',), np.array([3000.0]), np.array([0.05]))
    filter_ = make(table, known=False)
    for k in range(5):
        assert filter_.step(LoopPosition(1000.0 + k, 20.0 * k, 0.01)) is None
        assert filter_.step(RadarSpeed(1000.0 + k, 20.0, 0.01)) is None
    told = filter_.step(BalisePassing(1004.5, 'A', 0.0, 1e-4))
    assert told.mean[0] == pytest.approx(3000.0)
    means = feed(filter_, [(20.0 * k, 20.0) for k in range(5, 15)], 1005.0)
    # The counter is set where the filter, predicting half a second, believes the train to be.
    assert np.abs(means[:, 0] - (3010.0 + 20.0 * np.arange(10))).max() < 1.5
    assert means[-1, 1] == pytest.approx(20.0, abs=0.2)


def test_start_without_a_radar_takes_the_loops_speed():
    filter_ = make()
    for k in range(5):
        filter_.step(LoopPosition(1000.0 + 0.5 * k, 10.0 * k, 0.01))
    assert filter_.started
    assert filter_.mean[1] == pytest.approx(20.0, abs=1.0)
    assert filter_.mean[0] == pytest.approx(40.0, abs=0.5)


def test_start_told_by_hand_sets_the_counter_as_a_balise_does():
    for balise, expected in (('rezero', 5000.0), ('master', 0.0)):
        filter_ = make(balise=balise)
        filter_.set_start(1000.0, 5000.0, 0.01, 20.0)
        means = feed(filter_, [(20.0 * k, 20.0) for k in range(1, 60)], 1001.0)
        # An absolute loop that contradicts is believed.
        assert means[-1, 0] == pytest.approx(expected + 20.0 * (len(means)), abs=0.5)


def test_jump_of_the_counter_is_followed_as_a_kalman_filter_would():
    """20 m at once, 200 sigma, leave no particle: nothing is gated, the loop is believed."""
    filter_ = settled(NO_BALISES)
    means = feed(filter_, [(20.0 * k + 20.0, 20.0) for k in range(21, 61)], 1021.0)
    off = means[:, 0] - 20.0 * np.arange(21, 61)
    assert 5.0 < off[0] < 20.0
    assert np.abs(off[20:] - 20.0).max() < 0.5
    assert np.abs(means[20:, 1] - 20.0).max() < 0.5


def test_gap_of_ten_seconds():
    filter_ = settled(NO_BALISES)
    before = filter_.covariance[0, 0]
    means = feed(filter_, [(20.0 * k, 20.0) for k in range(30, 40)], 1030.0)
    assert before < 0.1
    assert np.abs(means[-5:, 0] - 20.0 * np.arange(35, 40)).max() < 0.3

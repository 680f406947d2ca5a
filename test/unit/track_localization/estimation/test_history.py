"""Rewinding: the order of arrival must not matter."""

import numpy as np
import pytest

from track_localization.estimation.history import History, TooLateError


def apply(state, measurement):
    """A state update that does not commute, so that order shows."""
    return 0.9 * state + measurement


def run(measurements, horizon_s=100.0):
    history = History(apply, 1.0, 0.0, horizon_s)
    for time_s, value, rank in measurements:
        history.add(time_s, value, rank)
    return history


def test_any_order_of_arrival_gives_the_state_of_the_right_order():
    rng = np.random.default_rng(2)
    ordered = [(0.1 * k, float(rng.normal()), 0) for k in range(1, 60)]
    truth = 1.0
    for _, value, _ in ordered:
        truth = 0.9 * truth + value
    for _ in range(10):
        shuffled = [ordered[i] for i in rng.permutation(len(ordered))]
        assert run(shuffled).state == pytest.approx(truth, rel=1e-12)


def test_rank_orders_measurements_of_one_stamp():
    assert run([(1.0, 5.0, 1), (1.0, 2.0, 0)]).state == pytest.approx(0.9 * (0.9 + 2.0) + 5.0)


def test_add_counts_what_it_replays():
    history = run([(1.0, 1.0, 0), (2.0, 1.0, 0), (3.0, 1.0, 0)])
    assert history.add(1.5, 1.0) == 2
    assert history.add(4.0, 1.0) == 0


def test_what_is_older_than_the_history_is_refused():
    history = run([(0.01 * k, 0.0, 0) for k in range(1, 2000)], horizon_s=5.0)
    before = history.state
    with pytest.raises(TooLateError, match='older than the history'):
        history.add(10.0, 1.0)
    assert history.state == before
    history.add(15.5, 1.0)
    assert history.state != before


def test_memory_is_bounded_and_reaches_the_horizon():
    history = run([(0.01 * k, 0.0, 0) for k in range(1, 5000)], horizon_s=2.0)
    assert len(history) < 300
    assert history.newest_s - history.oldest_s >= 2.0


def test_trimming_is_not_counted_as_replaying():
    """In order nothing is replayed, however often the history forgets."""
    history = History(lambda state, z: state + z, 0.0, 0.0, horizon_s=1.0)
    assert [history.add(0.1 * k, 1.0) for k in range(1, 100)] == [0] * 99


def test_the_state_just_after_a_late_measurement():
    """It stands before all that was replayed; of what is forgotten, the oldest state stands in."""
    history = run([(1.0, 5.0, 0), (3.0, 7.0, 0), (4.0, 9.0, 0)])
    replayed = history.add(2.0, 11.0)
    assert replayed == 2
    assert history.state_before(replayed) == pytest.approx(apply(apply(1.0, 5.0), 11.0))
    assert history.state_before(0) == history.state
    assert history.state_before(99) == 1.0

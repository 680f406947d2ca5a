"""The way of messages: latency, loss and gaps, measured from stamps and arrivals."""

import numpy as np
import pytest

from track_localization.settings import override
from track_localization.sim.maglev.config import Delivery
from track_localization.sim.maglev.delivery import deliver

FAULTLESS = {
    'dropped': 0.0,
    'late': 0.0,
    'latency_s': (0.0, 0.0),
    'latency_tail_s': 0.0,
    'gaps': 0.0,
}
T = np.arange(0.0, 1000.0, 0.02)


def sent(seed=1, **changes):
    way = deliver(
        np.random.default_rng(seed), override(Delivery(), {**FAULTLESS, **changes}), T, 1000.0
    )
    return way.arrival_s - T, way.kept


def test_without_faults_everything_arrives_at_once():
    delay, kept = sent()
    assert kept.all()
    np.testing.assert_array_equal(delay, 0.0)


def test_least_latency_is_drawn_once_a_run():
    """10 to 30 ms, 20 in the mean (sigma 5.8 ms), over 300 runs."""
    least = []
    for seed in range(300):
        delay, _ = sent(seed, latency_s=(0.01, 0.03))
        assert np.ptp(delay) < 1e-9
        least.append(delay[0])
    assert np.mean(least) == pytest.approx(0.02, abs=4 * 0.0058 / np.sqrt(300))
    assert min(least) >= 0.01
    assert max(least) <= 0.03


def test_tail_of_the_latency_is_exponential():
    """Mean and standard deviation both 5 ms; 50,000 draws."""
    delay, _ = sent(latency_tail_s=0.005)
    assert delay.min() >= -1e-12
    assert delay.mean() == pytest.approx(0.005, rel=4 / np.sqrt(50_000))
    assert delay.std() == pytest.approx(0.005, rel=4 * np.sqrt(2 / 50_000))


def test_late_messages():
    """2 % by 0.2 to 1 s, 0.6 in the mean; the others not at all."""
    delay, kept = sent(late=0.02)
    late = delay > 1e-9
    assert late.mean() == pytest.approx(0.02, abs=4 * np.sqrt(0.02 / 50_000))
    assert delay[late].min() > 0.2 - 1e-9
    assert delay[late].max() < 1.0 + 1e-9
    assert delay[late].mean() == pytest.approx(0.6, abs=4 * 0.23 / np.sqrt(1000))
    assert kept.all()


def test_dropped_messages():
    """1 %, one by one: two in a row no more often than by chance."""
    _, kept = sent(dropped=0.01)
    assert 1.0 - kept.mean() == pytest.approx(0.01, abs=4 * np.sqrt(0.01 / 50_000))
    pairs = np.sum(~kept[1:] & ~kept[:-1])
    assert pairs < 5 + 4 * np.sqrt(5)


def test_gaps():
    """Two in the mean, each of 0.5 to 2 s in one piece, over 200 runs."""
    lengths, counts = [], []
    for seed in range(200):
        _, kept = sent(seed, gaps=2.0)
        edges = np.flatnonzero(np.diff(np.concatenate([[1], kept, [1]])))
        pieces = (edges[1::2] - edges[::2]) * 0.02
        counts.append(len(pieces))
        lengths.extend(pieces)
    assert np.mean(counts) == pytest.approx(2.0, abs=4 * np.sqrt(2.0 / 200))
    assert np.mean(lengths) == pytest.approx(1.25, abs=4 * 0.43 / np.sqrt(400))
    assert np.median(lengths) < 2.0

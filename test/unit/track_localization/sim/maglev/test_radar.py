"""The Doppler radar: each of its errors alone, measured from what it tells."""

import numpy as np
import pytest

from track_localization.settings import override
from track_localization.sim.maglev.config import RadarErrors
from track_localization.sim.maglev.radar import read_radar

RATE = 20.0
FAULTLESS = {
    'scale': 0.0,
    'drift': 0.0,
    'noise_mps': 0.0,
    'noise_share': 0.0,
    'outliers': 0.0,
    'slips': 0,
    'least_mps': 0.0,
}


def told(v, seed=1, **changes):
    """Return what a radar with only these errors tells of true speeds."""
    config = override(RadarErrors(), {**FAULTLESS, **changes})
    t = np.arange(len(v)) / RATE
    return read_radar(np.random.default_rng(seed), config, t, np.asarray(v, dtype=float))[0]


def test_without_faults_it_tells_the_truth():
    v = np.linspace(0.0, 27.8, 500)
    np.testing.assert_array_equal(told(v), v)


@pytest.mark.parametrize('speed', [1.0, 10.0, 27.8])
def test_noise_grows_with_speed(speed):
    """0.05 m/s + 0.3 % of the speed; 20,000 draws tell the sigma to 0.5 %."""
    error = told(np.full(20000, speed), noise_mps=0.05, noise_share=0.003) - speed
    sigma = 0.05 + 0.003 * speed
    assert error.std() == pytest.approx(sigma, rel=4 * 0.005)
    assert error.mean() == pytest.approx(0.0, abs=4 * sigma / np.sqrt(20000))
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 4 / np.sqrt(20000)


def test_scale_is_drawn_once_a_run():
    """N(0, 0.5 %) over 1000 runs (its sigma known to 2.2 %), the same throughout a run."""
    scales = []
    for seed in range(1000):
        ratio = told([5.0, 20.0, 27.8], seed, scale=0.005) / [5.0, 20.0, 27.8] - 1.0
        assert np.ptp(ratio) < 1e-12
        scales.append(ratio[0])
    assert np.std(scales) == pytest.approx(0.005, rel=4 * 0.022)
    assert np.mean(scales) == pytest.approx(0.0, abs=4 * 0.005 / np.sqrt(1000))


def test_scale_drifts_over_a_minute():
    """Rms 0.2 %, correlated as exp(-t / 60 s); 28 h hold 830 independent stretches."""
    drift = told(np.full(2_000_000, 10.0), drift=0.002) / 10.0 - 1.0
    variance = np.mean(drift**2)
    assert variance == pytest.approx(0.002**2, rel=4 * np.sqrt(2 / 830))
    for lag in (30, 60, 120):
        shift = round(lag * RATE)
        correlation = np.mean(drift[shift:] * drift[:-shift]) / variance
        assert correlation == pytest.approx(np.exp(-lag / 60.0), abs=4 / np.sqrt(830))
    firsts = [told([10.0], seed, drift=0.002)[0] / 10.0 - 1.0 for seed in range(500)]
    assert np.std(firsts) == pytest.approx(0.002, rel=4 * 0.032)  # from the first sample on


def test_outliers():
    """1 % of 100,000 samples, off by 5 m/s to either side."""
    error = told(np.full(100_000, 20.0), outliers=0.01) - 20.0
    share = np.mean(error != 0.0)
    assert share == pytest.approx(0.01, abs=4 * np.sqrt(0.01 / 100_000))
    np.testing.assert_allclose(np.abs(error[error != 0.0]), 5.0)
    assert np.mean(error[error != 0.0] > 0.0) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(1000))


def test_one_slip_a_run():
    """3 % to either side for 5 to 15 s, 10 s in the mean (sigma 2.9 s), over 200 runs."""
    lengths, signs = [], []
    v = np.full(round(400 * RATE), 20.0)
    for seed in range(200):
        share = told(v, seed, slips=1) / v - 1.0
        slipping = np.flatnonzero(share)
        assert np.ptp(slipping) == len(slipping) - 1  # in one piece
        np.testing.assert_allclose(np.abs(share[slipping]), 0.03)
        if slipping[-1] < len(v) - 1:
            lengths.append(len(slipping) / RATE)
            signs.append(share[slipping[0]] > 0.0)
    assert np.mean(lengths) == pytest.approx(10.0, abs=4 * 2.9 / np.sqrt(len(lengths)))
    assert min(lengths) >= 4.95
    assert max(lengths) <= 15.05
    assert np.mean(signs) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(len(signs)))


def test_a_slip_begins_on_the_move():
    """A train that stands first does not slip there."""
    v = np.concatenate([np.zeros(4000), np.full(4000, 20.0)])
    for seed in range(30):
        share = told(v, seed, slips=1)[4000:] / 20.0 - 1.0
        assert (share != 0.0).any()
    np.testing.assert_array_equal(told(np.zeros(100), slips=1), 0.0)


def test_unreliable_at_a_crawl():
    """Below 0.5 m/s half of the samples read 0, the others N(0, 0.2 m/s), whatever the speed."""
    crawl = told(np.full(20000, 0.49), least_mps=0.5)
    zero = crawl == 0.0
    assert zero.mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(20000))
    assert crawl[~zero].std() == pytest.approx(0.2, rel=0.03)
    assert crawl[~zero].mean() == pytest.approx(0.0, abs=4 * 0.2 / 100)
    np.testing.assert_array_equal(told(np.full(100, 0.51), least_mps=0.5), 0.51)


def test_outliers_come_at_a_crawl_too():
    crawl = told(np.full(20000, 0.1), least_mps=0.5, outliers=0.01)
    assert np.mean(np.abs(crawl) > 4.0) == pytest.approx(0.01, abs=4 * np.sqrt(0.01 / 20000))


def test_what_the_sender_claims():
    """Its noise at the speed that it tells, and never nothing."""
    v = np.full(1000, 20.0)
    t = np.arange(1000) / RATE
    speed, variance, _ = read_radar(np.random.default_rng(1), RadarErrors(), t, v)
    np.testing.assert_allclose(variance, (0.05 + 0.003 * np.abs(speed)) ** 2)
    silent = override(RadarErrors(), FAULTLESS)
    assert (read_radar(np.random.default_rng(1), silent, t, v)[1] > 0.0).all()

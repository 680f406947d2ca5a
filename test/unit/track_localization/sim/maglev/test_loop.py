"""The induction loop: what its counter misses, measured from its readings alone."""

import numpy as np
import pytest

from track_localization.settings import override
from track_localization.sim.maglev.config import LoopErrors
from track_localization.sim.maglev.loop import read_loop
from track_localization.sim.maglev.motion import Motion

PITCH = 0.2
FAULTLESS = {
    'missed': 0.0,
    'extra': 0.0,
    'bursts_per_km': 0.0,
    'dead_zones_per_km': 0.0,
    'glitches': 0,
}


def even(speed, duration, start=0.0):
    """Return motion at an even speed, by its closed form."""
    s = np.array([start, start + speed * duration])
    return Motion(np.array([0.0, duration]), s, np.array([speed] * 2), np.zeros(2), np.zeros(1))


def counted(seed=1, speed=20.0, duration=3000.0, start=0.0, balises_s=(), dt=0.02, **changes):
    """Return times, counts and true counts of a run at an even speed."""
    t = np.arange(0.0, duration + 1e-9, dt)
    config = override(LoopErrors(), {**FAULTLESS, **changes})
    reading, _, _ = read_loop(
        np.random.default_rng(seed),
        config,
        even(speed, duration, start),
        t,
        np.array(balises_s, dtype=float),
    )
    counts = np.round(reading / PITCH)
    np.testing.assert_allclose(reading, counts * PITCH, atol=1e-9)
    return t, counts, np.floor((start + speed * t) / PITCH + 1e-6)


def losses(counts, true):
    """Return the lasting falls of count less true count; neighbours within 20 samples are one."""
    behind = true - counts
    at = np.flatnonzero(np.diff(behind))
    groups = np.split(at, np.flatnonzero(np.diff(at) > 20) + 1)
    return np.array([behind[g[-1] + 1] - behind[g[0]] for g in groups if len(g)])


def test_without_faults_it_counts_every_crossing():
    """The reading is the floor of the position in pitches, from the start's on."""
    for start in (0.0, 1234.5):
        _, counts, true = counted(start=start, duration=50.0)
        np.testing.assert_array_equal(counts, true)


def test_share_of_missed_crossings():
    """300,000 crossings, 0.14 %: 420 missed, four sigma are 82."""
    _, counts, true = counted(missed=0.0014)
    assert true[-1] - counts[-1] == pytest.approx(420, abs=82)
    assert set(np.unique(np.diff(true - counts))) <= {0.0, 1.0, 2.0}


def test_share_of_crossings_counted_twice():
    """1,500,000 crossings in five runs, 0.005 %: 75 too many, four sigma are 35."""
    total = sum(c[-1] - n[-1] for _, c, n in (counted(s, extra=5e-5) for s in range(5)))
    assert total == pytest.approx(75, abs=35)


def test_bursts():
    """0.02 a km over 100 runs of 60 km: 120, of 3 to 29 crossings, 16 in the mean."""
    runs = [counted(seed, bursts_per_km=0.02, dt=0.1) for seed in range(100)]
    sizes = np.concatenate([losses(counts, true) for _, counts, true in runs])
    assert len(sizes) == pytest.approx(120, abs=4 * 11)
    assert (sizes.min(), sizes.max()) == (3, 29)
    assert sizes.mean() == pytest.approx(16.0, abs=4 * 7.8 / np.sqrt(120))


def test_dead_zones():
    """0.02 a km over 100 runs: 120, in which 5 to 40 m go uncounted, 22.5 m in the mean."""
    runs = [counted(seed, dead_zones_per_km=0.02, dt=0.1) for seed in range(100)]
    lengths = PITCH * np.concatenate([losses(counts, true) for _, counts, true in runs])
    assert len(lengths) == pytest.approx(120, abs=4 * 11)
    assert 4.8 < lengths.min() < 7.0
    assert 37.0 < lengths.max() < 40.2
    assert lengths.mean() == pytest.approx(22.5, abs=4 * 10.1 / np.sqrt(120))


def test_nothing_is_counted_within_a_dead_zone():
    """The reading stands still while the train runs on for the zone's length."""
    t, counts, true = counted(3, dead_zones_per_km=0.1, dead_zone_m=(30.0, 30.0), duration=2000.0)
    standing = np.flatnonzero(np.diff(true - counts))
    begin, end = t[standing[0]], t[standing[standing < standing[0] + 200][-1]]
    assert 20.0 * (end - begin) == pytest.approx(30.0, abs=0.8)  # two samples' way
    inside = (t > begin + 0.04) & (t < end - 0.04)
    assert np.ptp(counts[inside]) == 0.0


def test_one_glitch_a_run():
    """One lasting jump of 1 to 40 counts, either sign: |mean| 20.5, sigma 11.5, over 300 runs."""
    sizes = []
    for seed in range(300):
        _, counts, true = counted(seed, duration=20.0, glitches=1)
        change = np.diff(counts - true)
        assert np.count_nonzero(change) == 1
        sizes.append(change.sum())
    sizes = np.array(sizes)
    assert np.abs(sizes).mean() == pytest.approx(20.5, abs=4 * 11.5 / np.sqrt(300))
    assert np.abs(sizes).max() == 40
    assert (sizes > 0).mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(300))


def test_jumps_at_balises():
    """At each balise, within 50 ms and a sample of it; with half the chance at half of them."""
    crossed = np.arange(5.0, 2995.0, 10.0)
    t, counts, true = counted(balises_s=crossed, jump_at_balise=1.0)
    jumped = t[1:][np.diff(counts - true) != 0.0]
    assert len(jumped) == len(crossed)
    assert np.abs(jumped - crossed).max() <= 0.05 + 0.02
    _, counts, true = counted(2, balises_s=crossed, jump_at_balise=0.5)
    share = np.count_nonzero(np.diff(counts - true)) / len(crossed)
    assert share == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(len(crossed)))


def test_a_counter_may_begin_anywhere():
    _, counts, true = counted(
        start=777.0, duration=10.0, starts_at_chainage=False, start_reading_m=-40.0
    )
    np.testing.assert_array_equal(counts - counts[0], true - true[0])
    assert counts[0] == -200


@pytest.mark.parametrize(('begin', 'length'), [(4.0, 3.0), (0.0, 3.0), (4.0, 100.0)])
def test_a_failed_counter_counts_on_where_it_stopped(begin, length):
    """What passed while it failed is lost; at the start, in between, and to the end."""
    t, counts, true = counted(duration=10.0, dead_from_s=begin, dead_for_s=length)
    failed = (t >= begin) & (t < begin + length)
    assert np.ptp(counts[failed]) == 0.0
    after = t >= begin + length
    lost = 20.0 * length / PITCH
    np.testing.assert_allclose(true[after] - counts[after], lost, atol=2.0)
    np.testing.assert_array_equal(counts[t < begin], true[t < begin])


def test_a_counter_that_goes_on_unseen_loses_nothing():
    _, counts, true = counted(duration=10.0, dead_from_s=4.0, dead_for_s=3.0, dead_counts=True)
    np.testing.assert_array_equal(counts, true)


def test_nothing_is_counted_at_a_standstill():
    t = np.arange(0.0, 20.0, 0.02)
    config = override(LoopErrors(), {'glitches': 0})
    rng = np.random.default_rng(1)
    reading, _, _ = read_loop(rng, config, even(0.0, 20.0, 1700.0), t, np.zeros(0))
    assert (np.abs(reading - 1700.0) < 1e-9).all()


def test_what_the_sender_claims():
    """Quantisation's pitch^2/12 and 0.02 m: nothing of the faults."""
    t = np.arange(0.0, 1.0, 0.02)
    rng = np.random.default_rng(1)
    _, variance, _ = read_loop(rng, LoopErrors(), even(20.0, 1.0), t, np.zeros(0))
    np.testing.assert_allclose(variance, 0.2**2 / 12 + 0.02**2)


def test_an_absolute_loop_has_white_noise():
    """The paper's: chainage plus N(0, 0.01 m^2); 50,000 draws tell the variance to 0.6 %."""
    t = np.arange(0.0, 1000.0, 0.02)
    config = override(LoopErrors(), {'absolute': True, 'noise_m': 0.1})
    rng = np.random.default_rng(1)
    reading, variance, _ = read_loop(rng, config, even(20.0, 1000.0, 50.0), t, np.zeros(0))
    error = reading - 50.0 - 20.0 * t
    assert error.var() == pytest.approx(0.01, rel=4 * 0.0063)
    assert error.mean() == pytest.approx(0.0, abs=4 * 0.1 / np.sqrt(50000))
    lag = np.corrcoef(error[1:], error[:-1])[0, 1]
    assert abs(lag) < 4 / np.sqrt(50000)
    np.testing.assert_allclose(variance, 0.01)


def test_what_is_reported_is_what_was_done():
    """The faults told beside the readings add up to what the readings lack."""
    t = np.arange(0.0, 200.0, 0.02)
    rng = np.random.default_rng(7)
    config = override(
        LoopErrors(),
        {
            'missed': 0.01,
            'extra': 0.003,
            'glitches': 2,
            'bursts_per_km': 0.0,
            'dead_zones_per_km': 0.0,
        },
    )
    reading, _, info = read_loop(rng, config, even(20.0, 200.0), t, np.zeros(0))
    told = info['extra'] - info['missed'] + sum(size for _, size in info['jumps'])
    assert round((reading[-1] - np.floor(20.0 * t[-1] / PITCH) * PITCH) / PITCH) == told

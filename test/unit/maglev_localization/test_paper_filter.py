"""The paper's filter on a train of its own model: against a Kalman filter, balises, bad starts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from maglev_localization.config import MaglevConfig, MotionConfig, PaperConfig
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from maglev_localization.paper_filter import PaperFilter
from maglev_localization.paper_kernels import ALL, MEAN
from maglev_localization.paper_locals import LocalFilters
from track_localization.errors import DataError
from track_localization.track.balise_table import BaliseTable

NO_BALISES = BaliseTable((), np.zeros(0), np.zeros(0))
H = np.eye(3)[:2]


def motion(T):
    F = np.array([[1.0, T, T * T / 2.0], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    G = np.array([T**3 / 6.0, T * T / 2.0, T])
    return F, G


def paper_run(seed, steps=100):
    """Return truth (steps + 1, 3) from 20 m/s and 1 m/s^2 on, and readings (steps + 1, 2)."""
    rng = np.random.default_rng([seed, 7])
    F, G = motion(1.0)
    x = [np.array([0.0, 20.0, 1.0])]
    for _ in range(steps):
        x.append(F @ x[-1] + G * np.sqrt(0.001) * rng.normal())
    truth = np.array(x)
    return truth, truth[:, :2] + 0.1 * rng.normal(size=(steps + 1, 2))


def optimum(z):
    """Return the Kalman filter's means, started as the filter under test is."""
    F, G = motion(1.0)
    m, P, out = np.array([z[0, 0], z[0, 1], 0.0]), np.diag([1.0, 0.25, 1.0]), []
    for one in z[1:]:
        m, P = F @ m, F @ P @ F.T + 0.001 * np.outer(G, G)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 0.01 * np.eye(2))
        m, P = m + K @ (one - H @ m), P - K @ H @ P
        out.append(m)
    return np.array(out)


def make(table=NO_BALISES, count=1000, seed=1, known=True, **paper):
    return PaperFilter(
        MaglevConfig(
            method='paper',
            particles=count,
            seed=seed,
            motion=MotionConfig(start_known=known),
            paper=PaperConfig(**paper),
        ),
        table,
    )


def feed(filter_, z, begin=1000.0, T=1.0):
    """Feed loop and radar in step; return the estimates' means."""
    out = []
    for k, (loop, radar) in enumerate(z):
        assert filter_.step(LoopPosition(begin + k * T, loop, 0.01)) is None
        out.append(filter_.step(RadarSpeed(begin + k * T, radar, 0.01)).mean)
    return np.array(out)


def against_optimum(seeds, count, **paper):
    """Return rms errors over the Kalman filter's, of chainage and speed; the greatest error."""
    errors, floor = [], []
    for seed in seeds:
        truth, z = paper_run(seed)
        errors.append(feed(make(count=count, seed=seed, **paper), z)[1:] - truth[1:])
        floor.append(optimum(z) - truth[1:])
    rms, best = (np.sqrt(np.mean(np.square(e), axis=(0, 1))) for e in (errors, floor))
    return (rms / best)[:2], np.abs(np.array(errors)[:, :, 0]).max()


def test_as_good_as_the_kalman_filter():
    """At N = 1000 within 3 % of the optimum, none of 200 runs lost (errors are 0.07 m rms)."""
    ratio, worst = against_optimum(range(200), 1000)
    assert ratio.max() <= 1.03
    assert worst < 0.5


def test_nearer_to_the_kalman_filter_with_more_particles():
    ratio, worst = against_optimum(range(60), 10000)
    assert ratio.max() <= 1.005
    assert worst < 0.5


@pytest.mark.parametrize('scheme', ['systematic', 'stratified', 'residual', 'multinomial'])
def test_every_scheme_works(scheme):
    """Multinomial draws add most noise; 30 runs know the ratio to 1 %."""
    ratio, worst = against_optimum(range(30), 1000, resampling=scheme)
    assert ratio.max() <= 1.05
    assert worst < 0.5


@pytest.mark.parametrize('feedback', ['mean', 'mean_covariance'])
@pytest.mark.parametrize('count', [100, 1000])
def test_either_feedback_follows_even_with_few_particles(feedback, count):
    """None of 60 runs lost; the error over the optimum's falls with N: 8 % at 100, 3 at 1000."""
    ratio, worst = against_optimum(range(60), count, feedback=feedback)
    assert ratio.max() <= {100: 1.08, 1000: 1.03}[count]
    assert worst < 0.5


def test_what_the_master_gives_back():
    """The mean to both clouds; P / share too, or their own covariances are left to them."""
    rng, shares = np.random.default_rng(3), np.array([0.8, 0.2])
    mean, P = np.array([100.0, 30.0, 1.0]), np.diag([0.04, 0.01, 0.09])
    for given, expected in ((MEAN, np.stack([P / 0.8, P / 0.2])), (ALL, P / [[[0.4]], [[0.1]]])):
        clouds = LocalFilters(20000, 'systematic', rng)
        clouds.draw(mean, P, shares)
        # 20,000 draws know a variance to 1 %.
        np.testing.assert_allclose(clouds.covariances, np.stack([P / 0.8, P / 0.2]), atol=0.02)
        clouds.advance(mean + 1.0, 2.0 * P, shares, given, 0.0, 0.0)
        np.testing.assert_allclose(clouds.means, np.stack([mean + 1.0] * 2), rtol=1e-12)
        np.testing.assert_allclose(clouds.covariances, expected, atol=0.04 * expected.max())
        fused, P_fused, regular = clouds.fused()
        assert regular
        np.testing.assert_allclose(fused, mean + 1.0, rtol=1e-9)
        if given == ALL:
            np.testing.assert_allclose(P_fused, 2.0 * P, rtol=1e-9, atol=1e-12)


def test_covariance_is_honest():
    """Mean NEES of chainage, speed and acceleration over 60 runs: 3 +- 4 sqrt(6 / 60)."""
    nees = []
    for seed in range(60):
        truth, z = paper_run(seed)
        filter_ = make(seed=seed)
        e = feed(filter_, z)[-1] - truth[-1]
        nees.append(e @ np.linalg.solve(filter_.covariance, e))
    assert np.mean(nees) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / 60.0))


def test_sensors_out_of_step():
    """Loop and radar at random times, up to 0.4 s apart: still within 3 % of the optimum."""
    errors, floor = [], []
    for seed in range(20):
        rng = np.random.default_rng([seed, 9])
        filter_ = make(count=2000, seed=seed)
        x, time_s = np.array([0.0, 20.0, 1.0]), 0.0
        feed(filter_, [x[:2]], 0.0)
        m, P = np.array([0.0, 20.0, 0.0]), np.diag([1.0, 0.25, 1.0])
        for _ in range(400):
            T = rng.uniform(0.01, 0.4)
            F, G = motion(T)
            Q = 0.001 / T * np.outer(G, G)
            x, time_s = F @ x + G * np.sqrt(0.001 / T) * rng.normal(), time_s + T
            m, P = F @ m, F @ P @ F.T + Q
            k = int(rng.integers(2))
            z = x[k] + 0.1 * rng.normal()
            K = P[:, k] / (P[k, k] + 0.01)
            m, P = m + K * (z - m[k]), P - np.outer(K, P[k])
            filter_.step((LoopPosition, RadarSpeed)[k](time_s, z, 0.01))
            errors.append((filter_.mean - x)[:2])
            floor.append((m - x)[:2])
    rms, best = (np.sqrt(np.mean(np.square(e), axis=0)) for e in (errors, floor))
    assert (rms / best).max() <= 1.03


@pytest.mark.parametrize('T', [0.1, 1.0, 5.0])
def test_jerk_has_the_same_intensity_at_every_interval(T):
    """After 100 s unseen the acceleration's variance has grown by 100 s times the density."""
    filter_ = make(count=50000, radar_variance=1e12, process_variance=0.5)
    filter_.set_start(0.0, 0.0, 1.0, 20.0, 0.01)
    for k in range(round(100.0 / T)):
        filter_.step(RadarSpeed((k + 1) * T, 20.0, 0.01))
    # 50 (m/s^2)^2 and 1 from the start; 50,000 particles know it to 0.6 %, more after many steps.
    assert filter_.covariance[2, 2] == pytest.approx(51.0, rel=0.05)


def test_estimates_come_at_radar_and_balise_only():
    table = BaliseTable(('A',), np.array([25.0]), np.array([0.05]))
    filter_ = make(table)
    assert filter_.step(LoopPosition(1000.0, 0.0, 0.01)) is None
    assert not filter_.started
    first = filter_.step(RadarSpeed(1000.0, 20.0, 0.01))
    assert filter_.started
    assert first.time_s == 1000.0
    assert filter_.step(LoopPosition(1001.0, 20.0, 0.01)) is None
    assert filter_.step(BalisePassing(1001.25, 'A', 0.0, 1e-4)).time_s == 1001.25
    assert filter_.step(RadarSpeed(1002.0, 20.0, 0.01)).time_s == 1002.0
    assert set(filter_.n_eff) == {'loop', 'radar'}
    assert all(1.0 <= n <= 1000.0 for n in filter_.n_eff.values())


def settled(table, seconds=20, **options):
    """Return a filter that has followed 20 m/s for a while, at 1000 s + ``seconds``."""
    filter_ = make(table, **options)
    feed(filter_, [(20.0 * k, 20.0) for k in range(seconds + 1)])
    return filter_


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


def test_same_seed_same_bits():
    _, z = paper_run(3)
    one, two, other = (feed(make(seed=s), z) for s in (5, 5, 6))
    np.testing.assert_array_equal(one, two)
    assert np.abs(one - other).max() > 1e-6


def test_loops_share_of_information_changes_with_speed():
    """With 1 % of it left to the radar above 70 m/s, its particles spread ten times wider."""
    truth, z = paper_run(4)
    filter_, shares = make(share_fast=0.99, share_slow=0.5), []
    for k, one in enumerate(z):
        feed(filter_, [one], 1000.0 + k)
        shares.append(filter_.n_eff['radar'])
    speed = truth[:, 1]
    slow, fast = (np.median(np.array(shares)[m]) for m in (speed < 68.0, speed > 72.0))
    assert fast < 0.4 * slow


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


def test_manoeuvres_beyond_the_model_at_fifty_hertz():
    """
    Jerks of 1 m/s^3, thirty times the model's, many readings a second: as a Kalman filter does.

    Particles that are resampled faster than jerks renew them would lose the train by metres.
    """
    rng, T = np.random.default_rng(5), 0.02
    jerk = np.repeat(rng.choice([-1.0, 0.0, 1.0], 30), 50)
    a = np.concatenate([[0.0], np.cumsum(jerk * T)])
    v = 20.0 + np.concatenate([[0.0], np.cumsum(a[:-1] * T + 0.5 * jerk * T * T)])
    p = np.concatenate([[0.0], np.cumsum(v[:-1] * T + 0.5 * a[:-1] * T**2 + jerk * T**3 / 6.0)])
    z = np.stack([p, v], axis=1) + 0.1 * rng.normal(size=(len(p), 2))
    filter_ = make()
    ours = feed(filter_, z, T=T)
    F, G = motion(T)
    m, P, best = np.array([*z[0], 0.0]), np.diag([1.0, 0.25, 1.0]), []
    for one in z[1:]:
        m, P = F @ m, F @ P @ F.T + 0.001 / T * np.outer(G, G)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 0.01 * np.eye(2))
        m, P = m + K @ (one - H @ m), P - K @ H @ P
        best.append(m)
    rms, floor = (np.sqrt(np.mean((e[:, 0] - p[1:]) ** 2)) for e in (ours[1:], np.array(best)))
    assert rms < 1.15 * floor
    np.testing.assert_allclose(np.diag(filter_.covariance), np.diag(P), rtol=0.15)


def test_gap_of_ten_seconds():
    filter_ = settled(NO_BALISES)
    before = filter_.covariance[0, 0]
    means = feed(filter_, [(20.0 * k, 20.0) for k in range(30, 40)], 1030.0)
    assert before < 0.1
    assert np.abs(means[-5:, 0] - 20.0 * np.arange(35, 40)).max() < 0.3


def missed_crossings(seed, share=0.0014, pitch=0.2):
    """Return truth and readings of a loop that counts crossings and misses a share of them."""
    truth, z = paper_run(seed)
    rng = np.random.default_rng([seed, 8])
    crossed = np.diff(np.floor(truth[:, 0] / pitch), prepend=0.0).astype(int)
    z[:, 0] = pitch * np.cumsum(rng.binomial(crossed, 1.0 - share))
    return truth, z


def test_papers_figures_4_and_6():
    """Errors grow to about 10 m without balises; with one each km they stay below 2 m or so."""
    table = BaliseTable(
        tuple(f'B{k}' for k in range(1, 8)), 1000.0 * np.arange(1, 8), np.full(7, 0.05)
    )
    without, with_balises = [], []
    for seed in range(15):
        truth, z = missed_crossings(seed)
        e = feed(make(seed=seed), z)[:, 0] - truth[:, 0]
        without.append(np.abs(e[[50, 100]]) / (0.0014 * truth[[50, 100], 0]))
        filter_, errors, passed = make(table, seed=seed), [], 0
        for k, one in enumerate(z):
            while k and passed < 7 and table.chainage[passed] < truth[k, 0]:
                # Time of passing between samples from the closed form of constant jerk.
                jerk = truth[k, 2] - truth[k - 1, 2]
                p, v, a = truth[k - 1]
                roots = np.roots([jerk / 6.0, a / 2.0, v, p - table.chainage[passed]])
                near = roots[np.argmin(np.abs(roots - 0.5))].real
                filter_.step(BalisePassing(999.0 + k + near, table.id[passed], 0.0, 1e-4))
                passed += 1
            errors.append(feed(filter_, [one], 1000.0 + k)[0, 0] - truth[k, 0])
        assert passed >= 5
        with_balises.append(np.abs(errors).max())
    # Off by what the counter has missed, 0.14 % of the way, 3 m and 10 m; 15 runs know the median
    # of a count of 49 to 5 %, of 16 to 8 %.
    np.testing.assert_allclose(np.median(without, axis=0), [1.0, 1.0], atol=0.25)
    assert 1.0 < np.median(with_balises) < 2.2


def test_too_few_particles():
    with pytest.raises(DataError, match='particles'):
        make(count=5)


def test_settings_of_the_paper_are_the_defaults():
    paper = dataclasses.asdict(PaperConfig())
    assert paper['process_variance'] == 0.001
    assert paper['loop_variance'] == paper['radar_variance'] == 0.01
    assert (paper['share_slow'], paper['share_fast'], paper['share_speed_mps']) == (0.8, 0.5, 70.0)

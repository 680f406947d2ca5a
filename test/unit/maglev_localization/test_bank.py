"""A bank of hypotheses: resampling without bias, merging by moments, federation loses nothing."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_localization import bank, line_kernels
from maglev_localization.line_kernels import SIZE, A, B, C, K, Noise, S, V

SHARE = 0.5
NOISE = Noise(0.1, 1e-8, 1e-12, 9e-8)
SIGMA = np.array([0.05, 0.2, 0.3, 0.3, 1e-4, 1e-2])
TO_CHAINAGE = np.zeros((3, SIZE))
TO_CHAINAGE[0, C], TO_CHAINAGE[0, B], TO_CHAINAGE[1, V], TO_CHAINAGE[2, A] = 1.0, -1.0, 1.0, 1.0


def covariance(rng, sigma=SIGMA):
    W = rng.normal(size=(SIZE, 2 * SIZE))
    R = W @ W.T
    d = np.sqrt(np.diag(R))
    return R / np.outer(d, d) * np.outer(sigma, sigma)


def hypotheses(rng, count, spread=0.0):
    """Return a bank of this many, federated: means apart by ``spread`` sigmas."""
    w = np.sort(rng.random(count))[::-1]
    mean = np.array([500.0, 20.0, 0.1, -40.0, 0.0, 0.0])
    x = np.empty((count, 2, SIZE))
    P = np.empty((count, 2, SIZE, SIZE))
    for i in range(count):
        x[i, :] = mean + spread * SIGMA * rng.normal(size=SIZE)
        P[i, :] = covariance(rng) / SHARE
    return np.log(w / w.sum()), x, P


def threshold(w, most):
    """Return c with sum(min(w / c, 1)) = most, by bisection (Fearnhead and Clifford, eq. 6)."""
    low, high = 0.0, 1.0
    for _ in range(200):
        c = 0.5 * (low + high)
        low, high = (c, high) if np.minimum(w / c, 1.0).sum() > most else (low, c)
    return c


def test_few_candidates_all_stay_the_heaviest_first(rng):
    log_w = rng.normal(size=9)
    kept, new_w = bank.choose(log_w, 9, 0.3)
    assert sorted(kept) == list(range(9))
    assert (np.diff(new_w) <= 0.0).all()
    assert np.exp(new_w) == pytest.approx(np.exp(log_w[kept]) / np.exp(log_w).sum(), rel=1e-12)


def test_what_weighs_nothing_is_dropped():
    """exp(-14) is a millionth: 0 and -13.9 stay, -14.1 and -inf go."""
    kept, new_w = bank.choose(np.array([-14.1, 0.0, -np.inf, -13.9]), 10, 0.5)
    assert list(kept) == [1, 3]
    assert np.exp(new_w).sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize('most', [1, 2, 7, 19])
def test_resampling_is_unbiased(rng, most):
    """
    Averaged over all draws every candidate keeps the weight it had.

    Draws stand in a grid of 4000; systematic resampling changes its mind a few times in a grid
    step at most, so the average is right to a few in 4000.
    """
    log_w = np.log(rng.exponential(size=20) ** 2)
    w = np.exp(log_w) / np.exp(log_w).sum()
    grid = (np.arange(4000) + 0.5) / 4000
    average = np.zeros(20)
    for uniform in grid:
        kept, new_w = bank.choose(log_w, most, uniform)
        assert 1 <= len(kept) <= most
        assert len(set(kept)) == len(kept)
        average[kept] += np.exp(new_w) / len(grid)
    assert average == pytest.approx(w, abs=3.0 / 4000)


@pytest.mark.parametrize('most', [3, 7, 19])
def test_what_weighs_more_than_the_threshold_is_never_lost(rng, most):
    for _ in range(50):
        log_w = np.log(rng.exponential(size=20) ** 2 + 1e-3)
        w = np.exp(log_w) / np.exp(log_w).sum()
        c = threshold(w, most)
        sure = np.flatnonzero(w > c * (1.0 + 1e-9))
        kept, new_w = bank.choose(log_w, most, rng.random())
        assert len(kept) in (most - 1, most)
        assert set(sure) <= set(kept)
        for i, log_weight in zip(kept, new_w, strict=True):
            if len(kept) == most:
                assert np.exp(log_weight) == pytest.approx(max(w[i], c), rel=1e-9)


def mixture(log_w, x, P, local):
    """Return mean and covariance of a bank as a mixture, as one local filter has it."""
    w = np.exp(log_w)
    mean = w @ x[:, local] / w.sum()
    d = x[:, local] - mean
    inside = np.einsum('i,ijk->jk', w, SHARE * P[:, local]) / w.sum()
    return w.sum(), mean, inside + (w[:, None] * d).T @ d / w.sum()


def close(P, expected, share=1e-9):
    d = np.sqrt(np.diag(expected))
    return bool(np.abs((P - expected) / np.outer(d, d)).max() < share)


def test_merging_keeps_weight_mean_and_covariance(rng):
    """Six that say the same become one, with the mixture's moments in both local filters."""
    log_w, x, P = hypotheses(rng, 6, 0.05)
    x[:, 1] += 0.01 * SIGMA
    new = bank.merge(log_w, x, P, 0.08)
    assert len(new[0]) == 1
    for local in range(2):
        weight, mean, spread = mixture(log_w, x, P, local)
        assert np.exp(new[0][0]) == pytest.approx(weight, rel=1e-12)
        assert new[1][0, local] == pytest.approx(mean, rel=1e-12)
        assert close(SHARE * new[2][0, local], spread)


@pytest.mark.parametrize(
    ('apart', 'count'),
    [
        ({B: 0.5}, 2),
        ({C: 0.5, B: 0.5}, 2),
        ({C: 0.5}, 2),
        ({K: 0.01}, 2),
        ({V: 5.0}, 1),
        ({B: 0.07, C: 0.07}, 1),
    ],
)
def test_only_those_that_say_the_same_merge(rng, apart, count):
    """Counter, radar scale and place tell accounts apart; the speed does not."""
    log_w, x, P = hypotheses(rng, 2)
    x[1] = x[0]
    for place, size in apart.items():
        x[1, :, place] += size
    new = bank.merge(log_w, x, P, 0.08)
    assert len(new[0]) == count
    assert np.exp(new[0]).sum() == pytest.approx(1.0, rel=1e-12)


def test_a_miscount_is_not_merged_away_while_the_place_is_vague(rng):
    """One crossing is nothing against 100 m of b, and three sigma of the count: it must be told."""
    log_w, x, P = hypotheses(rng, 2)
    x[1] = x[0]
    x[1, :, [C, B]] -= 0.2
    for i in range(2):
        P[i, :] = np.diag(SIGMA**2) / SHARE
        P[i, :, B, B] = 100.0**2 / SHARE
    assert len(bank.merge(log_w, x, P, 0.08)[0]) == 2


def test_federate_adds_information_and_shares_it(rng):
    _, x, P = hypotheses(rng, 3)
    x[:, 1] += SIGMA
    P[:, 1] *= 1.7
    W = np.linalg.inv(P)
    total = np.linalg.inv(W.sum(axis=1))
    mean = np.einsum('ijk,ilkm,ilm->ij', total, W, x)
    bank.federate(x, P)
    for i in range(3):
        assert x[i, 0] == pytest.approx(mean[i], rel=1e-9, abs=1e-9)
        assert close(P[i, 0] * SHARE, total[i], 1e-7)
    assert (x[:, 0] == x[:, 1]).all()
    assert (P[:, 0] == P[:, 1]).all()


def test_predict_local_moves_one_local_filter(rng):
    _, x, P = hypotheses(rng, 3)
    expected = x.copy(), P.copy()
    for i in range(3):
        line_kernels.predict(expected[0][i, 1], expected[1][i, 1], 0.3, NOISE, SHARE)
    bank.predict_local(x, P, 1, 0.3, NOISE)
    assert np.array_equal(x, expected[0])
    assert np.array_equal(P, expected[1])
    assert not np.array_equal(x[:, 0], x[:, 1])


def predicted(x, P, dt):
    """Return a dense prediction of the same model."""
    c, v, a, b, s, k = x
    travel = v * dt + a * dt * dt / 2.0
    F = np.eye(SIZE)
    F[C, [V, A, S]] = (1.0 + s) * dt, (1.0 + s) * dt * dt / 2.0, travel
    F[B, [V, A, S]] = s * dt, s * dt * dt / 2.0, travel
    F[V, A] = dt
    Q = np.zeros((SIZE, SIZE))
    G = np.array([[dt**5 / 20, dt**4 / 8, dt**3 / 6], [0, dt**3 / 3, dt**2 / 2], [0, 0, dt]])
    Q[:3, :3] = NOISE.jerk * (G + G.T - np.diag(np.diag(G)))
    Q[np.ix_([C, B], [C, B])] += NOISE.offset * abs(travel)
    Q[S, S], Q[K, K] = NOISE.slope * abs(travel), NOISE.scale * dt
    mean = np.array([c + (1.0 + s) * travel, v + a * dt, a, b + s * travel, s, k])
    return mean, F @ P @ F.T + Q


def updated(x, P, readings):
    """Return a dense update with loop and radar at once, both linearised at ``x``."""
    c, v, _, _, _, k = x
    H, R = np.zeros((2, SIZE)), np.diag([0.0036, 0.01])
    H[0, C], H[1, V], H[1, K] = 1.0, 1.0 + k, v
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    part = np.eye(SIZE) - gain @ H
    nu = readings - np.array([c, (1.0 + k) * v])
    return x + gain @ nu, part @ P @ part.T + gain @ R @ gain.T


def correct_local(x, P, local, reading):
    """Let one local filter take its own measurement."""
    H, PH, nu, R = np.zeros(SIZE), np.empty(SIZE), reading - x[C], 0.0036
    H[C] = 1.0
    if local:
        H[C], H[V], H[K] = 0.0, 1.0 + x[K], x[V]
        nu, R = reading - (1.0 + x[K]) * x[V], 0.01
    line_kernels.correct(x, P, PH, line_kernels.project(P, H, PH) + R, nu)


def test_two_locals_are_the_centralised_kalman_filter():
    """
    Over 4000 epochs and 80 km with a loop and a radar each, the same filter to 1e-9 of its sigmas.

    The last digit of 80 km is 3e-10 of the count's sigma.
    """
    rng = np.random.default_rng(5)
    sigma = np.array([1.0, 1.0, 0.5, 3.0, 1e-4, 1e-2])
    mean, spread = np.array([0.0, 20.0, 0.0, -5.0, 0.0, 0.0]), np.diag(sigma**2)
    x, P = np.tile(mean, (1, 2, 1)), np.tile(spread / SHARE, (1, 2, 1, 1))
    place, worst = 0.0, 0.0
    for epoch in range(1, 4001):
        dt = rng.uniform(0.5, 1.5)
        place += 20.0 * dt
        readings = np.array([1.0001 * place, 1.005 * 20.0]) + [0.06, 0.1] * rng.normal(size=2)
        mean, spread = updated(*predicted(mean, spread, dt), readings)
        for local in range(2):
            bank.predict_local(x, P, local, dt, NOISE)
            correct_local(x[0, local], P[0, local], local, readings[local])
        bank.federate(x, P)
        if epoch % 50 == 0:
            error = np.abs(x[0, 0] - mean) / np.sqrt(np.diag(spread))
            worst = max(worst, error.max())
            assert close(SHARE * P[0, 0], spread, 1e-9)
    assert mean[C] > 75e3
    assert worst < 1e-9


def test_begin_count_leaves_the_train_and_shares_the_reading(rng):
    """Fused, both locals know the reading to its variance."""
    _, x, P = hypotheses(rng, 2, 3.0)
    place = x[:, :, C] - x[:, :, B]
    bank.begin_count(x, P, 7000.0, 0.01)
    assert x[:, :, C] == pytest.approx(7000.0)
    assert x[:, :, C] - x[:, :, B] == pytest.approx(place, abs=1e-9)
    bank.federate(x, P)
    assert SHARE * P[:, :, C, C] == pytest.approx(0.01, rel=1e-9)


def bank_of(places, weights, sigma=0.1):
    """Return hypotheses that differ in the place only."""
    count = len(places)
    x = np.zeros((count, 2, SIZE))
    x[:, :, B], x[:, :, V] = -np.asarray(places, float)[:, None], 20.0
    P = np.tile(
        np.diag(np.array([1e-6, 0.04, 0.01, sigma**2, 1e-8, 1e-4])) / SHARE, (count, 2, 1, 1)
    )
    return np.log(np.asarray(weights, float)), x, P


def test_moments_of_one_place_are_the_mixtures(rng):
    log_w, x, P = hypotheses(rng, 5, 0.5)
    mean, spread, elsewhere = bank.moments(log_w, x, P)
    _, all_mean, all_spread = mixture(log_w, x, P, 0)
    assert mean == pytest.approx(TO_CHAINAGE @ all_mean, rel=1e-12)
    assert close(spread, TO_CHAINAGE @ all_spread @ TO_CHAINAGE.T)
    assert elsewhere == pytest.approx(0.0, abs=1e-12)


def test_moments_tell_the_likeliest_place_and_not_the_mean_of_two():
    """100 and 900 m exclude each other; the doubt is that of both, about the likelier."""
    log_w, x, P = bank_of([100.0, 900.0, 100.2], [0.4, 0.25, 0.35])
    mean, spread, elsewhere = bank.moments(log_w, x, P)
    here = (0.4 * 100.0 + 0.35 * 100.2) / 0.75
    assert mean == pytest.approx([here, 20.0, 0.0], rel=1e-12)
    assert elsewhere == pytest.approx(0.25, rel=1e-12)
    apart = 0.4 * (100.0 - here) ** 2 + 0.35 * (100.2 - here) ** 2 + 0.25 * (900.0 - here) ** 2
    assert spread[0, 0] == pytest.approx(0.1**2 + 1e-6 + apart, rel=1e-9)


@pytest.mark.parametrize(('weight', 'opens'), [(0.009, False), (0.011, True)])
def test_a_place_that_weighs_next_to_nothing_leaves_the_covariance(weight, opens):
    log_w, x, P = bank_of([100.0, 900.0], [1.0 - weight, weight])
    _, spread, elsewhere = bank.moments(log_w, x, P)
    assert elsewhere == pytest.approx(weight, rel=1e-9)
    assert (np.sqrt(spread[0, 0]) > 50.0) == opens

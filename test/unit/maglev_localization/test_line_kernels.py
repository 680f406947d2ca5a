"""One hypothesis' kernels against textbook matrices: expm, finite differences, exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from maglev_localization import line_kernels
from maglev_localization.line_kernels import SIZE, A, B, C, K, Noise, S, V

STILL = Noise(0.0, 0.0, 0.0, 0.0)
NOISE = Noise(0.1, 1e-8, 1e-12, 9e-8)
POSITION = np.eye(SIZE)[C] - np.eye(SIZE)[B]


def covariance(rng, sigma):
    """Return a correlated covariance (6, 6) of these standard deviations (6,)."""
    W = rng.normal(size=(SIZE, 2 * SIZE))
    R = W @ W.T
    d = np.sqrt(np.diag(R))
    return R / np.outer(d, d) * np.outer(sigma, sigma)


def state(rng):
    """Return a plausible mean and covariance of a train under way, its place unknown."""
    x = np.array([1234.5, 27.0, -0.8, -5000.0, 2e-4, 4e-3])
    sigma = np.array([0.05, 0.2, 0.3, 3000.0, 1e-4, 1e-2])
    return x + 0.1 * sigma * rng.normal(size=SIZE), covariance(rng, sigma)


def moved(x, dt):
    """Return the mean after ``dt``: while s is constant the motion is linear, so expm solves it."""
    c, v, a, b, s, k = x
    rates = np.array(
        [[0.0, 1.0 + s, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0] * 4, [0.0, s, 0.0, 0.0]]
    )
    c, v, a, b = expm(rates * dt) @ np.array([c, v, a, b])
    return np.array([c, v, a, b, s, k])


def by_differences(x, dt):
    """Return the transition (6, 6) by central differences, steps a share of each state's size."""
    F = np.empty((SIZE, SIZE))
    for j in range(SIZE):
        step = np.zeros(SIZE)
        step[j] = 1e-3 * max(abs(x[j]), 1e-3)
        F[:, j] = (moved(x + step, dt) - moved(x - step, dt)) / (2.0 * step[j])
    return F


def jerk_noise(dt, density):
    """Return Q (3, 3) of c, v, a by Van Loan's method."""
    A3 = np.diag([1.0, 1.0], k=1)
    M = np.zeros((6, 6))
    M[:3, :3], M[2, 5], M[3:, 3:] = -A3, density, A3.T
    E = expm(M * dt)
    return E[3:, 3:].T @ E[:3, 3:]


def predicted(x, P, dt, noise, share=1.0):
    """Return what ``predict`` makes of copies."""
    x, P = x.copy(), P.copy()
    line_kernels.predict(x, P, dt, noise, share)
    return x, P


def joseph(x, P, H, z, R):
    """Return a Kalman update in Joseph's form, of a linear scalar measurement."""
    gain = P @ H / (H @ P @ H + R)
    part = np.eye(SIZE) - np.outer(gain, H)
    return x + gain * (z - H @ x), part @ P @ part.T + R * np.outer(gain, gain)


def close(P, expected, share=1e-9):
    """Whether covariances agree to a share of their sigmas' product."""
    d = np.sqrt(np.diag(expected))
    return np.abs((P - expected) / np.outer(d, d)).max() < share


@pytest.mark.parametrize('dt', [0.001, 0.02, 1.0, 100.0])
def test_mean_and_covariance_move_by_the_transition(rng, dt):
    """Differences of a quadratic are exact but for rounding: 1e-7 of the sigmas."""
    x, P = state(rng)
    new_x, new_P = predicted(x, P, dt, STILL)
    F = by_differences(x, dt)
    assert new_x == pytest.approx(moved(x, dt), rel=1e-12)
    assert close(new_P, F @ P @ F.T, 1e-7)


@pytest.mark.parametrize('share', [1.0, 0.5])
@pytest.mark.parametrize('dt', [0.02, 0.7, 30.0])
def test_process_noise_is_van_loans(dt, share):
    """From a state known exactly, what is left is Q / share: jerk, and walks by metre or second."""
    x = np.array([10.0, -20.0, 0.1, 3.0, 0.0, 0.0])
    _, P = predicted(x, np.zeros((SIZE, SIZE)), dt, NOISE, share)
    travel = abs(-20.0 * dt + 0.05 * dt * dt)
    expected = np.zeros((SIZE, SIZE))
    expected[:3, :3] = jerk_noise(dt, NOISE.jerk)
    expected[np.ix_([C, B], [C, B])] += NOISE.offset * travel
    expected[S, S], expected[K, K] = NOISE.slope * travel, NOISE.scale * dt
    assert pytest.approx(expected / share, rel=1e-9, abs=1e-18) == P


def test_two_steps_are_one(rng):
    """The chainage's and the count's doubt do not depend on how often a filter is asked."""
    x, P = state(rng)
    P[S] = P[:, S] = 0.0
    once = predicted(x, P, 0.06, NOISE)
    twice = predicted(*predicted(x, P, 0.02, NOISE), 0.04, NOISE)
    assert twice[0] == pytest.approx(once[0], rel=1e-12)
    assert close(twice[1][:4, :4], once[1][:4, :4], 1e-6)


@pytest.mark.parametrize('dt', [0.0, -0.5])
def test_nothing_moves_back(rng, dt):
    x, P = state(rng)
    new_x, new_P = predicted(x, P, dt, NOISE)
    assert (new_x == x).all()
    assert (new_P == P).all()


def test_project_is_the_innovations_spread(rng):
    _, P = state(rng)
    H, PH = rng.normal(size=SIZE), np.empty(SIZE)
    assert line_kernels.project(P, H, PH) == pytest.approx(H @ P @ H, rel=1e-12)
    assert pytest.approx(P @ H, rel=1e-12) == PH


@pytest.mark.parametrize('H', [np.eye(SIZE)[C], np.eye(SIZE)[V] + 20.0 * np.eye(SIZE)[K]])
def test_correct_is_a_kalman_update(rng, H):
    x, P = state(rng)
    expected = joseph(x, P, H, H @ x + 0.3, 0.01)
    PH = np.empty(SIZE)
    spread = line_kernels.project(P, H, PH)
    line_kernels.correct(x, P, PH, spread + 0.01, 0.3)
    assert x == pytest.approx(expected[0], rel=1e-9)
    assert close(P, expected[1])
    assert (P == P.T).all()


def test_correct_fully_is_a_kalman_update(rng):
    x, P = state(rng)
    expected = joseph(x, P, POSITION, POSITION @ x + 200.0, 0.01)
    line_kernels.correct_fully(x, P, POSITION, 0.01, 200.0)
    assert x == pytest.approx(expected[0], rel=1e-9)
    assert close(P, expected[1])
    assert (P == P.T).all()


@pytest.mark.parametrize('line_m', [7e3, 1e5, 1e6])
def test_a_balise_after_an_unknown_start_keeps_the_covariance_positive(line_m):
    """A millimetre against the whole line: 24 digits of variance, of which doubles hold 16."""
    sigma = np.array([1e-3, 0.1, 0.1, line_m, 1e-4, 1e-2])
    x, P = np.zeros(SIZE), np.diag(sigma**2)
    line_kernels.correct_fully(x, P, POSITION, 1e-6, 0.4 * line_m)
    assert POSITION @ x == pytest.approx(0.4 * line_m, abs=1e-9 * line_m)
    assert pytest.approx(1e-6, rel=1e-3) == POSITION @ P @ POSITION
    assert positive(P)


def positive(P):
    """Whether a covariance is positive definite, whatever its units."""
    d = np.sqrt(np.diag(P))
    return bool((np.diag(P) > 0.0).all() and np.linalg.eigvalsh(P / np.outer(d, d))[0] > 0.0)


def test_a_jump_moves_the_count_and_not_the_train(rng):
    x, _ = state(rng)
    place = POSITION @ x
    before = x.copy()
    line_kernels.jump(x, 3.4)
    assert x[C] == before[C] + 3.4
    assert POSITION @ x == pytest.approx(place, abs=1e-9)
    assert (x[[V, A, S, K]] == before[[V, A, S, K]]).all()


def test_recount_is_the_limit_of_a_jump_of_any_size(rng):
    """As if the jump's variance were endless, then the reading taken: 1e-6 of it is left here."""
    x, P = state(rng)
    P[B] *= 1e-3
    P[:, B] *= 1e-3
    x[B], endless = -5.0, 1e6
    jumped = P.copy()
    jumped[np.ix_([C, B], [C, B])] += endless
    expected = joseph(x, jumped, np.eye(SIZE)[C], 88.0, 0.01)
    line_kernels.recount(x, P, 88.0, 0.01)
    assert x == pytest.approx(expected[0], rel=1e-3, abs=1e-3)
    assert close(P, expected[1], 1e-3)
    assert positive(P)


def test_recount_leaves_train_and_speed_alone(rng):
    x, P = state(rng)
    T = np.array([POSITION, *np.eye(SIZE)[[V, A, S, K]]])
    mean, spread = T @ x, T @ P @ T.T
    line_kernels.recount(x, P, 9e6, 0.01)
    assert x[C] == 9e6
    assert T @ x == pytest.approx(mean, rel=1e-12, abs=1e-8)
    assert close(T @ P @ T.T, spread)
    assert P[C] == pytest.approx([0.01, 0.0, 0.0, 0.01, 0.0, 0.0])


def test_relocate_is_the_limit_of_a_place_unknown(rng):
    """As if the train had been anywhere, then the balise heard."""
    x, P = state(rng)
    P[B] *= 1e-3
    P[:, B] *= 1e-3
    anywhere = P.copy()
    anywhere[B, B] += 1e6
    expected = joseph(x, anywhere, POSITION, 3000.0, 0.01)
    line_kernels.relocate(x, P, 3000.0, 0.01)
    assert x[[C, V, A, B]] == pytest.approx(expected[0][[C, V, A, B]], rel=1e-3, abs=0.5)
    assert close(P, expected[1], 1e-3)
    assert POSITION @ x == pytest.approx(3000.0, abs=1e-9)
    assert positive(P)


def inverse(M):
    """Return the inverse of a matrix of fractions, by Gauss and Jordan; nothing is rounded."""
    n = len(M)
    rows = [[*row, *(Fraction(int(i == j)) for j in range(n))] for i, row in enumerate(M)]
    for i in range(n):
        swap = next(r for r in range(i, n) if rows[r][i])
        rows[i], rows[swap] = rows[swap], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for r in range(n):
            if r != i:
                rows[r] = [a - rows[r][i] * b for a, b in zip(rows[r], rows[i], strict=True)]
    return [row[n:] for row in rows]


def fused_exactly(x, P):
    """Return mean and covariance by adding information, in fractions of integers."""
    W = [inverse([[Fraction(float(value)) for value in row] for row in one]) for one in P]
    total = inverse([[a + b for a, b in zip(*rows, strict=True)] for rows in zip(*W, strict=True)])
    told = [
        sum(W[k][i][j] * Fraction(float(x[k, j])) for k in range(2) for j in range(SIZE))
        for i in range(SIZE)
    ]
    mean = [float(sum(t * y for t, y in zip(row, told, strict=True))) for row in total]
    return np.array(mean), np.array([[float(value) for value in row] for row in total])


def two_locals(rng, offset_sigma, count_sigma=0.05):
    """Return two local estimates of a train, apart by about their sigmas."""
    sigma = np.array([count_sigma, 0.2, 0.3, offset_sigma, 1e-4, 1e-2])
    P = np.stack([covariance(rng, sigma * scale) for scale in (1.0, 1.7)])
    x = np.array([800.0, 27.0, 0.1, -3.0, 0.0, 0.0]) + sigma * rng.normal(size=(2, SIZE))
    return x, P


@pytest.mark.parametrize(
    ('offset_sigma', 'count_sigma'), [(0.05, 0.05), (3162.0, 0.03), (1e5, 1e-3), (0.05, 500.0)]
)
def test_fusion_adds_information(rng, offset_sigma, count_sigma):
    """
    Against exact fractions, also where b is unknown to 1e7 m^2 and c known to 1e-3.

    What doubles can hold of P1 + P2 limits it: correlations of 0.9 cost little, so 1e-9.
    """
    x, P = two_locals(rng, offset_sigma, count_sigma)
    mean, covariance_ = fused_exactly(x, P)
    assert line_kernels.fuse(x, P, np.empty((SIZE, 13)))
    d = np.sqrt(np.diag(covariance_))
    assert np.abs((x[0] - mean) / d).max() < 1e-7
    assert close(P[0], covariance_)
    assert positive(P[0])


def test_fusion_where_count_and_offset_are_one(rng):
    """A count lost for a minute: c and b vague together, the place between them known to 5 cm."""
    x, P = two_locals(rng, 0.05)
    P[:, C, C] += 1e6
    P[:, B, B] += 1e6
    P[:, C, B] += 1e6
    P[:, B, C] += 1e6
    mean, covariance_ = fused_exactly(x, P)
    assert line_kernels.fuse(x, P, np.empty((SIZE, 13)))
    T = np.array([POSITION, *np.eye(SIZE)[[V, A, S, K]]])
    d = np.sqrt(np.diag(T @ covariance_ @ T.T))
    assert np.abs(T @ (x[0] - mean) / d).max() < 1e-5
    assert close(T @ P[0] @ T.T, T @ covariance_ @ T.T, 1e-5)


@pytest.mark.parametrize('wrong', [-1.0, 0.0, np.nan])
def test_fusion_of_what_is_no_covariance_leaves_it(rng, wrong):
    x, P = two_locals(rng, 0.05)
    P[:, V, V] = wrong
    before = x.copy(), P.copy()
    assert not line_kernels.fuse(x, P, np.empty((SIZE, 13)))
    assert np.array_equal(x, before[0])
    assert np.array_equal(P, before[1], equal_nan=True)

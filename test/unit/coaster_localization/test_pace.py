"""Evening out a match by the train's pace."""

import numpy as np

from coaster_localization.pace import even_pace


def test_result_is_the_least_squares_solution():
    """All states at once by dense least squares, exact transitions replaced by 1e-7."""
    rng = np.random.default_rng(0)
    n, dt = 120, 0.1
    sigma, walk, delay = rng.uniform(0.1, 2, n), rng.uniform(0.1, 1, n), rng.normal(size=n)
    rows, right = [], []

    def add(columns, values, value, weight):
        row = np.zeros(2 * n)
        row[columns] = values
        rows.append(row / weight)
        right.append(value / weight)

    add([1], [1.0], 0.0, 0.3)
    for k in range(n):
        add([2 * k], [1.0], delay[k], sigma[k])
        if k:
            add([2 * k, 2 * k - 2, 2 * k - 1], [1.0, -1.0, -dt], 0.0, 1e-7)
            add([2 * k + 1, 2 * k - 1], [1.0, -1.0], 0.0, walk[k] * np.sqrt(dt))
    A = np.array(rows)
    expected = np.linalg.lstsq(A, np.array(right), rcond=None)[0][::2]
    inverse = np.linalg.inv(np.linalg.qr(A)[1])
    deviation = np.sqrt(np.diag(inverse @ inverse.T)[::2])
    smooth, sigma_out = even_pace(delay, sigma, walk, dt, np.full(n, dt))
    np.testing.assert_allclose(smooth, expected, atol=1e-6)
    np.testing.assert_allclose(sigma_out, deviation, rtol=1e-6)


def test_a_jump_in_doubt_becomes_a_ramp():
    """Sure at both ends, not between: the delay grows along the way, not at once as the match."""
    n, dt = 2000, 0.02
    delay = np.where(np.arange(n) < 1200, 0.0, 2.0)
    sure = (np.arange(n) < 400) | (np.arange(n) >= 1600)
    sigma = np.where(sure, 0.02, 5.0)
    smooth, sigma_out = even_pace(delay, sigma, np.full(n, 0.02), dt, np.full(n, 1.0))
    middle = slice(550, 1450)
    steps = np.diff(smooth[middle])
    assert steps.min() > 0.5 * steps.mean()
    assert steps.max() < 2.0 * steps.mean()
    assert abs(smooth[1000] - 1.0) < 0.1
    assert sigma_out[1000] > 3.0 * sigma_out[200]


def test_lasting_errors_weigh_less():
    rng = np.random.default_rng(2)
    n = 500
    delay, sigma, walk = rng.normal(size=n), np.ones(n), np.full(n, 0.1)
    brief = even_pace(delay, sigma, walk, 0.02, np.full(n, 0.02))[1]
    lasting = even_pace(delay, sigma, walk, 0.02, np.full(n, 2.0))[1]
    assert (lasting > 2.0 * brief).all()


def test_huge_doubt_stays_finite():
    n = 9000
    sigma = np.where(np.arange(n) % 4000 < 100, 1e-3, 1e3)
    smooth, sigma_out = even_pace(
        np.sin(np.arange(n) / 500.0), sigma, np.full(n, 0.01), 0.02, 1.0 + 30.0 * sigma
    )
    assert np.isfinite(smooth).all()
    assert (sigma_out > 0.0).all()


def test_one_sample_is_left_alone():
    smooth, sigma = even_pace(np.array([1.5]), np.array([0.1]), np.ones(1), 0.02, np.full(1, 0.02))
    assert smooth.tolist() == [1.5]
    assert sigma.tolist() == [0.1]

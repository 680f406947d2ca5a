"""Scalar updates against the dense Joseph form; weights, fading and the gate by their formulas."""

import numpy as np
import pytest
from scipy.stats import chi2

from track_localization.estimation import sequential


def covariance(rng, n, scales=None):
    A = rng.normal(size=(n, n))
    P = A @ A.T / n + 0.1 * np.eye(n)
    if scales is not None:
        P *= np.outer(scales, scales)
    return 0.5 * (P + P.T)


def joseph(P, H, R, nu):
    """Return the correction and covariance of all numbers at once."""
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    A = np.eye(len(P)) - K @ H
    return K @ nu, A @ P @ A.T + K @ R @ K.T


@pytest.mark.parametrize('n', [1, 4, 15, 21])
@pytest.mark.parametrize('m', [1, 3])
def test_one_by_one_is_all_at_once(n, m, rng):
    P, H = covariance(rng, n), rng.normal(size=(m, n))
    H[rng.random((m, n)) < 0.3] = 0.0
    variances, nu, dx = rng.uniform(0.1, 2.0, m), rng.normal(size=m), np.zeros(n)
    expected_dx, expected_P = joseph(P, H, np.diag(variances), nu)
    for h, R, z in zip(H, variances, nu, strict=True):
        expected_S = h @ P @ h + R
        assert sequential.update(P, h, R, z, dx) == pytest.approx(expected_S, rel=1e-12)
    np.testing.assert_allclose(dx, expected_dx, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(P, expected_P, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(P, P.T)


def test_correlated_numbers_after_whitening(rng):
    """A fix's full covariance, east with north and up."""
    n, m = 15, 3
    P, H, R = covariance(rng, n), rng.normal(size=(m, n)), covariance(rng, m)
    assert abs(R[0, 1]) > 0.01
    nu, dx = rng.normal(size=m), np.zeros(n)
    expected_dx, expected_P = joseph(P, H, R, nu)
    assert sequential.whiten(H, R, nu)
    for h, z in zip(H, nu, strict=True):
        sequential.update(P, h, 1.0, z, dx)
    np.testing.assert_allclose(dx, expected_dx, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(P, expected_P, rtol=1e-10, atol=1e-12)


def test_whitening_refuses_what_is_no_covariance(rng):
    H, nu = rng.normal(size=(2, 4)), rng.normal(size=2)
    H_before, nu_before = H.copy(), nu.copy()
    assert not sequential.whiten(H, np.array([[1.0, 2.0], [2.0, 1.0]]), nu)
    np.testing.assert_array_equal(H, H_before)
    np.testing.assert_array_equal(nu, nu_before)


def test_as_accurate_as_josephs_form(rng):
    """
    Twelve numbers that are up to 1e12 times better than what was known, against 64 binary digits.

    Joseph's form, dense, makes the error that rounding cannot avoid; ours is no more than twice it.
    """
    worst = np.zeros(2)
    for ratio in np.repeat([1e-4, 1e-8, 1e-12], 50):
        P = covariance(rng, 15)
        joseph_P, exact, h = P.copy(), P.astype(np.longdouble), rng.normal(size=15)
        for _ in range(12):
            h = h + 0.1 * rng.normal(size=15)
            sequential.update(P, h, ratio, 0.0, np.zeros(15))
            _, joseph_P = joseph(joseph_P, h[None], np.array([[ratio]]), np.zeros(1))
            Ph = exact @ h
            exact -= np.outer(Ph, Ph) / (h @ Ph + ratio)
        errors = [np.abs(found - exact).max() for found in (P, joseph_P)]
        worst = np.maximum(worst, np.array(errors, float))
    assert worst[0] < 2.0 * worst[1]


def test_units_far_apart_leave_a_covariance(rng):
    """Metres squared of 1e8 beside biases of 1e-14; a sensor of 1e-12 of what is known, often."""
    scales = np.concatenate([np.full(3, 1e4), np.full(6, 1.0), np.full(6, 1e-7)])
    P, dx = covariance(rng, 15, scales), np.zeros(15)
    for _ in range(300):
        h = rng.normal(size=15) / scales
        sequential.update(P, h, 1e-12, rng.normal(), dx)
        np.testing.assert_array_equal(P, P.T)
        assert np.linalg.eigvalsh(P / np.outer(scales, scales)).min() > -1e-16
        assert (np.diag(P) > 0.0).all()


def test_innovation_is_what_the_correction_leaves(rng):
    P, h, dx = covariance(rng, 6), rng.normal(size=6), rng.normal(size=6)
    left, variance = sequential.innovation(P, h, 0.5, 3.0, dx)
    assert left == pytest.approx(3.0 - h @ dx, rel=1e-12)
    assert variance == pytest.approx(h @ P @ h + 0.5, rel=1e-12)
    assert sequential.update(P, h, 0.5, 3.0, dx) == pytest.approx(variance, rel=1e-12)


def test_nis_is_chi_square(rng):
    """Innovations drawn as P and R say: their mean NIS over 4 000, within 99.9 %."""
    P, count, total = covariance(rng, 6), 4000, 0.0
    root = np.linalg.cholesky(P)
    for _ in range(count):
        h, x = rng.normal(size=6), root @ rng.normal(size=6)
        nu = h @ x + np.sqrt(0.4) * rng.normal()
        left, S = sequential.innovation(P, h, 0.4, nu, np.zeros(6))
        total += left * left / S
    low, high = chi2.ppf([0.0005, 0.9995], count) / count
    assert low < total / count < high


@pytest.mark.parametrize('R', [np.nan, np.inf, -100.0])
def test_a_number_without_a_variance_does_nothing(R, rng):
    P, dx = covariance(rng, 4), rng.normal(size=4)
    P_before, dx_before = P.copy(), dx.copy()
    sequential.update(P, np.array([1.0, 0.0, 0.5, 0.0]), R, 1.0, dx)
    np.testing.assert_array_equal(P, P_before)
    np.testing.assert_array_equal(dx, dx_before)


def test_a_state_known_for_certain_stays():
    P, dx = np.zeros((3, 3)), np.zeros(3)
    P[1, 1] = 4.0
    S = sequential.update(P, np.array([1.0, 1.0, 0.0]), 1.0, 5.0, dx)
    assert S == 5.0
    np.testing.assert_allclose(dx, [0.0, 4.0, 0.0])
    np.testing.assert_allclose(P, np.diag([0.0, 0.8, 0.0]), atol=1e-15)
    sequential.update(P, np.array([1.0, 0.0, 0.0]), 0.0, 5.0, dx)
    np.testing.assert_allclose(dx, [0.0, 4.0, 0.0])


def test_huber_weight_bounds_the_pull():
    """Up to the knee a number counts in full; beyond, weight times innovation stays the same."""
    assert sequential.huber_weight(0.0, 6.6) == 1.0
    assert sequential.huber_weight(6.6, 6.6) == 1.0
    for nis in (6.7, 26.4, 1e6):
        weight = sequential.huber_weight(nis, 6.6)
        assert weight * np.sqrt(nis) == pytest.approx(np.sqrt(6.6))
    assert sequential.huber_weight(26.4, 6.6) == pytest.approx(0.5)


def test_fading_makes_up_for_what_innovations_show():
    """Eq. of the paper by channel: lambda hPh' + R is the innovations' own power."""
    assert sequential.fading_factor(10.0, 4.0, 2.0) == 3.0
    assert sequential.fading_factor(10.0, 4.0, 2.0) * 2.0 + 4.0 == 10.0
    assert sequential.fading_factor(5.0, 4.0, 2.0) == 1.0
    assert sequential.fading_factor(0.0, 4.0, 2.0) == 1.0
    assert sequential.fading_factor(10.0, 4.0, 0.0) == 1.0


def test_innovation_power_forgets():
    """V_k = (0.95 V + nu^2) / 1.95: steady innovations are their own power, a spike halves."""
    power = 9.0
    for _ in range(100):
        power = sequential.innovation_power(power, 2.0)
    assert power == pytest.approx(4.0)
    assert sequential.innovation_power(4.0, 6.0) == pytest.approx((0.95 * 4.0 + 36.0) / 1.95)
    assert sequential.innovation_power(4.0, 6.0, 0.5) == pytest.approx(38.0 / 1.5)


def test_lockout_lets_the_next_in_after_a_run():
    gate = sequential.Lockout(limit=16.0, patience=3)
    assert gate.admits(16.0)
    assert [gate.admits(17.0) for _ in range(3)] == [False, False, False]
    assert gate.run == 3
    assert gate.admits(1e6)
    assert gate.run == 0
    assert not gate.admits(17.0)


def test_lockout_counts_only_an_unbroken_run():
    gate = sequential.Lockout(limit=16.0, patience=2)
    for _ in range(5):
        assert not gate.admits(20.0)
        assert gate.admits(1.0)
    assert not gate.admits(20.0)
    gate.reset()
    assert [gate.admits(20.0) for _ in range(3)] == [False, False, True]


def test_lockout_never_admits_what_is_not_finite():
    gate = sequential.Lockout(limit=16.0, patience=1)
    for nis in (np.nan, np.inf, np.nan, np.inf):
        assert not gate.admits(nis)
    assert gate.run == 0


@pytest.mark.parametrize(('limit', 'patience'), [(0.0, 3), (-1.0, 3), (np.nan, 3), (16.0, 0)])
def test_lockout_refuses_settings_that_make_no_gate(limit, patience):
    with pytest.raises(ValueError, match='Lockout'):
        sequential.Lockout(limit, patience)


def test_a_filter_gone_wrong_finds_back():
    """
    A scalar state that is off by 100 with a sigma of 1: a hard gate would refuse for good.

    With recovery it is let in, pulled halfway; what is refused meanwhile costs time only.
    """
    P, x = np.array([[1.0]]), 0.0
    gate = sequential.Lockout(limit=16.0, patience=5)
    for _ in range(200):
        nu, dx = 100.0 - x, np.zeros(1)
        left, S = sequential.innovation(P, np.ones(1), 1.0, nu, dx)
        P[0, 0] += 0.1
        if gate.admits(left * left / S):
            sequential.update(P, np.ones(1), 1.0, nu, dx)
            x += dx[0]
    assert x == pytest.approx(100.0, abs=0.1)

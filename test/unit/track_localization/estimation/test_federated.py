"""Federated filtering against a centralised Kalman filter and chi-square tables."""

import numpy as np
import pytest
from scipy.stats import chi2, ncx2

from track_localization.estimation import federated

H_LOOP, H_RADAR = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
R_LOOP, R_RADAR = 0.01, 0.02


def update(m, P, h, z, R):
    """Joseph form, scalar measurement."""
    K = P @ h / (h @ P @ h + R)
    A = np.eye(3) - np.outer(K, h)
    return m + K * (z - h @ m), A @ P @ A.T + R * np.outer(K, K)


def motion(T):
    F = np.array([[1.0, T, T * T / 2.0], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    G = np.array([T**3 / 6.0, T * T / 2.0, T])
    return F, 0.001 * np.outer(G, G)


def drive(rng, steps):
    """Yield (T, loop reading or None, radar reading or None) along a random drive."""
    x = np.array([5000.0, 20.0, 0.1])
    for _ in range(steps):
        T = rng.uniform(0.05, 1.0)
        F, Q = motion(T)
        x = F @ x + rng.multivariate_normal(np.zeros(3), Q, method='eigh')
        which = rng.integers(3)
        yield (
            T,
            x[0] + np.sqrt(R_LOOP) * rng.normal() if which != 1 else None,
            x[1] + np.sqrt(R_RADAR) * rng.normal() if which != 2 else None,
        )


@pytest.mark.parametrize('shares', ['constant', 'switching', 'random'])
def test_federated_kalman_filter_is_the_centralised_one(shares):
    """Over 3000 steps of any length with either sensor or both, to 1e-9, whatever the shares."""
    rng = np.random.default_rng(6)
    m, P = np.array([5000.0, 20.0, 0.1]), np.diag([1.0, 0.25, 0.04])
    master, P_master = m.copy(), P.copy()
    for k, (T, loop, radar) in enumerate(drive(rng, 3000)):
        F, Q = motion(T)
        m, P = F @ m, F @ P @ F.T + Q
        beta = {'constant': 0.8, 'switching': 0.8 if k // 50 % 2 else 0.5}.get(
            shares, rng.uniform(0.05, 0.95)
        )
        means, covariances = [], []
        for part, z, h, R in (
            (beta, loop, H_LOOP, R_LOOP),
            (1.0 - beta, radar, H_RADAR, R_RADAR),
        ):
            local, P_local = federated.share(master, P_master, part)
            local = F @ local
            P_local = F @ P_local @ F.T + federated.share_noise(Q, part)
            if z is not None:
                local, P_local = update(local, P_local, h, z, R)
                m, P = update(m, P, h, z, R)
            means.append(local)
            covariances.append(P_local)
        master, P_master = federated.fuse(means, covariances)
        np.testing.assert_allclose(master, m, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(P_master, P, rtol=0.0, atol=1e-9)


def test_fusing_three_locals_is_the_sum_of_their_information(rng):
    means = rng.normal(size=(3, 4)) + 1e5
    roots = rng.normal(size=(3, 4, 4)) + 2.0 * np.eye(4)
    covariances = roots @ np.swapaxes(roots, 1, 2)
    information = np.linalg.inv(covariances)
    P = np.linalg.inv(information.sum(axis=0))
    mean = P @ np.einsum('kij,kj->i', information, means)
    fused, P_fused = federated.fuse(means, covariances)
    np.testing.assert_allclose(fused, mean, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(P_fused, P, rtol=1e-9)


def test_fusing_holds_its_digits_where_units_differ():
    """Kilometres beside microradians: variances 20 decades apart, exactly known by symmetry."""
    scale = np.array([1e5, 1e-5])
    P = np.outer(scale, scale) * np.array([[1.0, 0.5], [0.5, 1.0]])
    means = np.array([[7e6, 1e-3], [7e6 + 2e5, 3e-3]])
    fused, P_fused = federated.fuse(means, [P, P])
    np.testing.assert_allclose(fused, means.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(P_fused, 0.5 * P, rtol=1e-13)


@pytest.mark.parametrize('P', [np.zeros((2, 2)), np.diag([1.0, -1.0]), np.ones((2, 2))])
def test_a_covariance_that_is_none(P):
    with pytest.raises(ValueError, match='positive definite'):
        federated.fuse(np.zeros((2, 2)), [np.eye(2), P])


@pytest.mark.parametrize('beta', [0.0, -0.2, 1.1, np.nan])
def test_a_share_that_is_none(beta):
    with pytest.raises(ValueError, match='share'):
        federated.share(np.zeros(2), np.eye(2), beta)
    with pytest.raises(ValueError, match='share'):
        federated.share_noise(np.eye(2), beta)


def locals_of(rng, count):
    """Return covariances (count, 3, 3) of different shapes."""
    roots = rng.normal(size=(count, 3, 3)) + 2.0 * np.eye(3)
    return roots @ np.swapaxes(roots, 1, 2)


def estimates(rng, covariances):
    return np.stack([np.linalg.cholesky(P) @ rng.standard_normal(3) for P in covariances])


@pytest.mark.parametrize('count', [2, 3, 5])
def test_sound_locals_raise_no_more_alarms_than_stated(count):
    """At 2 % over 4000 trials the share of alarms is at most 2 % plus 3 sigma of the binomial."""
    rng, trials, rate = np.random.default_rng(21), 4000, 0.02
    covariances = locals_of(rng, count)
    alarms = 0
    for _ in range(trials):
        verdict = federated.isolate(estimates(rng, covariances), covariances, rate)
        alarms += verdict.faulty is not None or verdict.ambiguous
    assert alarms <= trials * rate + 3.0 * np.sqrt(trials * rate)
    # And not far fewer: the tests overlap, but most of the rate is used.
    assert alarms >= 0.5 * trials * rate


@pytest.mark.parametrize('strength', [5.0, 15.0, 40.0])
def test_a_biased_local_is_found_with_the_probability_stated(strength):
    """
    The distance of the biased local exceeds the gate as often as the non-central chi-square says.

    ``strength`` is the bias' squared Mahalanobis length. 3000 trials know a share to 2.7 % (3
    sigma). Where it is found almost always, it is also the one that is blamed.
    """
    rng, trials, rate = np.random.default_rng(22), 3000, 1e-3
    covariances = locals_of(rng, 3)
    others = np.linalg.inv(np.linalg.inv(covariances[1]) + np.linalg.inv(covariances[2]))
    direction = np.array([1.0, 0.3, -0.5])
    S = covariances[0] + others
    bias = direction * np.sqrt(strength / (direction @ np.linalg.solve(S, direction)))
    gate = chi2.isf(rate / 3.0, 3)
    stated = federated.detection_probability(bias, covariances[0], others, gate)
    assert stated == pytest.approx(ncx2.sf(gate, 3, strength), rel=1e-9)
    found = blamed = 0
    for _ in range(trials):
        means = estimates(rng, covariances)
        means[0] += bias
        verdict = federated.isolate(means, covariances, rate)
        assert verdict.gate == pytest.approx(gate)
        found += verdict.distance[0] > gate
        blamed += verdict.faulty == 0
    assert found / trials == pytest.approx(stated, abs=3.0 * np.sqrt(0.25 / trials))
    if stated > 0.95:
        assert blamed / trials > 0.9


def test_two_estimates_disagree_and_no_third_can_tell():
    verdict = federated.isolate(np.array([[0.0], [9.0]]), np.ones((2, 1, 1)))
    assert verdict.ambiguous
    assert verdict.faulty is None
    # The master's prediction as a third one tells.
    verdict = federated.isolate(np.array([[0.0], [9.0], [0.2]]), np.ones((3, 1, 1)))
    assert verdict.faulty == 1
    assert not verdict.ambiguous


def test_disagreement_is_the_mahalanobis_distance():
    d = federated.disagreement(np.array([3.0, 1.0]), np.diag([2.0, 3.0]), np.zeros(2), np.eye(2))
    assert d == pytest.approx(9.0 / 3.0 + 1.0 / 4.0)


def test_one_estimate_alone_cannot_be_compared():
    with pytest.raises(ValueError, match='two estimates'):
        federated.isolate(np.zeros((1, 2)), np.eye(2)[None])


def test_shares_are_conserved_when_one_is_isolated():
    np.testing.assert_allclose(
        federated.redistribute([0.5, 0.3, 0.2], [0]), [0.0, 0.6, 0.4], rtol=1e-15
    )
    np.testing.assert_allclose(federated.redistribute([0.8, 0.2], []), [0.8, 0.2])
    with pytest.raises(ValueError, match='left'):
        federated.redistribute([0.8, 0.2], [0, 1])

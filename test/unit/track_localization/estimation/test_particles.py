"""Particle steps against closed forms: expected counts, N_eff, Kalman posteriors."""

import numpy as np
import pytest
from scipy.stats import kstest, norm

from track_localization.estimation import particles

SCHEMES = sorted(particles.RESAMPLING)


def random_weights(rng, count):
    w = rng.exponential(size=count) ** 2
    return w / w.sum()


def test_normals_are_the_generators_own():
    """Taken in any portions they are one stream, of mean 0 and variance 1, and repeatable."""
    portions = [5, 20000, 3, 9000, 40000]
    taken = particles.Normals(np.random.default_rng(2))
    ours = [taken.take(n).copy() for n in portions]
    again = particles.Normals(np.random.default_rng(2))
    np.testing.assert_array_equal(ours[0], again.take(5))
    drawn = np.concatenate(ours)
    assert len(np.unique(drawn)) == sum(portions)
    assert kstest(drawn, 'norm').pvalue > 1e-3
    assert abs(drawn[1:] @ drawn[:-1]) / len(drawn) < 4.0 / np.sqrt(len(drawn))


def test_reweight_is_bayes_rule(rng):
    prior, likelihood = random_weights(rng, 7), rng.uniform(0.1, 2.0, 7)
    posterior = particles.reweight(np.log(prior), np.log(likelihood))
    np.testing.assert_allclose(
        np.exp(posterior), prior * likelihood / (prior @ likelihood), rtol=1e-13
    )


def test_reweight_keeps_weights_that_would_underflow():
    """Likelihoods of e^-3000 and e^-3001 have the ratio e, though both are zero as numbers."""
    posterior = particles.reweight(particles.equal_weights(2), np.array([-3000.0, -3001.0]))
    assert posterior[0] - posterior[1] == pytest.approx(1.0, abs=1e-9)
    assert np.exp(posterior).sum() == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize('likelihood', [[-np.inf, -np.inf], [np.nan, 0.0], [np.inf, 0.0]])
def test_no_particle_explains_the_measurement(likelihood):
    with pytest.raises(ValueError, match='no likelihood'):
        particles.reweight(particles.equal_weights(2), np.array(likelihood))


def test_effective_sample_size_between_its_limits():
    """N for equal weights, 1 for a single one, k for k equal ones among N."""
    assert particles.effective_sample_size(particles.equal_weights(40)) == pytest.approx(40.0)
    one = np.full(40, -np.inf)
    one[3] = 0.0
    assert particles.effective_sample_size(one) == pytest.approx(1.0)
    eight = np.full(40, -np.inf)
    eight[:8] = -np.log(8.0)
    assert particles.effective_sample_size(eight) == pytest.approx(8.0)


@pytest.mark.parametrize('scheme', SCHEMES)
@pytest.mark.parametrize('count', [5, 50, 500])
def test_resampling_is_unbiased(scheme, count):
    """
    Particle i is drawn count * w[i] times on average.

    The mean over 4000 draws has a standard error of at most sqrt(count w (1 - w) / 4000), the
    multinomial one, which no other scheme exceeds; five of them for 50 particles by four schemes.
    """
    rng = np.random.default_rng(11)
    w, runs = random_weights(rng, 50), 4000
    draws = np.zeros(50)
    for _ in range(runs):
        indices = particles.RESAMPLING[scheme](w, rng, count)
        assert len(indices) == count
        draws += np.bincount(indices, minlength=50)
    error = np.sqrt(count * w * (1.0 - w) / runs)
    np.testing.assert_array_less(np.abs(draws / runs - count * w), 5.0 * error)


@pytest.mark.parametrize('scheme', SCHEMES)
def test_variance_of_the_counts(scheme):
    """Counts vary as theory says: multinomially, less, or by less than one about count * w."""
    rng = np.random.default_rng(12)
    w, runs = random_weights(rng, 50), 4000
    counts = np.array(
        [np.bincount(particles.RESAMPLING[scheme](w, rng), minlength=50) for _ in range(runs)]
    )
    variance, multinomial = counts.var(axis=0), 50 * w * (1.0 - w)
    if scheme == 'multinomial':
        # A sample variance of 4000 counts is off by 2.2 % (1 sigma), more where few are drawn.
        often = multinomial > 0.2
        np.testing.assert_allclose(variance[often], multinomial[often], rtol=0.15)
    else:
        assert variance.sum() < 0.6 * multinomial.sum()
    if scheme == 'systematic':
        assert np.abs(counts - 50 * w).max() < 1.0
    if scheme == 'stratified':
        assert np.abs(counts - 50 * w).max() < 2.0
    if scheme == 'residual':
        assert (counts - np.floor(50 * w)).min() >= 0.0


@pytest.mark.parametrize('scheme', SCHEMES)
def test_particles_without_weight_are_never_drawn(scheme, rng):
    w = np.zeros(30)
    w[[0, 4, 17]] = [0.2, 0.5, 0.3]
    for _ in range(200):
        assert set(particles.RESAMPLING[scheme](w, rng)) <= {0, 4, 17}


@pytest.mark.parametrize('scheme', SCHEMES)
@pytest.mark.parametrize('excess', [-5e-7, 5e-7])
def test_weights_that_miss_one_by_rounding(scheme, excess, rng):
    """A sum short of one leaves no place to nobody, one beyond does not draw too many."""
    w = np.array([0.25, 0.75 + excess, 0.0])
    for _ in range(50):
        indices = particles.RESAMPLING[scheme](w, rng, 40)
        assert len(indices) == 40
        assert set(indices) <= {0, 1}


@pytest.mark.parametrize('scheme', SCHEMES)
def test_all_weight_on_one_particle(scheme, rng):
    for at in (0, 11, 29):
        w = np.zeros(30)
        w[at] = 1.0
        np.testing.assert_array_equal(particles.RESAMPLING[scheme](w, rng), np.full(30, at))


@pytest.mark.parametrize('scheme', SCHEMES)
@pytest.mark.parametrize('w', [[0.0, 0.0], [np.nan, 0.5], [0.3, 0.3], [np.inf, 0.5], [2, -1]])
def test_weights_that_are_none(scheme, w, rng):
    with pytest.raises(ValueError, match='weights'):
        particles.RESAMPLING[scheme](np.array(w, float), rng)


@pytest.mark.parametrize('scheme', SCHEMES)
def test_same_seed_same_bits(scheme):
    w = random_weights(np.random.default_rng(3), 100)
    one, two = (particles.RESAMPLING[scheme](w, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_roughening_as_gordon_gives_it():
    """Jitter of sigma = K E N^(-1/D), E each state's range; 8000 samples know it to 0.8 %."""
    rng = np.random.default_rng(5)
    cloud = rng.uniform([0.0, -5.0, 0.0], [1.0, 5.0, 100.0], (8000, 3))
    jitter = particles.roughen(cloud, rng, 0.1) - cloud
    np.testing.assert_allclose(jitter.std(axis=0), 0.1 * np.ptp(cloud, axis=0) / 20.0, rtol=0.04)
    assert np.abs(np.corrcoef(jitter.T) - np.eye(3)).max() < 5.0 / np.sqrt(8000)


def test_moments_are_numpys(rng):
    cloud, w = rng.normal(size=(200, 3)) @ rng.normal(size=(3, 3)) + 1e4, random_weights(rng, 200)
    mean, P = particles.moments(cloud, w)
    np.testing.assert_allclose(mean, np.average(cloud, axis=0, weights=w), rtol=1e-13)
    np.testing.assert_allclose(P, np.cov(cloud.T, aweights=w, ddof=0), rtol=1e-8)


def test_affine_map_gives_the_moments_asked_for(rng):
    cloud, w = rng.normal(size=(300, 3)), random_weights(rng, 300)
    A = rng.normal(size=(3, 3))
    wanted, P_wanted = np.array([7000.0, 120.0, 1.0]), A @ A.T
    moved = particles.affine_map(cloud, w, wanted, P_wanted)
    np.testing.assert_allclose(np.average(moved, axis=0, weights=w), wanted, rtol=1e-12)
    np.testing.assert_allclose(np.cov(moved.T, aweights=w, ddof=0), P_wanted, rtol=1e-9)
    # It is affine: what lies in the middle of two particles stays there.
    half = particles.affine_map(
        np.vstack([cloud, 0.5 * (cloud[0] + cloud[1])]), np.append(w, 0.0), wanted, P_wanted
    )
    np.testing.assert_allclose(half[-1], 0.5 * (half[0] + half[1]), rtol=1e-9)


def test_affine_map_of_a_cloud_without_extent(rng):
    with pytest.raises(ValueError, match='positive definite'):
        particles.affine_map(np.ones((50, 2)), np.full(50, 0.02), np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match='positive definite'):
        particles.affine_map(
            rng.normal(size=(50, 2)), np.full(50, 0.02), np.zeros(2), np.diag([1.0, -1.0])
        )


def scalar_posterior(prior_sigma, sigma, z):
    """Kalman posterior of x ~ N(0, prior^2) measured as ``z``, each with ``sigma``."""
    information = prior_sigma**-2 + len(z) * sigma**-2
    return np.sum(z) * sigma**-2 / information, 1.0 / information


@pytest.mark.parametrize('count', [300, 3000, 30000])
def test_weights_reach_the_posterior_of_a_static_model(count):
    """
    The weighted mean of prior draws is the Kalman posterior's mean, to Monte Carlo error.

    That error is sqrt(sum w^2 (x - m)^2), known from the weights: 100 seeds, divided by it, are
    standard normal. Their mean square then lies in 1 +- 5 sqrt(2/100), their mean in +- 0.5.
    """
    z = np.array([0.7, 1.1, 0.4])
    exact, _ = scalar_posterior(2.0, 1.0, z)
    scores = []
    for seed in range(100):
        x = 2.0 * np.random.default_rng(seed).standard_normal(count)
        log_w = particles.equal_weights(count)
        for one in z:
            log_w = particles.reweight(log_w, norm.logpdf(one, x, 1.0))
        w = np.exp(log_w)
        mean, _ = particles.moments(x[:, None], w)
        scores.append((mean[0] - exact) / np.sqrt(np.sum((w * (x - mean[0])) ** 2)))
    assert np.mean(scores) == pytest.approx(0.0, abs=0.5)
    assert np.mean(np.square(scores)) == pytest.approx(1.0, abs=0.71)


def kalman(z, F, Q, h, R, m, P):
    """Textbook filter of scalar measurements, written here."""
    for one in z:
        m, P = F @ m, F @ P @ F.T + Q
        S = h @ P @ h + R
        K = P @ h / S
        m, P = m + K * (one - h @ m), P - np.outer(K, h @ P)
    return m, P


def bootstrap(z, F, root_Q, R, m, root_P, count, scheme, rng):
    x = m + rng.standard_normal((count, 2)) @ root_P.T
    log_w = particles.equal_weights(count)
    for one in z:
        x = x @ F.T + rng.standard_normal((count, 2)) @ root_Q.T
        log_w = particles.reweight(log_w, norm.logpdf(one, x[:, 0], np.sqrt(R)))
        if particles.effective_sample_size(log_w) < 0.5 * count:
            x = x[particles.RESAMPLING[scheme](np.exp(log_w), rng)]
            log_w = particles.equal_weights(count)
    return particles.moments(x, np.exp(log_w))


@pytest.mark.parametrize('scheme', SCHEMES)
def test_bootstrap_filter_reaches_the_kalman_posterior(scheme):
    """
    Position and speed over 20 measurements: the error against Kalman's falls as 1/sqrt(N).

    Over 30 seeds its rms at N is at most 3 sigma/sqrt(N), sigma the posterior's: twenty steps that
    forget fast leave it near 2. From N = 250 to 16 N it falls to a quarter, +-40 % by chance.
    """
    F, R = np.array([[1.0, 1.0], [0.0, 1.0]]), 0.5
    root_Q = np.linalg.cholesky(np.array([[0.1, 0.1], [0.1, 0.2]]))
    m, root_P = np.array([0.0, 1.0]), np.eye(2)
    rng = np.random.default_rng(8)
    x, z = m + rng.standard_normal(2), []
    for _ in range(20):
        x = F @ x + root_Q @ rng.standard_normal(2)
        z.append(x[0] + np.sqrt(R) * rng.standard_normal())
    exact, P = kalman(z, F, root_Q @ root_Q.T, np.array([1.0, 0.0]), R, m, root_P)
    sigma, rms = np.sqrt(np.diag(P)), {}
    for count in (250, 4000):
        runs = [bootstrap(z, F, root_Q, R, m, root_P, count, scheme, rng) for _ in range(30)]
        scores = np.array([(mean - exact) / sigma for mean, _ in runs])
        rms[count] = np.sqrt(np.mean(scores**2))
        assert rms[count] < 3.0 / np.sqrt(count)
        spread = np.mean([covariance for _, covariance in runs], axis=0)
        np.testing.assert_allclose(spread, P, rtol=6.0 / np.sqrt(count))
    assert 0.15 < rms[4000] / rms[250] < 0.35

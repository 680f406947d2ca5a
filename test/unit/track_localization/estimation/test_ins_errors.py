"""Error model against finite differences of the mechanisation, Van Loan's integral and chance."""

import numpy as np
import pytest
from pyins import earth
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from track_localization.estimation import ins

DEG = np.pi / 180.0


def nav_at(lat_deg, h, velocity, rpy):
    return np.array([lat_deg * DEG, 2.0, h, *velocity, *Rotation.from_euler('xyz', rpy).as_quat()])


def plus(nav, error):
    """Return ``nav`` with an error (9,) added, by pyins' radii and scipy's rotations."""
    north, _, parallel = earth.principal_radii(nav[0] / DEG, nav[2])
    out = nav.copy()
    out[:3] += [error[1] / north, error[0] / parallel, error[2]]
    out[3:6] += error[3:6]
    out[6:10] = (Rotation.from_quat(nav[6:10]) * Rotation.from_rotvec(error[6:9])).as_quat()
    return out


def minus(nav, reference):
    """Return the error (9,) of ``reference`` against ``nav``: the inverse of ``plus``."""
    north, _, parallel = earth.principal_radii(reference[0] / DEG, reference[2])
    d = (nav - reference)[:6]
    turn = Rotation.from_quat(reference[6:10]).inv() * Rotation.from_quat(nav[6:10])
    return np.array([d[1] * parallel, d[0] * north, d[2], *d[3:6], *turn.as_rotvec()])


def difference_transition(nav, f, w, dt):
    """
    Return the transition (9, 15) from central differences of ``mechanise``.

    A true bias that is larger than the estimated one means a smaller true rate and force.
    """
    sizes = np.repeat([1000.0, 1.0, 1e-4, 1e-4, 1e-2], 3)

    def moved(error):
        true = plus(nav, error[:9])
        rate, force = w - error[9:12], f - error[12:15]
        ins.mechanise(true, rate, force, rate, force, dt)
        return true

    plain = moved(np.zeros(15))
    columns = []
    for error in np.diag(sizes):
        columns.append(minus(moved(error), plain) - minus(moved(-error), plain))
    return np.stack(columns, axis=1) / (2.0 * sizes)


def remainder(nav, f, w, dt):
    """
    Return what each element (9, 15) may miss: third order in dt, and what is left out by design.

    The first is the next term of the exponential series for rates and forces of this size, the
    Earth's included; left out are 1 % of v / R and 8e-9 1/s^2 of gravity, both over dt.
    """
    radius = 6.33e6
    travel = np.linalg.norm(nav[3:6]) / radius * (1.0 + abs(np.tan(nav[0]))) ** 2
    turn, push = np.linalg.norm(w), np.linalg.norm(f)
    frame = 7.3e-5 + travel
    F = np.zeros((5, 5))
    F[0, 0], F[0, 1] = travel, 1.0
    F[1] = [3.1e-6 + 3.0 * frame * travel, 2.0 * frame, push, 0.0, 1.0]
    F[2] = [frame / radius, (1.0 + abs(np.tan(nav[0]))) / radius, turn, 1.0, 0.0]
    out = 2.0 * np.linalg.matrix_power(F * dt, 3)
    # The body turns inside the step: its middle attitude stands for the mean one.
    out[1] += np.array([0.0, 0.0, push, 0.0, 1.0]) * (turn * dt) ** 2 * dt / 12.0
    # Latitude is that before the step, and the middle's velocity is without Coriolis.
    out[1, 1] += 4.0 * frame * travel * dt**2
    out[2, 1] += travel / radius * dt**2
    out[0, 0] += 0.01 * travel * dt
    out[1, 0] += (0.01 * 3.0 * frame * travel + 9e-9) * dt
    out[2, 0] += 0.01 * frame / radius * dt
    # Differences: 1e-9 m and 1e-14 m/s of rounding, and the third power of an error's size.
    rounding = np.array([2e-9, 3e-14, 3e-16])[:, None] / np.array([1e3, 1.0, 1e-4, 1e-4, 1e-2])
    return np.kron(out[:3] + 10.0 * rounding, np.ones((3, 3)))


CASES = [
    nav_at(0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    nav_at(40.3458, 50.0, (60.0, 45.0, 0.5), (0.02, -0.03, 0.8)),
    nav_at(-33.0, 900.0, (-90.0, 20.0, -3.0), (0.1, 0.05, -2.5)),
    nav_at(68.0, 3500.0, (30.0, -110.0, 8.0), (1.2, -0.7, 3.0)),
]


@pytest.mark.parametrize('dt', [0.01, 0.1])
@pytest.mark.parametrize('w', [(0.0, 0.0, 7e-5), (0.05, -0.1, 0.2)])
@pytest.mark.parametrize('nav', CASES, ids=['equator', 'train', 'south', 'north'])
def test_transition_is_the_derivative_of_the_mechanisation(nav, w, dt):
    attitude = Rotation.from_quat(nav[6:10])
    f, w = attitude.inv().apply([1.0, -2.0, 9.9]), np.array(w)
    Phi = np.full((15, 15), np.nan)
    ins.error_transition(nav, f, w, dt, Phi)
    np.testing.assert_array_equal(Phi[9:], np.eye(15)[9:])
    expected = difference_transition(nav, f, w, dt)
    ratio = np.abs(Phi[:9] - expected) / remainder(nav, f, w, dt)
    assert ratio.max() < 1.0, [
        (i, j, ratio[i, j], Phi[i, j], expected[i, j]) for i, j in np.argwhere(ratio >= 1.0)
    ]


def test_transition_has_every_term_of_the_earth():
    """
    What a remainder could hide, one by one, for a train at 40 degrees, from the textbook.

    Groves, table 14.1 in east-north-up: gravity's slope 2 g / R, Coriolis 2 w_ie + w_en, level
    errors by position and by velocity.
    """
    nav = nav_at(40.0, 0.0, (60.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    Phi = np.empty((15, 15))
    ins.error_transition(nav, np.array([0.0, 0.0, 9.80169]), np.zeros(3), 0.01, Phi)
    F = (Phi - np.eye(15)) / 0.01
    north, up = 7.292115e-5 * np.cos(40.0 * DEG), 7.292115e-5 * np.sin(40.0 * DEG)
    N = 6386976.0
    M = 6361816.0
    travel = 60.0 / N
    tan = np.tan(40.0 * DEG)
    expected = {
        (0, 1): travel * tan,
        (0, 2): -travel,
        (5, 2): 2.0 * 9.80169 / 6.3701e6 - travel**2,
        (4, 3): -2.0 * up - 2.0 * travel * tan,
        (3, 4): 2.0 * up + travel * tan,
        (3, 5): -2.0 * north - travel,
        (5, 3): 2.0 * north + 2.0 * travel,
        (4, 1): -2.0 * north * 60.0 / M - 60.0 * travel / (M * np.cos(40.0 * DEG) ** 2),
        (7, 1): up / M,
        (8, 1): -north / M - travel / (M * np.cos(40.0 * DEG) ** 2),
        (7, 3): -1.0 / N,
        (6, 4): 1.0 / M,
        (8, 3): -tan / N,
        (7, 2): travel / N,
    }
    for (i, j), value in expected.items():
        # Second order in dt adds less than 1 % to the smallest; N and M are to seven digits.
        assert F[i, j] == pytest.approx(value, rel=0.01), (i, j)


def hat(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def body_dynamics(f, w):
    """
    Return F (15, 15) and the noise's way in G (15, 12) over a flat Earth that stands still.

    Position and velocity are resolved along the turning body, so F is constant.
    """
    F, G = np.zeros((15, 15)), np.zeros((15, 12))
    F[0:3, 0:3] = F[3:6, 3:6] = F[6:9, 6:9] = -hat(w)
    F[0:3, 3:6], F[3:6, 6:9], F[3:6, 12:15] = np.eye(3), -hat(f), -np.eye(3)
    F[6:9, 9:12] = G[6:9, 0:3] = G[3:6, 3:6] = -np.eye(3)
    G[9:15, 6:12] = np.eye(6)
    return F, G


def van_loan(psd, f, w, dt, attitude):
    """Return what noise of densities (4,) adds over ``dt``, exactly, in east-north-up (15, 15)."""
    F, G = body_dynamics(f, w)
    W = G @ np.diag(np.repeat(psd, 3)) @ G.T
    both = expm(np.block([[-F, W], [np.zeros((15, 15)), F.T]]) * dt)
    Q = both[15:, 15:].T @ both[:15, 15:]
    turn = np.eye(15)
    turn[0:3, 0:3] = turn[3:6, 3:6] = (attitude * Rotation.from_rotvec(w * dt)).as_matrix()
    return turn @ Q @ turn.T


MEMS = (1e-8, 4e-6, 1e-12, 1e-8)
TACTICAL = (2e-12, 1e-8, 1e-18, 1e-12)


@pytest.mark.parametrize('psd', [MEMS, TACTICAL])
@pytest.mark.parametrize('dt', [0.01, 0.1])
def test_process_noise_of_one_step_is_van_loans(psd, dt):
    """
    What a noise does to its own error and to the next one is there, but for the body's turn w dt.

    What it does further on is not: at most f dt sqrt(gyro / accelerometer) of the same scale.
    """
    attitude = Rotation.from_euler('xyz', [0.1, -0.2, 0.9])
    f, w = np.array([0.5, -0.3, 9.8]), np.array([0.02, 0.01, -0.1])
    expected = van_loan(psd, f, w, dt, attitude)
    nav = np.array([0.7, 2.0, 50.0, 0.0, 0.0, 0.0, *attitude.as_quat()])
    Q = np.full((15, 15), np.nan)
    ins.process_noise(nav, dt, *psd, Q)
    np.testing.assert_array_equal(Q, Q.T)
    leak = (10.0 * dt) ** 2 * psd[0] / psd[1]
    for i, j in [(0, 0), (0, 1), (1, 1), (2, 2), (2, 3), (3, 3), (1, 4), (4, 4)]:
        block = (slice(3 * i, 3 * i + 3), slice(3 * j, 3 * j + 3))
        size = np.abs(expected[block]).max()
        # Of positions and velocities also the tilt's share, and dt^2 / 3 of a bias's.
        missing = leak * (i < 2) + 0.11 * dt + psd[3] / psd[1] * dt * dt + psd[2] / psd[0] * dt * dt
        np.testing.assert_allclose(Q[block], expected[block], atol=missing * size)
    sigma = np.sqrt(np.diag(expected))
    apart = np.abs(Q - expected) / np.outer(sigma, sigma)
    assert apart.max() < np.sqrt(leak) + 0.11 * dt + dt * dt
    assert np.linalg.eigvalsh(Q / np.outer(sigma, sigma)).min() > -1e-12


@pytest.mark.parametrize('psd', [MEMS, TACTICAL])
def test_noise_gathered_over_a_second_is_van_loans(psd):
    """A hundred steps of Phi P Phi' + Q make up for what one step leaves out: to one in 100."""
    attitude = Rotation.from_euler('xyz', [0.1, -0.2, 0.9])
    f, w = np.array([0.5, -0.3, 9.8]), np.array([0.02, 0.01, -0.1])
    expected = van_loan(psd, f, w, 1.0, attitude)
    nav = np.array([0.7, 2.0, 50.0, 0.0, 0.0, 0.0, *attitude.as_quat()])
    P, Q, Phi = np.zeros((15, 15)), np.empty((15, 15)), np.empty((15, 15))
    for _ in range(100):
        ins.error_transition(nav, f, w, 0.01, Phi)
        ins.process_noise(nav, 0.01, *psd, Q)
        ins.propagate(P, Phi, Q)
        turn = Rotation.from_rotvec(0.01 * w)
        nav[6:10] = (Rotation.from_quat(nav[6:10]) * turn).as_quat()
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        P / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.01
    )


@pytest.mark.parametrize('states', [15, 19])
def test_propagate_is_the_dense_product(states, rng):
    A = rng.normal(size=(states, states))
    P, Phi, Q = A @ A.T, np.eye(states), np.zeros((states, states))
    Phi[:9, :15] += 0.1 * rng.normal(size=(9, 15))
    Phi[:9, :9] *= rng.random((9, 9)) > 0.4
    B = rng.normal(size=(15, 15))
    Q[:15, :15] = B @ B.T
    Q = 0.5 * (Q + Q.T)
    P = 0.5 * (P + P.T)
    expected = Phi @ P @ Phi.T + Q
    ins.propagate(P, np.ascontiguousarray(Phi[:15, :15]), np.ascontiguousarray(Q[:15, :15]))
    np.testing.assert_allclose(P, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(P, P.T)


def test_covariance_is_that_of_navigators_with_random_errors(rng):
    """
    200 navigators with biases and noise leave a true one as P says: mean NEES of 15 states.

    On a curve at 60 m/s over 20 s. The interval is that of chi-square with 99.9 %.
    """
    runs, steps, dt = 200, 400, 0.05
    psd = (1e-8, 1e-6, 1e-10, 1e-8)
    start = np.repeat([2.0, 0.1, 2e-3, 1e-3, 2e-2], 3)
    nav = nav_at(40.0, 50.0, (60.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    w, f = np.array([0.0, 0.0, 0.02]), np.array([0.0, 1.2, 9.8])
    P, Phi, Q = np.diag(start**2), np.empty((15, 15)), np.empty((15, 15))
    errors = rng.normal(size=(runs, 15)) * start
    # A navigator thinks what the truth is less its error.
    navs = [plus(nav, -e[:9]) for e in errors]
    biases = errors[:, 9:].copy()
    for _ in range(steps):
        ins.error_transition(nav, f, w, dt, Phi)
        ins.process_noise(nav, dt, *psd, Q)
        ins.propagate(P, Phi, Q)
        ins.mechanise(nav, w, f, w, f, dt)
        noise = rng.normal(size=(runs, 12)) * np.repeat(np.sqrt(psd), 3)
        for one, bias, n in zip(navs, biases, noise, strict=True):
            rate = w + bias[:3] + n[:3] / np.sqrt(dt)
            force = f + bias[3:] + n[3:6] / np.sqrt(dt)
            ins.mechanise(one, rate, force, rate, force, dt)
            bias += n[6:] * np.sqrt(dt)
    found = np.array([[*minus(nav, one), *bias] for one, bias in zip(navs, biases, strict=True)])
    nees = np.einsum('ni,ij,nj->n', found, np.linalg.inv(P), found)
    low, high = chi2.ppf([0.0005, 0.9995], 15 * runs) / (15 * runs)
    assert low < nees.mean() / 15.0 < high

"""What the track filter gives out, against its own states put on the line by numpy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_estimate import (
    TrackEstimate,
    bent_covariance,
    to_trajectory,
)
from coaster_localization.track_map import line_map
from track_localization.sim.coaster.simulate import built_in_model

LINE_SIGMA = 0.03


@pytest.fixture(scope='module')
def line():
    return line_map(built_in_model('looping').design, TrackFilterConfig())


def states(line, count=40, off=0.02):
    """States on two laps and before the first, both ways, and covariances of what they know."""
    rng = np.random.default_rng(4)
    x, P = np.zeros((count, 30)), np.empty((count, 18, 18))
    x[:, 0] = np.linspace(-0.5, 2.3, count) * line.length
    x[:, 1] = rng.uniform(-10.0, 30.0, count)
    scales = np.repeat([0.2, 0.3, 0.01, 0.01, 2e-3, 2e-3, 0.05, 0.03], [1, 1, 3, 3, 3, 3, 3, 1])
    for k in range(count):
        M = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        R = line.line.attitude(x[k, 0]) @ Rotation.from_rotvec(off * rng.normal(size=3)).as_matrix()
        x[k, 2:11], x[k, 11:20] = (R @ M).ravel(), M.ravel()
        A = rng.normal(size=(18, 18)) + 2.0 * np.eye(18)
        d = scales / np.sqrt(np.diag(A @ A.T))
        P[k] = A @ A.T * np.outer(d, d)
    x[:, 20:] = 0.01 * rng.normal(size=(count, 10))
    return x, P


def estimate(x, P, line):
    return TrackEstimate(7.0, x, P, line, np.array([0.1, 0.2, 0.3]), LINE_SIGMA)


def test_one_estimate_is_a_row_of_the_trajectory(line):
    """
    Both give the same of the same state, to what a tenth of a metre of line makes.

    One takes the row below and the other the nearest: the tangent turns by up to 0.02 there.
    """
    x, P = states(line)
    times = np.arange(len(x)) / 10.0
    many = to_trajectory(times, x, P[:, 0:2, 0:2], line, LINE_SIGMA)
    np.testing.assert_array_equal(many.time_s, times)
    for k in range(len(x)):
        one = estimate(x[k], P[k], line)
        np.testing.assert_allclose(one.position, many.position[k], atol=1e-3)
        assert one.chainage == pytest.approx(many.chainage[k], abs=1e-9)
        assert abs(one.speed) == pytest.approx(many.speed[k], rel=2e-3)
        assert one.sigma_along == pytest.approx(many.sigma_along[k], rel=2e-3)
        turned = Rotation.from_quat(one.quaternion).inv() * Rotation.from_quat(many.quaternion[k])
        assert turned.magnitude() < 1e-9
        # The velocity follows the line's tangent, the body is 0.02 rad off it.
        velocity = one.R_nb @ one.velocity_body
        np.testing.assert_allclose(velocity, many.velocity[k], atol=0.08 * abs(x[k, 1]) + 1e-9)
        got = one.pose_covariance[0:3, 0:3]
        np.testing.assert_allclose(got, many.covariance[k], atol=0.02 * P[k, 0, 0])


def test_chainage_and_laps_of_a_circuit(line):
    x, P = states(line)
    for laps, s in ((0, 12.0), (1, 12.0), (3, line.length - 0.01)):
        x[0, 0] = laps * line.length + s
        one = estimate(x[0], P[0], line)
        assert one.lap == laps
        assert one.chainage == pytest.approx(s, abs=1e-6)


def test_chainage_of_an_open_line_is_no_lap():
    open_line = line_map(built_in_model('shuttle').design, TrackFilterConfig())
    x, P = states(open_line)
    x[0, 0] = 321.0
    one = estimate(x[0], P[0], open_line)
    assert (one.lap, one.chainage) == (0, 321.0)
    many = to_trajectory(np.zeros(1), x[:1], P[:1, 0:2, 0:2], open_line, LINE_SIGMA)
    np.testing.assert_allclose(many.position[0], one.position, atol=1e-3)


def test_velocity_is_the_derivative_of_the_position(line):
    """Of the trajectory of a train that goes on at its rate of chainage, backward too."""
    x, P = states(line)
    h = 1e-3
    ahead, behind = x.copy(), x.copy()
    ahead[:, 0] += h * x[:, 1]
    behind[:, 0] -= h * x[:, 1]
    about = (P[:, 0:2, 0:2], line, LINE_SIGMA)
    times = np.arange(len(x)) / 10.0
    up, down, here = (to_trajectory(times, y, *about) for y in (ahead, behind, x))
    numeric = (up.position - down.position) / (2.0 * h)
    np.testing.assert_allclose(here.velocity, numeric, atol=5e-3 * np.abs(x[:, 1]).max())
    np.testing.assert_allclose(here.speed, np.linalg.norm(numeric, axis=1), rtol=3e-3, atol=1e-2)
    one = estimate(x[3], P[3], line)
    assert np.sign(one.speed) == np.sign(x[3, 1])


def test_pose_covariance_is_that_of_its_samples(line):
    """Errors drawn from P, applied to the state by scipy: 20 000 poses spread as is said."""
    x, P = (part[17] for part in states(line))
    P = P / 100.0
    rng = np.random.default_rng(9)
    errors = rng.multivariate_normal(np.zeros(18), P, 20_000)
    C, M = x[2:11].reshape(3, 3), x[11:20].reshape(3, 3)
    tilted = Rotation.from_rotvec(errors[:, 2:5]).as_matrix() @ C
    mounted = Rotation.from_rotvec(errors[:, 5:8]).as_matrix() @ M
    bodies = tilted @ np.swapaxes(mounted, 1, 2)
    turns = Rotation.from_matrix(bodies @ (C @ M.T).T).as_rotvec()
    places = line.line.position(x[0] + errors[:, 0])
    places += LINE_SIGMA * rng.normal(size=places.shape)
    got = estimate(x, P, line).pose_covariance
    np.testing.assert_allclose(got, got.T, atol=1e-15)
    spread = np.cov(turns.T)
    np.testing.assert_allclose(got[3:6, 3:6], spread, atol=0.04 * np.diag(spread).max())
    spread = np.cov(places.T)
    np.testing.assert_allclose(got[0:3, 0:3], spread, atol=0.04 * np.diag(spread).max())


def test_twist_covariance_has_speed_and_gyro_bias(line):
    """Along the line the speed's variance; the rate's is the bias's, in body axes."""
    x, P = (part[5] for part in states(line))
    P = 100.0 * P
    one = estimate(x, P, line)
    got = one.twist_covariance
    forward = one.velocity_body / one.speed
    assert np.linalg.norm(forward) == pytest.approx(1.0, abs=1e-9)
    stretch = np.linalg.norm(line.line.slope(x[0]))
    assert forward @ got[0:3, 0:3] @ forward == pytest.approx(P[1, 1] * stretch**2, rel=0.01)
    M = x[11:20].reshape(3, 3)
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(3), P[8:11, 8:11], 20_000)
    spread = np.cov(M @ draws.T) + 1e-4 * np.eye(3)
    np.testing.assert_allclose(got[3:6, 3:6], spread, atol=0.02 * np.diag(spread).max())
    assert np.linalg.eigvalsh(got)[0] > 0.0


@pytest.mark.parametrize('sigma', [3.0, 30.0, 200.0])
def test_wide_covariance_holds_the_places_that_are_possible(line, sigma):
    """
    The mean squared distance in any direction, of places drawn along the line, bends and all.

    Six points stand for the distribution: a third off where it spans many bends.
    """
    rng = np.random.default_rng(8)
    s = np.array([0.4, 0.6]) * line.length
    got = bent_covariance(line, s, np.full(2, sigma))
    for k in range(2):
        drawn = line.line.position((s[k] + sigma * rng.normal(size=5000)) % line.length)
        apart = drawn - line.line.position(s[k : k + 1])
        expected = apart.T @ apart / len(apart)
        assert np.trace(got[k]) == pytest.approx(np.trace(expected), rel=0.35)
        # What is there is covered in its own direction, not along the tangent alone.
        nees = np.einsum('ni,ij,nj->n', apart, np.linalg.inv(got[k] + 0.3**2 * np.eye(3)), apart)
        assert nees.mean() < 12.0

"""Updates of the train's filter against finite differences and the textbook's formula."""

from __future__ import annotations

import numpy as np
import pytest

from track_localization.estimation import so3
from track_localization.estimation.ins import inject
from train_localization import kernels, map_kernels
from train_localization.kernels import AUX, MAP, SCALE, SIZE, SLOW

STEP = 1e-4


@pytest.fixture
def state(rng):
    """A train at 40 N that runs north-east at 50 m/s, climbing, everything a little off."""
    R = so3.matrix_from_rpy(0.03, -0.02, 0.8)
    nav = np.concatenate([[0.7, 2.0, 300.0], R @ [50.0, 0.4, -0.3], so3.quat_from_matrix(R)])
    aux = 1e-3 * rng.standard_normal(AUX)
    root = 0.1 * rng.standard_normal((SIZE, SIZE)) + np.diag(np.full(SIZE, 0.5))
    return nav, aux, root @ root.T


def moved(nav, aux, k, step):
    """Return nav and aux with the error state k (and no other) put in by ``step``."""
    dx = np.zeros(SIZE)
    dx[k] = step
    nav, aux = nav.copy(), aux.copy()
    inject(nav, dx)
    aux += dx[9:]
    return nav, aux


def jacobian(predicted, nav, aux):
    """Return the row of H of a scalar that the state predicts, by central differences."""
    row = np.empty(SIZE)
    for k in range(SIZE):
        up = predicted(*moved(nav, aux, k, STEP))
        down = predicted(*moved(nav, aux, k, -STEP))
        row[k] = (up - down) / (2.0 * STEP)
    return row


def dense(nav, aux, P, rows):
    """Return nav, aux, P after numbers (h, R, nu) taken at once, by the textbook's formula."""
    H = np.array([h for h, _, _ in rows])
    R = np.diag([r for _, r, _ in rows])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    dx = K @ np.array([nu for _, _, nu in rows])
    nav, aux = nav.copy(), aux.copy()
    inject(nav, dx)
    return nav, aux + dx[9:], (np.eye(SIZE) - K @ H) @ P


def body(nav):
    R = so3.matrix_from_quat(nav[6:10])
    return R.T @ nav[3:6]


def assert_same(one, other):
    """A Jacobian by differences of 1e-4 is good to about 1e-7 of the speeds in it, 50 m/s."""
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=2e-5, atol=2e-6)


def test_odometer_update_is_that_of_its_measurement_model(state):
    nav, aux, P = state
    speed, R = 50.2, 0.04

    def predicted(nav, aux):
        return body(nav)[0] - speed / (1.0 + aux[SCALE - 9])

    expected = dense(nav, aux, P, [(jacobian(predicted, nav, aux), R, -predicted(nav, aux))])
    kernels.wheel(nav, aux, P, speed, 0.0, R, 1e9)
    assert_same((nav, aux, P), expected)


def test_a_slipping_odometer_changes_nothing(state):
    nav, aux, P = state
    P[:] = np.diag(np.full(SIZE, 1e-6))
    before = nav.copy(), aux.copy(), P.copy()
    assert kernels.wheel(nav, aux, P, 60.0, 0.0, 0.01, 16.0) > 16.0
    assert all(np.array_equal(a, b) for a, b in zip((nav, aux, P), before, strict=True))


@pytest.mark.parametrize('lever', [0.0, 8.0])
def test_rails_forbid_motion_across_the_car(state, lever):
    """Where the rails hold it, ``lever`` behind the IMU, which swings out with the turn."""
    nav, aux, P = state
    w = np.array([0.01, -0.02, 0.03])

    def sideways(nav, aux):
        v = body(nav) + np.cross(w - aux[:3], [-lever, 0.0, 0.0])
        return v[1] - aux[7] * v0

    def upward(nav, aux):
        v = body(nav) + np.cross(w - aux[:3], [-lever, 0.0, 0.0])
        return v[2] + aux[8] * v0

    v0 = body(nav)[0]
    rows = [(jacobian(f, nav, aux), 0.01, -f(nav, aux)) for f in (sideways, upward)]
    expected = dense(nav, aux, P, rows)
    kernels.rails(nav, aux, P, 0.01, w, lever)
    assert_same((nav, aux, P), expected)


NOTHING = np.zeros((3, 3))


def test_an_antenna_moves_as_the_attitude_turns(state):
    """Its place, and the rows by central differences."""
    nav, aux, _ = state
    lever = np.array([5.0, -0.5, 3.0])
    way, rows = kernels.antenna(nav, lever)
    np.testing.assert_allclose(way, so3.matrix_from_quat(nav[6:]) @ lever)
    for k in range(3):
        slopes = jacobian(lambda n, _, k=k: kernels.antenna(n, lever)[0][k], nav, aux)
        np.testing.assert_allclose(rows[k], slopes[6:9], atol=1e-5)


def test_fix_corrects_position_and_slow_error_together(state):
    nav, aux, P = state
    ahead, R = np.array([0.4, -0.3, 0.2]), np.array([0.1, 0.2, 0.3])
    turned = np.arange(9.0).reshape(3, 3)
    rows = []
    for k in range(3):
        h = np.zeros(SIZE)
        h[k] = h[SLOW + k] = 1.0
        h[6:9] = turned[k]
        rows.append((h, R[k], ahead[k] - aux[SLOW + k - 9]))
    expected = dense(nav, aux, P, rows)
    kernels.fix(nav, aux, P, ahead, turned, R, 3, 1e9, 1e9)
    assert_same((nav, aux, P), expected)


@pytest.mark.parametrize('known', [0.25, 25.0])
@pytest.mark.parametrize(('sigmas', 'weight'), [(1.0, 1.0), (4.0, 6.6 / 16.0), (80.0, 0.0)])
def test_a_fix_far_off_weighs_less_or_nothing(state, known, sigmas, weight):
    """Huber: beyond the knee as much less as its NIS is above it, however little is known."""
    nav, aux, P = state
    P[:] = np.diag(np.full(SIZE, known))
    aux[:] = 0.0
    north, R = nav[0], 0.5
    expected = 2.0 * known + R
    ahead = np.array([0.0, sigmas * np.sqrt(expected), 0.0])
    nis = kernels.fix(nav, aux, P, ahead, NOTHING, np.full(3, R), 2, 6.6, 25.0)
    assert nis == pytest.approx(sigmas**2)
    correction = (nav[0] - north) * 6.36e6
    assert correction == pytest.approx(weight * known / expected * ahead[1], rel=0.01)


def test_three_satellites_correct_the_plane_only(state):
    nav, aux, P = state
    P[:] = np.diag(np.full(SIZE, 0.25))
    height = nav[2]
    kernels.fix(nav, aux, P, np.array([0.5, 0.5, 5.0]), NOTHING, np.full(3, 0.5), 2, 6.6, 25.0)
    assert nav[2] == height


def test_line_update_is_that_of_its_measurement_model(state):
    nav, aux, P = state
    left, upward = np.array([-0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0])
    ahead, R, course = np.array([0.2, 0.5, -0.1]), np.array([0.09, 0.25]), 1e-5
    speed = float(np.linalg.norm(nav[3:6]))
    rows = []
    for k, axis in enumerate((left, upward)):
        h = np.zeros(SIZE)
        h[:3], h[MAP + k] = axis, -1.0
        rows.append((h, R[k], axis @ ahead + aux[MAP + k - 9]))
        h = np.zeros(SIZE)
        h[3:6] = axis
        rows.append((h, course * speed**2, -axis @ nav[3:6]))
    expected = dense(nav, aux, P, rows)
    map_kernels.line(nav, aux, P, ahead, left, upward, R, course, 1e9)
    assert_same((nav, aux, P), expected)


def test_a_standing_train_tells_its_gyro_biases(state):
    """What the gyros show at rest is the Earth's turning and the bias."""
    nav, aux, P = state
    nav[3:6], aux[:] = 0.0, 0.0
    P[:] = np.diag(np.full(SIZE, 1e-4))
    R = so3.matrix_from_quat(nav[6:10])
    earth = 7.292115e-5 * np.array([0.0, np.cos(0.7), np.sin(0.7)])
    bias = np.array([1e-4, -2e-4, 3e-4])
    kernels.stand(nav, aux, P, R.T @ earth + bias, 1e-6, 1e-12)
    np.testing.assert_allclose(aux[:3], bias, atol=1e-9)


def test_a_map_is_weighed_as_the_mixture_of_its_two_priors(state, rng):
    """Against drawing: offsets to the left of both kinds, weighted by what the filter has seen."""
    nav, aux, P = state
    root = np.zeros((SIZE, SIZE))
    used = [0, MAP, MAP + 1]
    root[np.ix_(used, used)] = [[0.3, 0.0, 0.0], [0.5, 0.7, 0.0], [-0.2, 0.1, 0.9]]
    P[:] = root @ root.T + np.diag(np.full(SIZE, 1e-9))
    aux[:] = 0.0
    seen = np.array([0.9, -0.4])
    aux[MAP - 9 : MAP - 7] = seen
    north, wide, narrow, share = nav.copy(), 4.0, 0.04, 0.9
    drawn = rng.multivariate_normal(np.zeros(3), P[np.ix_(used, used)], 400_000)
    squared = (drawn[:, 1] + seen[0]) ** 2
    ratio = np.sqrt(wide / narrow) * np.exp(-0.5 * squared * (1.0 / narrow - 1.0 / wide))
    weight = share * ratio + 1.0 - share
    expected = share * ratio.mean() / weight.mean()
    mean = (drawn * weight[:, None]).sum(axis=0) / weight.sum()
    spread = np.cov(drawn.T, aweights=weight)
    right = map_kernels.weigh_map(nav, aux, P, wide, narrow, share)
    assert right == pytest.approx(expected, rel=0.03)
    np.testing.assert_allclose(aux[MAP - 9 : MAP - 7], seen + mean[1:], atol=0.02)
    east = (nav[1] - north[1]) * 6.378e6 * np.cos(north[0])
    assert east == pytest.approx(mean[0], abs=0.02)
    np.testing.assert_allclose(P[np.ix_(used, used)], spread, atol=0.02)


@pytest.mark.parametrize(
    ('off', 'wide', 'share', 'right'),
    [(30.0, 4.0, 1.0, 0.0), (3.0, 0.04, 0.9, 0.0), (0.3, 4.0, 0.0, 0.0), (3.0, 4.0, 0.9, 0.02)],
)
def test_a_map_that_cannot_be_right_changes_little_or_nothing(state, off, wide, share, right):
    """Fixes are sure against it, it has one prior only, no map is right, fixes speak against."""
    nav, aux, P = state
    P[:] = np.diag(np.full(SIZE, 0.25))
    aux[:] = 0.0
    aux[MAP - 9] = off
    assert map_kernels.weigh_map(nav, aux, P, wide, 0.04, share) <= right
    assert aux[MAP - 9] == pytest.approx(off, rel=0.02)
    assert P[MAP, MAP] == pytest.approx(0.25, rel=0.5)


def test_covariance_spreads_as_the_transition_says(state, rng):
    """Against the whole matrix product."""
    _, _, P = state
    Phi, Q = np.eye(15) + 0.1 * rng.standard_normal((15, 15)), np.eye(15)
    noise = kernels.Noise(0.0, 0.0, 0.0, 0.0, 0.64, 2.25, 100.0)
    whole, driven = np.eye(SIZE), np.zeros((SIZE, SIZE))
    keep = np.exp(-0.01)
    whole[:15, :15] = Phi
    whole[SLOW : SLOW + 3, SLOW : SLOW + 3] *= keep
    driven[:15, :15] = Q
    driven[SLOW : SLOW + 3, SLOW : SLOW + 3] = (1 - keep**2) * np.diag([0.64, 0.64, 2.25])
    expected = whole @ P @ whole.T + driven
    kernels.spread(P, Phi, Q, 1.0, noise)
    np.testing.assert_allclose(P, expected, rtol=1e-12, atol=1e-12)


def test_what_is_known_of_the_slow_error_fades_with_its_correlation_time(state):
    """A first-order process: after its correlation time mean and sigma about it are as exp(-1)."""
    nav, aux, P = state
    aux[SLOW - 9 : SLOW - 6] = [1.0, -2.0, 3.0]
    P[:] = np.diag(np.full(SIZE, 1e-6))
    noise = kernels.Noise(0.0, 0.0, 0.0, 0.0, 0.64, 2.25, 0.5)
    stamps, still = np.array([0.25, 0.5]), np.zeros((2, 3))
    others = np.delete(aux, [SLOW - 9, SLOW - 8, SLOW - 7])
    kernels.predict(nav, aux, P, 0.0, stamps, still, still, np.zeros(6), noise, np.empty((15, 15)))
    np.testing.assert_allclose(aux[SLOW - 9 : SLOW - 6], np.array([1.0, -2.0, 3.0]) / np.e)
    np.testing.assert_array_equal(np.delete(aux, [SLOW - 9, SLOW - 8, SLOW - 7]), others)
    forgotten = 1.0 - np.exp(-2.0)
    np.testing.assert_allclose(
        np.diag(P)[SLOW : SLOW + 3], forgotten * np.array([0.64, 0.64, 2.25]), rtol=1e-5
    )

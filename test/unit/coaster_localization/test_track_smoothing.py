"""Smoothing against the batch solution of a linear case; the fixed lag against the smoother."""

import numpy as np
import pytest

from coaster_localization.track_smoothing import FixedLag, smooth_epochs
from coaster_localization.track_states import Epoch

FREE = np.array([0, 1, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17])
"""Errors without the angles: of them a state is a plain vector, so the whole case is linear."""
EPOCH_S = 0.05


def to_state(vector):
    """Nominal state (30,) of the 12 numbers; sensor, body and map are aligned."""
    return np.concatenate([vector[:2], np.eye(3).ravel(), np.eye(3).ravel(), vector[2:]])


def to_vector(x):
    return np.concatenate([x[0:2], x[20:30]])


def full(small, angles):
    """Covariance or transition (18, 18) with its own block on the angles."""
    out = np.zeros((18, 18))
    out[np.ix_(FREE, FREE)] = small
    out[2:8, 2:8] = angles * np.eye(6)
    return out


class LinearRide:
    """A random linear system of 12 states: its Kalman epochs, and all that made them."""

    def __init__(self, count=24, restarts=()):
        rng = np.random.default_rng(3)
        self.m0, self.P0 = rng.normal(size=12), np.diag(rng.uniform(0.5, 2.0, 12))
        self.Q = 0.05 * np.diag(rng.uniform(0.5, 2.0, 12))
        self.restarts = {0, *restarts}
        self.F, self.H, self.z, self.R = [], [], [], np.diag([0.1, 0.3])
        self.epochs = []
        m, P = self.m0, self.P0
        for k in range(count):
            F = np.eye(12) + 0.15 * rng.normal(size=(12, 12))
            H, z = rng.normal(size=(2, 12)), rng.normal(size=2)
            if k in self.restarts:
                m_before, P_before, given = self.m0, self.P0, np.zeros((18, 18))
            else:
                m_before, P_before, given = F @ m, F @ P @ F.T + self.Q, full(F, 1.0)
            S = H @ P_before @ H.T + self.R
            K = np.linalg.solve(S, H @ P_before).T
            m = m_before + K @ (z - H @ m_before)
            P = P_before - K @ S @ K.T
            self.epochs.append(
                Epoch(
                    100.0 + EPOCH_S * k,
                    to_state(m_before),
                    full(P_before, 0.04 + 1e-3 * k),
                    given,
                    to_state(m),
                    full(P, 0.04 + 1e-3 * k),
                )
            )
            self.F.append(F)
            self.H.append(H)
            self.z.append(z)

    def batch(self):
        """Means (N, 12) and covariances (N, 12, 12) of all states by one least-squares problem."""
        n = len(self.z)
        information, right = np.zeros((12 * n, 12 * n)), np.zeros(12 * n)
        for k in range(n):
            here = slice(12 * k, 12 * k + 12)
            information[here, here] += self.H[k].T @ np.linalg.inv(self.R) @ self.H[k]
            right[here] += self.H[k].T @ np.linalg.inv(self.R) @ self.z[k]
            if k in self.restarts:
                information[here, here] += np.linalg.inv(self.P0)
                right[here] += np.linalg.solve(self.P0, self.m0)
                continue
            both = slice(12 * k - 12, 12 * k + 12)
            step = np.hstack([-self.F[k], np.eye(12)])
            information[both, both] += step.T @ np.linalg.inv(self.Q) @ step
        covariance = np.linalg.inv(information)
        means = (covariance @ right).reshape(n, 12)
        return means, np.array([covariance[12 * k :, 12 * k :][:12, :12] for k in range(n)])


@pytest.mark.parametrize('restarts', [(), (9,), (1, 20)])
def test_smoothing_is_the_batch_least_squares_solution(restarts):
    """Also across starts (F = 0): nothing of one ride reaches another."""
    ride = LinearRide(restarts=restarts)
    means, covariances = ride.batch()
    x, P = smooth_epochs(ride.epochs)
    assert x.shape == (24, 30)
    assert P.shape == (24, 18, 18)
    np.testing.assert_allclose([to_vector(row) for row in x], means, atol=1e-8)
    small = P[:, FREE[:, None], FREE]
    np.testing.assert_allclose(small, covariances, atol=1e-9)
    np.testing.assert_allclose(P, np.swapaxes(P, 1, 2), atol=1e-15)


def test_angles_that_are_known_later_are_known_before():
    """Tilt and mount that do not move: what the end knows of them holds everywhere."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    epochs = LinearRide(8).epochs
    known = epochs[-1].x.copy()
    known[2:11], known[11:20] = turn.ravel(), turn.T.ravel()
    epochs = [
        e._replace(
            P=full(np.eye(12), 0.04), P_before=full(np.eye(12), 0.04), F=full(e.F[:12, :12], 1)
        )
        for e in epochs
    ]
    last = epochs[-1]
    epochs[-1] = last._replace(x=known, P=full(np.eye(12), 1e-4))
    x, P = smooth_epochs(epochs)
    np.testing.assert_allclose(x[:, 2:11], np.tile(turn.ravel(), (8, 1)), atol=1e-9)
    np.testing.assert_allclose(x[:, 11:20], np.tile(turn.T.ravel(), (8, 1)), atol=1e-9)
    np.testing.assert_allclose(P[:, range(2, 8), range(2, 8)], 1e-4, rtol=1e-9)


def test_past_is_cut_off_where_f_is_nothing():
    """What comes after a start changes nothing before it: that stays as it was filtered."""
    ride = LinearRide(restarts=(9,))
    before, P_before = smooth_epochs(ride.epochs[:9])
    x, P = smooth_epochs(ride.epochs)
    np.testing.assert_allclose(x[:9], before, atol=1e-14)
    np.testing.assert_allclose(P[:9], P_before, atol=1e-14)
    np.testing.assert_allclose(x[8], ride.epochs[8].x, atol=1e-14)


def test_one_epoch_and_none():
    epoch = LinearRide(1).epochs[0]
    x, P = smooth_epochs([epoch])
    np.testing.assert_array_equal(x[0], epoch.x)
    np.testing.assert_array_equal(P[0], epoch.P)
    assert smooth_epochs([])[0].shape == (0, 30)


@pytest.mark.parametrize('lag_s', [0.0, 0.3, 0.62])
def test_fixed_lag_gives_what_the_smoother_knew_then(lag_s):
    """
    Every epoch once, in order, as the smoother has it from the newest epoch of that moment.

    It is at least lag_s old, and no older than that and a batch.
    """
    ride = LinearRide(60)
    lag, given, oldest = FixedLag(lag_s), [], 0
    for k, epoch in enumerate(ride.epochs):
        released = lag.push(epoch)
        x, P = smooth_epochs(ride.epochs[: k + 1])
        for time_s, state, covariance in released:
            i = len(given)
            assert time_s == ride.epochs[i].time_s
            np.testing.assert_allclose(state, x[i], atol=1e-10)
            np.testing.assert_allclose(covariance, P[i], atol=1e-10)
            assert epoch.time_s - time_s >= lag_s - 1e-9
            given.append(time_s)
        oldest = max(oldest, k + 1 - len(given))
    assert oldest <= np.ceil(lag_s / EPOCH_S) + FixedLag.BATCH
    x, _ = smooth_epochs(ride.epochs)
    rest = lag.flush()
    assert [t for t, _, _ in rest] == [e.time_s for e in ride.epochs[len(given) :]]
    states = np.array([state for _, state, _ in rest]).reshape(-1, 30)
    np.testing.assert_allclose(states, x[len(given) :], atol=1e-10)
    assert lag.flush() == []


def test_no_variance_is_less_than_nothing_where_the_next_epoch_is_another_hypothesis_s():
    """One surer of all than it could be after what came before: the filter's own P stands."""
    epochs = LinearRide(8).epochs
    other = epochs[5]
    epochs[5] = other._replace(P_before=0.05 * other.P_before, P=0.01 * other.P)
    _, P = smooth_epochs(epochs)
    assert np.einsum('kii->ki', P).min() > 0.0
    np.testing.assert_array_equal(P[4], epochs[4].P)

"""Chainage to pose and back; the truth is a circle's closed form, written down here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maglev_localization.estimate import Estimate
from maglev_localization.placing import Placing, PlacingConfig
from track_localization.track.centreline import Centreline
from track_localization.track.track_file import TrackFile

RADIUS_M = 500.0
ARC_M = 700.0
CONFIG = PlacingConfig(0.1, 0.02, 0.03, 0.04)
"""Figures that differ from each other, so that a mix-up shows."""


def circle(s) -> tuple[np.ndarray, np.ndarray]:
    """Return position (..., 3) and R_nb (..., 3, 3) on a level left-hand bend, from the origin."""
    angle = np.asarray(s) / RADIUS_M
    sin, cos, zero, one = np.sin(angle), np.cos(angle), 0.0 * angle, 1.0 + 0.0 * angle
    position = RADIUS_M * np.stack([sin, 1.0 - cos, zero], axis=-1)
    front = np.stack([cos, sin, zero], axis=-1)
    left = np.stack([-sin, cos, zero], axis=-1)
    up = np.stack([zero, zero, one], axis=-1)
    return position, np.stack([front, left, up], axis=-1)


def track() -> TrackFile:
    position, R = circle(np.arange(0.0, ARC_M + 1.0, 2.0))
    return TrackFile(position, R[:, :, 0], R[:, :, 1], R[:, :, 2])


@pytest.fixture(scope='module')
def bend() -> Placing:
    return Placing(Centreline.from_track(track()), CONFIG)


@pytest.fixture
def straight() -> Placing:
    return Placing(None, CONFIG)


def estimate(s=300.0, speed=20.0, sigma=3.0, sigma_speed=0.5) -> Estimate:
    covariance = np.diag([sigma**2, sigma_speed**2, 0.01])
    return Estimate(12.5, np.array([s, speed, 0.7]), covariance)


@pytest.mark.parametrize('s', [0.0, 123.4, 699.0])
def test_the_pose_is_that_of_the_line(bend, s):
    """2 m between points: a chord's sagitta is 1 mm, the spline's error less."""
    placed = bend.place(estimate(s))
    position, R = circle(s)
    np.testing.assert_allclose(placed.position, position, atol=1e-3)
    np.testing.assert_allclose(Rotation.from_quat(placed.quaternion).as_matrix(), R, atol=1e-5)
    assert (placed.time_s, placed.chainage, placed.sigma_along) == (12.5, s, 3.0)


@pytest.mark.parametrize('speed', [20.0, -3.0, 0.0])
def test_the_twist_is_forward_and_turns_with_the_bend(bend, speed):
    placed = bend.place(estimate(speed=speed))
    np.testing.assert_allclose(placed.velocity_body, [speed, 0.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(placed.angular_rate, [0.0, 0.0, speed / RADIUS_M], atol=1e-4)


def test_the_doubt_is_long_along_the_line_and_thin_across(bend):
    placed = bend.place(estimate(sigma=3.0))
    R = circle(300.0)[1]
    expected = R @ np.diag([9.0, 0.01, 0.01]) @ R.T
    np.testing.assert_allclose(placed.pose_covariance[:3, :3], expected, atol=1e-3)
    np.testing.assert_allclose(
        placed.twist_covariance[:3, :3], np.diag([0.25, 9e-4, 9e-4]), atol=1e-4
    )


def test_a_train_further_on_has_turned_further(bend):
    """Rotation and its correlation with the place, against poses drawn along the line."""
    rng = np.random.default_rng(1)
    s = rng.normal(300.0, 3.0, 4000)
    position, R = circle(s)
    middle = circle(300.0)[1]
    turned = np.array([Rotation.from_matrix(r @ middle.T).as_rotvec() for r in R])
    drawn = np.cov(np.concatenate([position, turned], axis=1).T)
    own = np.diag([0.0, 0.0, 0.0, 4e-4, 4e-4, 4e-4])
    P = bend.place(estimate(sigma=3.0)).pose_covariance - own
    # A covariance of 4000 draws is known to 2 %; three of those.
    assert P[5, 5] == pytest.approx(drawn[5, 5], rel=0.07)
    np.testing.assert_allclose(P[:2, 5], drawn[:2, 5], rtol=0.07)


@pytest.mark.parametrize('sigma', [1e-3, 0.3, 3500.0])
@pytest.mark.parametrize('which', ['bend', 'straight'])
def test_covariances_are_positive_definite(request, which, sigma):
    placed = request.getfixturevalue(which).place(estimate(sigma=sigma, sigma_speed=sigma))
    for P in (placed.pose_covariance, placed.twist_covariance):
        np.testing.assert_array_equal(P, P.T)
        scale = np.sqrt(P.diagonal())
        assert np.linalg.eigvalsh(P / np.outer(scale, scale))[0] > 0.0


@pytest.mark.parametrize(('s', 'end'), [(-50.0, 0.0), (ARC_M + 50.0, ARC_M)])
def test_beyond_its_ends_the_line_goes_on_straight(bend, s, end):
    placed = bend.place(estimate(s))
    position, R = circle(end)
    # The slope at the end of the spline is off by 1e-5 at most: 0.5 mm over 50 m.
    np.testing.assert_allclose(placed.position, position + (s - end) * R[:, 0], atol=2e-3)
    np.testing.assert_allclose(Rotation.from_quat(placed.quaternion).as_matrix(), R, atol=1e-4)
    np.testing.assert_array_equal(placed.angular_rate, 0.0)


def test_without_a_track_x_is_the_chainage(straight):
    placed = straight.place(estimate(1234.5, -2.0))
    np.testing.assert_array_equal(placed.position, [1234.5, 0.0, 0.0])
    np.testing.assert_array_equal(placed.quaternion, [0.0, 0.0, 0.0, 1.0])
    np.testing.assert_array_equal(placed.velocity_body, [-2.0, 0.0, 0.0])
    np.testing.assert_array_equal(placed.angular_rate, 0.0)
    np.testing.assert_allclose(placed.pose_covariance, np.diag([9.0, 0.01, 0.01, 4e-4, 4e-4, 4e-4]))
    assert placed.chainage == 1234.5


def test_on_a_circuit_the_chainage_is_of_one_lap():
    s = np.arange(0.0, 2.0 * np.pi * RADIUS_M - 1.0, 2.0)
    position, R = circle(s)
    ring = Centreline.from_track(TrackFile(position, R[:, :, 0], R[:, :, 1], R[:, :, 2]))
    placed = Placing(ring, CONFIG).place(estimate(ring.length + 25.0))
    assert placed.chainage == pytest.approx(25.0, abs=1e-9)
    np.testing.assert_allclose(placed.position, circle(25.0)[0], atol=0.01)


def test_a_place_becomes_the_nearest_chainage(bend):
    """4 m to the left; of its covariance only what lies along the line counts."""
    position, R = circle(250.0)
    covariance = R @ np.diag([2.25, 9.0, 1.0]) @ R.T
    s, variance = bend.chainage(position + 4.0 * R[:, 1], covariance)
    assert s == pytest.approx(250.0, abs=1e-3)
    assert variance == pytest.approx(2.25, rel=1e-3)


def test_a_place_and_its_estimate_agree(bend):
    placed = bend.place(estimate(432.1))
    s, variance = bend.chainage(placed.position, placed.pose_covariance[:3, :3])
    assert s == pytest.approx(432.1, abs=1e-6)
    assert variance == pytest.approx(9.0, rel=1e-6)


def test_a_place_off_the_line_is_refused(bend):
    position, R = circle(250.0)
    off = position + 30.0 * R[:, 1]
    assert bend.chainage(off, np.eye(3)) == 'off_track'
    assert bend.chainage(off, 36.0 * np.eye(3))[0] == pytest.approx(250.0, abs=1e-3)


def test_without_a_track_a_place_is_its_x(straight):
    P = np.diag([2.25, 9.0, 1.0])
    assert straight.chainage(np.array([77.0, 800.0, 3.0]), P) == (77.0, 2.25)

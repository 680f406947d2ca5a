"""A curved guideway: chainage is arc length, and the track file holds the same line."""

import numpy as np
import pytest

from track_localization.sim.maglev.config import Line
from track_localization.sim.maglev.guideway import Guideway, guideway_of
from track_localization.track.centreline import Centreline

LINE = Guideway(length=7000.0, radius=600.0, grade=0.02)


def test_chainage_is_arc_length():
    """Chords of 0.1 m are as long as their chainage, but for l^3/(24 R^2) = 1e-10 m."""
    s = np.arange(0.0, 7000.05, 0.1)
    chords = np.linalg.norm(np.diff(LINE.position(s), axis=0), axis=1)
    np.testing.assert_allclose(chords, 0.1, atol=2e-9)
    np.testing.assert_array_equal(LINE.position(np.zeros(1)), [[0.0, 0.0, 0.0]])


def test_direction_is_the_tangent():
    """Central differences over 1 m: they err by l^2/(24 R L) of the curve's change."""
    s = np.linspace(1.0, 6999.0, 5000)
    tangent = LINE.position(s + 0.5) - LINE.position(s - 0.5)
    np.testing.assert_allclose(tangent, LINE.direction(s), atol=1e-6)


def test_curves_and_slopes_keep_their_limits():
    """The tightest curve is near 600 m, never under; slopes up to 2 %, curves both ways."""
    s = np.linspace(0.0, 7000.0, 70001)
    turn = np.gradient(LINE.direction(s), s, axis=0)
    curvature = np.linalg.norm(turn[1:-1], axis=1)
    assert curvature.max() < 1.005 / 600.0  # with the share of the slopes' own curvature
    assert curvature.max() > 0.9 / 600.0
    slope = LINE.direction(s)[:, 2]
    assert slope.max() == pytest.approx(0.02, rel=1e-3)
    assert slope.min() == pytest.approx(-0.02, rel=1e-3)
    course = np.unwrap(np.arctan2(*LINE.direction(s).T[[1, 0]]))
    assert np.diff(course).max() > 0.0 > np.diff(course).min()


def test_attitude():
    """Right-handed axes, x along the line, y level: it does not lean."""
    R = LINE.attitude(np.linspace(0.0, 7000.0, 500))
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.eye(3)[None].repeat(500, 0), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    np.testing.assert_allclose(R[:, 2, 1], 0.0, atol=1e-15)
    assert R[:, 2, 2].min() > 0.999


def test_the_track_file_holds_the_line():
    """What is fitted to its rows is the same place by the same chainage, to 0.01 mm."""
    line = Centreline.from_track(LINE.track())
    assert line.length == pytest.approx(7000.0, abs=1e-5)
    assert not line.closed
    s = np.linspace(0.0, 7000.0, 7001)
    np.testing.assert_allclose(line.position(s), LINE.position(s), atol=1e-5)


def test_a_straight_line_has_none():
    assert guideway_of(Line()) is None

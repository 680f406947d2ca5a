"""The look-up table against circles and helices, whose geometry is a formula."""

import numpy as np
import pytest

from track_localization.estimation.so3 import quat_from_matrix
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.line_table import LineTable

RADIUS = 20.0


def circle_ride(seat_height=0.0, laps=1.0):
    """A ride round a banked circle: the seat leans inward by ``seat_height`` metres."""
    time_s = np.arange(0.0, laps * 2 * np.pi * RADIUS / 10.0, 0.01)
    s = 10.0 * time_s
    angle = s / RADIUS
    seat_radius = RADIUS - seat_height
    c, sn, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    position = np.stack([seat_radius * sn, RADIUS - seat_radius * c, zero], axis=1)
    forward = np.stack([c, sn, zero], axis=1)
    left = np.stack([-sn, c, zero], axis=1)
    R = np.stack([forward, left, np.cross(forward, left)], axis=-1)
    n = len(s)
    return DesignRide(
        time_s, s, position, quat_from_matrix(R), 10.0 * forward, np.zeros((n, 3)), np.zeros((n, 3))
    )


@pytest.fixture(scope='module')
def table():
    return LineTable(Centreline.from_design_ride(circle_ride(seat_height=2.0)))


def test_stretch_and_bend_of_a_seat_inside_its_track(table):
    """The seat's circle is 18 m, the track's 20 m: 0.9 m of path for a metre of chainage."""
    inner = slice(100, -100)
    np.testing.assert_allclose(table.stretch[inner], 0.9, atol=1e-3)
    np.testing.assert_allclose(table.bend[inner], 1.0 / 18.0, rtol=0.02)


def test_project_finds_the_chainage_of_points_off_the_line(table):
    for s in (5.0, 33.3, 77.7, 111.1):
        angle = s / RADIUS
        outward = np.array([np.sin(angle), -np.cos(angle), 0.0])
        point = table.point(s) + 0.4 * outward + [0.0, 0.0, 0.3]
        for near in (s - 3.0, s, s + 3.0):
            assert table.project(point, near) == pytest.approx(s, abs=0.01)


def test_follow_goes_round_with_the_points(table):
    s = np.arange(1.0, table.length, 1.5)
    found = table.follow(np.array([table.point(x) for x in s]), 0.0)
    np.testing.assert_allclose(found, s, atol=0.01)


def test_nearest_needs_no_hint_and_closed_lines_wrap(table):
    assert table.closed
    assert table.nearest(table.point(60.0)) == pytest.approx(60.0, abs=0.01)
    assert table.difference(1.0, table.length - 1.0) == pytest.approx(2.0)
    point = table.point(0.5)
    assert table.project(point, table.length - 1.0) == pytest.approx(0.5, abs=0.02)


def test_open_line_goes_on_straight_and_projects_inside():
    open_table = LineTable(Centreline.from_design_ride(circle_ride(laps=0.4)))
    assert not open_table.closed
    beyond = open_table.point(open_table.length + 1.0)
    at_end = open_table.point(open_table.length)
    assert np.linalg.norm(beyond - at_end) == pytest.approx(1.0, abs=0.05)
    assert open_table.project(beyond, open_table.length) == pytest.approx(open_table.length)

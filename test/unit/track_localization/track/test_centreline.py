"""The centreline against circles and helices whose geometry is known."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.track_file import TrackFile

RADIUS = 30.0
FIELDS = ('chainage', 'position', 'quaternion', 'velocity', 'specific_force', 'angular_rate')


def circle(count: int = 380, turns: float = 1.0, climb: float = 0.0) -> TrackFile:
    """Return a left-hand circle or helix that climbs ``climb`` metres a radian, heads level."""
    t = np.linspace(0.0, 2.0 * np.pi * turns, count, endpoint=False)
    position = np.stack([RADIUS * np.cos(t), RADIUS * np.sin(t), climb * t], axis=1)
    front = np.stack([-RADIUS * np.sin(t), RADIUS * np.cos(t), np.full(count, climb)], axis=1)
    front /= np.hypot(RADIUS, climb)
    left = np.stack([-np.cos(t), -np.sin(t), np.zeros(count)], axis=1)
    return TrackFile(position, front, left, np.cross(front, left))


def test_circle_closes_with_its_circumference():
    """A circuit is recognised; its length is exact to the spline's error; chainage wraps."""
    line = Centreline.from_track(circle())
    assert line.closed
    assert line.length == pytest.approx(2.0 * np.pi * RADIUS, abs=1e-5)
    np.testing.assert_allclose(line.position(0.0), [RADIUS, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(line.position(line.length + 7.0), line.position(7.0), atol=1e-9)
    np.testing.assert_allclose(line.position(-7.0), line.position(line.length - 7.0), atol=1e-9)


def test_repeated_last_point_is_the_same_circuit():
    """A file that ends on its first point is no different."""
    track = circle()
    parts = [np.vstack([p, p[:1]]) for p in (track.position, track.front, track.left, track.up)]
    assert Centreline.from_track(TrackFile(*parts)).length == pytest.approx(
        Centreline.from_track(track).length, abs=1e-9
    )


def test_curvature_of_a_circle_even_across_the_join():
    """1/R about the body's up axis, everywhere."""
    line = Centreline.from_track(circle())
    s = np.linspace(-5.0, line.length + 5.0, 3001)
    expected = np.broadcast_to([0.0, 0.0, 1.0 / RADIUS], (3001, 3))
    np.testing.assert_allclose(line.curvature(s), expected, atol=1e-6)


def test_helix_curvature_and_torsion():
    """A helix turns by R/(R^2+c^2) about its binormal; its level axes see torsion as roll."""
    climb = 4.0
    line = Centreline.from_track(circle(turns=1.5, climb=climb, count=600))
    assert not line.closed
    s = np.linspace(20.0, line.length - 20.0, 50)
    per_metre = 1.0 / np.hypot(RADIUS, climb)
    # the frame turns about the vertical only; seen in body axes that has a forward and an up part
    slope = np.arctan2(climb, RADIUS)
    expected = per_metre * np.array([np.sin(slope), 0.0, np.cos(slope)])
    np.testing.assert_allclose(line.curvature(s), np.broadcast_to(expected, (50, 3)), atol=1e-6)


def test_attitude_and_tangent_agree_with_the_circle():
    """Columns are forward, left, up; forward is the tangent."""
    line = Centreline.from_track(circle())
    s = np.array([0.0, 0.5 * np.pi * RADIUS])
    R = line.attitude(s)
    np.testing.assert_allclose(R[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(R[:, :, 0], line.tangent(s), atol=1e-6)
    assert line.attitude(3.0).shape == (3, 3)


def test_nearest_is_the_foot_of_the_perpendicular():
    """Points beside the circle come back to their own angle, whatever their distance."""
    line = Centreline.from_track(circle())
    rng = np.random.default_rng(3)
    angle, off = rng.uniform(0.0, 2.0 * np.pi, 200), rng.uniform(-8.0, 8.0, 200)
    p = np.stack(
        [(RADIUS + off) * np.cos(angle), (RADIUS + off) * np.sin(angle), rng.normal(size=200)],
        axis=1,
    )
    s = line.nearest(p)
    np.testing.assert_allclose(s, angle * RADIUS, atol=1e-4)
    hinted = line.nearest(p, near=angle * RADIUS + rng.uniform(-4.0, 4.0, 200), window=6.0)
    np.testing.assert_allclose(hinted, s, atol=1e-6)
    assert 0.0 <= float(line.nearest(np.array([RADIUS, -0.1, 0.0]))) < line.length


def test_nearest_near_a_hint_keeps_to_its_own_lap():
    """Where the line passes itself, the hint decides."""
    line = Centreline.from_track(circle(turns=2.5, climb=0.2, count=1000))
    lap = 2.0 * np.pi * np.hypot(RADIUS, 0.2)
    p = line.position(40.0)
    assert float(line.nearest(p, near=42.0)) == pytest.approx(40.0, abs=1e-6)
    assert float(line.nearest(p, near=lap + 38.0)) == pytest.approx(lap + 40.0, abs=0.1)


def test_open_line_goes_on_straight_beyond_its_ends():
    """Beyond an end, position follows the end's tangent."""
    line = Centreline.from_track(circle(turns=0.5))
    np.testing.assert_allclose(
        line.position(line.length + 3.0),
        line.position(line.length) + 3.0 * line.tangent(line.length),
        atol=1e-4,
    )


def ride_on_circle(turns: float, start: float = 12.0, speed: float = 9.0) -> DesignRide:
    t = np.arange(0.0, turns * 2.0 * np.pi * RADIUS / speed, 0.01)
    s = start + speed * t
    a = s / RADIUS
    zero, one = np.zeros_like(a), np.ones_like(a)
    yaw = a + np.pi / 2
    return DesignRide(
        time_s=t,
        chainage=s,
        position=RADIUS * np.stack([np.cos(a), np.sin(a), zero], axis=1),
        quaternion=np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1),
        velocity=speed * np.stack([-np.sin(a), np.cos(a), zero], axis=1),
        specific_force=np.stack([zero, one * speed**2 / RADIUS, 9.80665 * one], axis=1),
        angular_rate=np.stack([zero, zero, one * speed / RADIUS], axis=1),
    )


def test_line_of_a_design_ride_is_a_circuit_again():
    """A lap and a bit gives the whole circle, by the ride's own chainage."""
    line = Centreline.from_design_ride(ride_on_circle(1.1))
    assert line.closed
    assert line.length == pytest.approx(2.0 * np.pi * RADIUS, abs=2e-3)
    s = np.linspace(0.0, line.length, 200)
    expected = RADIUS * np.stack([np.cos(s / RADIUS), np.sin(s / RADIUS), 0 * s], axis=1)
    np.testing.assert_allclose(line.position(s), expected, atol=5e-3)


def test_line_of_a_part_ride_is_open_and_keeps_its_chainage():
    """Half a lap that starts at 12 m gives a line on which 12 m is where it started."""
    ride = ride_on_circle(0.5)
    line = Centreline.from_design_ride(ride)
    assert not line.closed
    np.testing.assert_allclose(line.position(12.0), ride.position[0], atol=1e-6)
    np.testing.assert_allclose(line.position(ride.chainage[500]), ride.position[500], atol=1e-4)


def test_line_of_a_shuttle_uses_its_longest_run_forward():
    """Rides that come back do not fold the line."""
    ride = ride_on_circle(0.5)
    order = np.concatenate([np.arange(300, 0, -1), np.arange(len(ride)), np.arange(900, 100, -1)])
    order = order[order < len(ride)]
    folded = DesignRide(
        time_s=np.arange(len(order)) * 0.01,
        **{name: getattr(ride, name)[order] for name in FIELDS},
    )
    line = Centreline.from_design_ride(folded)
    np.testing.assert_allclose(line.position(ride.chainage[500]), ride.position[500], atol=1e-4)


def test_design_ride_that_stands_still_is_refused():
    """No line can be had from a standstill."""
    ride = ride_on_circle(0.5)
    still = DesignRide(
        ride.time_s,
        0.0 * ride.chainage,
        *(
            np.repeat(getattr(ride, n)[:1], len(ride), axis=0)
            for n in ('position', 'quaternion', 'velocity', 'specific_force', 'angular_rate')
        ),
    )
    with pytest.raises(DataError, match='advances less'):
        Centreline.from_design_ride(still)

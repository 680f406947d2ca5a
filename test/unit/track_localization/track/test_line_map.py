"""The tabulated line against circles, a helix and a clothoid, and a bead that Newton moves."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from track_localization.estimation import line_rows
from track_localization.track import line_map
from track_localization.track.centreline import Centreline
from track_localization.track.line_map import LineMap

G = 9.80665
RADIUS, CLIMB = 30.0, 4.0
SEAT = 1.1
SHARPENING = 4e-4
"""Curvature that the clothoid gains per metre [1/m^2]."""


def level_circle(s):
    """Left-hand circle in the plane: position (3,) and attitude (3, 3) at arc length s."""
    a = s / RADIUS
    front = [-np.sin(a), np.cos(a), 0.0]
    left = [-np.cos(a), -np.sin(a), 0.0]
    return RADIUS * np.array([np.cos(a), np.sin(a), 0.0]), np.array([front, left, [0, 0, 1]]).T


def helix(s):
    """Left-hand helix that climbs CLIMB metres a radian, heads level."""
    a = s / np.hypot(RADIUS, CLIMB)
    front = np.array([-RADIUS * np.sin(a), RADIUS * np.cos(a), CLIMB]) / np.hypot(RADIUS, CLIMB)
    left = np.array([-np.cos(a), -np.sin(a), 0.0])
    position = np.array([RADIUS * np.cos(a), RADIUS * np.sin(a), CLIMB * a])
    return position, np.column_stack([front, left, np.cross(front, left)])


def upright(slope):
    """Attitude of a body that pitches up by ``slope`` in the x-z plane."""
    c, n = np.cos(slope), np.sin(slope)
    return np.array([[c, 0.0, -n], [0.0, 1.0, 0.0], [n, 0.0, c]])


def loop(s):
    """Vertical circle of the track, entered at its foot; the seat is SEAT inside of it."""
    a = s / RADIUS
    radius = RADIUS - SEAT
    return np.array([radius * np.sin(a), 0.0, RADIUS - radius * np.cos(a)]), upright(a)


def clothoid(s):
    """Vertical clothoid of the track, curvature SHARPENING * s; the seat SEAT above it."""
    scale = 0.5 * SHARPENING
    x, z = (quad(lambda u, f=f: f(scale * u * u), 0.0, s)[0] for f in (np.cos, np.sin))
    R = upright(scale * s * s)
    return np.array([x, 0.0, z]) + SEAT * R[:, 2], R


LINES = {
    'circle': (level_circle, 2.0 * np.pi * RADIUS, True),
    'helix': (helix, 250.0, False),
    'loop': (loop, 2.0 * np.pi * RADIUS, True),
    'clothoid': (clothoid, 90.0, False),
}


def make(name, step_m=0.1):
    curve, length, closed = LINES[name]
    s = np.linspace(0.0, length, round(length / 0.25) + 1)
    if closed:
        s = s[:-1]
    position, attitude = (np.array(part) for part in zip(*map(curve, s), strict=True))
    return LineMap(Centreline(s, position, attitude, closed, length), 0.004, step_m)


@pytest.fixture(scope='module')
def maps():
    return {name: make(name) for name in LINES}


def column(table, which):
    """Rows of one column, without the ends of an open line, where a spline's bend is free."""
    inner = slice(None) if table.closed else slice(30, -30)
    return table.rows[inner, which], table.chainage[inner]


def test_rows_are_even_and_reach_both_ends(maps):
    for name, (_, length, closed) in LINES.items():
        table = maps[name]
        assert table.rows.shape == (len(table.chainage), line_map.WIDTH)
        assert table.position.shape == (len(table.chainage), 3)
        assert (table.length, table.closed) == (length, closed)
        assert 0.09 < table.step_m <= 0.1
        np.testing.assert_allclose(np.diff(table.chainage), table.step_m, atol=1e-9)
        assert table.chainage[-1] == length


@pytest.mark.parametrize('name', list(LINES))
def test_position_and_attitude_between_the_rows(maps, name):
    """At chainages that are no rows' the attitude is the curve's to a tenth of a milliradian."""
    table, (curve, length, _) = maps[name], LINES[name]
    for s in np.random.default_rng(2).uniform(0.0, length, 60):
        got = line_rows.attitude_at(table.rows, table.step_m, table.closed, s)
        off = Rotation.from_matrix(curve(s)[1].T @ got).magnitude()
        assert off < 1e-5, s
    expected = np.array([curve(s)[0] for s in table.chainage[::50]])
    np.testing.assert_allclose(table.position[::50], expected, atol=1e-5)


@pytest.mark.parametrize(
    ('name', 'turning', 'climb', 'stretch', 'lever'),
    [
        ('circle', lambda _: [0, 0, 1 / RADIUS], lambda _: 0.0, lambda _: 1.0, 0.0),
        (
            'helix',
            lambda _: np.array([CLIMB, 0.0, RADIUS]) / (RADIUS**2 + CLIMB**2),
            lambda _: G * CLIMB / np.hypot(RADIUS, CLIMB),
            lambda _: 1.0,
            0.0,
        ),
        (
            'loop',
            lambda _: [0, -1 / RADIUS, 0],
            lambda s: G * np.sin(s / RADIUS),
            lambda _: (RADIUS - SEAT) / RADIUS,
            0.0,
        ),
        (
            'clothoid',
            lambda s: [0, -SHARPENING * s, 0],
            lambda s: G * np.sin(0.5 * SHARPENING * s * s),
            lambda s: 1.0 - SEAT * SHARPENING * s,
            -SEAT * SHARPENING,
        ),
    ],
)
def test_columns_of_known_curves(maps, name, turning, climb, stretch, lever):
    """Turning, gravity along the line, metres of path per metre of chainage and how they grow."""
    table = maps[name]
    got, s = column(table, line_map.TURNING)
    np.testing.assert_allclose(got, np.array([turning(x) for x in s]), atol=2e-6)
    got, _ = column(table, line_map.CLIMB)
    np.testing.assert_allclose(got, np.array([climb(x) for x in s]), atol=2e-5)
    got, _ = column(table, line_map.STRETCH)
    np.testing.assert_allclose(got, np.array([stretch(x) for x in s]), atol=2e-6)
    got, _ = column(table, line_map.LEVER)
    np.testing.assert_allclose(got, lever, atol=1e-5)
    got, _ = column(table, line_map.TANGENT)
    np.testing.assert_allclose(got, np.broadcast_to([1.0, 0.0, 0.0], got.shape), atol=2e-6)


def test_what_is_not_known_yet_says_so(maps):
    table = maps['helix']
    assert np.isnan(table.rows[:, [line_map.SPEED, line_map.SPEED_SIGMA]]).all()
    assert (table.rows[:, line_map.SIGMA] == 0.004).all()
    assert (table.rows[:, line_map.RENEWAL] == 0.0).all()


def test_set_speed_fills_its_columns():
    table = make('circle', 1.0)
    speed, sigma, renewal = np.random.default_rng(0).uniform(1.0, 2.0, (3, len(table.rows)))
    table.set_speed(speed, sigma, renewal)
    got = table.rows[:, [line_map.SPEED, line_map.SPEED_SIGMA, line_map.RENEWAL]].T
    np.testing.assert_array_equal(got, [speed, sigma, renewal])


def test_laps_of_a_circuit_are_the_same_line(maps):
    table = maps['circle']
    for s in (0.0, 0.03, 57.21, table.length - 0.02):
        i, share = line_rows.row_of(table.rows, table.step_m, True, s)
        assert (i + share) * table.step_m == pytest.approx(s, abs=1e-9)
        for laps in (-2, -1, 1, 7):
            there = s + laps * table.length
            R = line_rows.attitude_at(table.rows, table.step_m, True, there)
            np.testing.assert_allclose(R, level_circle(s)[1], atol=1e-6)


def test_ends_of_an_open_line_hold(maps):
    """Beyond an end the vehicle has the end's attitude and row."""
    table = maps['helix']
    for s, end in ((-3.0, 0.0), (-1e6, 0.0), (table.length + 3.0, table.length), (1e7, 250.0)):
        i, share = line_rows.row_of(table.rows, table.step_m, False, s)
        assert 0 <= i < len(table.rows) - 1
        assert (i + share) * table.step_m == pytest.approx(end, abs=1e-9)
        R = line_rows.attitude_at(table.rows, table.step_m, False, s)
        np.testing.assert_allclose(R, helix(end)[1], atol=1e-5)


@pytest.mark.parametrize('name', list(LINES))
def test_bead_on_a_line_obeys_newton(maps, name):
    """
    A bead moves along the curve as prescribed; its specific force gives its s'' back.

    The force is the second time derivative of the analytic position plus gravity, nothing of the
    table is in it. 2e-3 m/s^2 leaves room for the numeric derivative and the rows' spacing.
    """
    table, (curve, length, _) = maps[name], LINES[name]

    def chainage(t):
        return 0.5 * length + 9.0 * t + 4.0 * np.sin(1.7 * t)

    h = 2e-3
    for t in np.linspace(-2.0, 2.0, 25):
        p = [curve(chainage(t + k * h))[0] for k in (-2, -1, 0, 1, 2)]
        pull = (-p[0] + 16 * p[1] - 30 * p[2] + 16 * p[3] - p[4]) / (12 * h * h)
        f = curve(chainage(t))[1].T @ (pull + np.array([0.0, 0.0, G]))
        v = 9.0 + 4.0 * 1.7 * np.cos(1.7 * t)
        expected = -4.0 * 1.7**2 * np.sin(1.7 * t)
        got = line_rows.acceleration(table.rows, table.step_m, table.closed, chainage(t), v, *f)
        assert got == pytest.approx(expected, abs=2e-3), t


def glide(table, s, v, dt, steps):
    """Chainage and rate (steps, 2) of a bead that only gravity pulls along the line (RK4)."""
    args = (table.rows, table.step_m, table.closed)

    def slope(y):
        return np.array([y[1], line_rows.acceleration(*args, y[0], y[1], 0.0, 0.0, 0.0)])

    y, out = np.array([s, v]), []
    for _ in range(steps):
        a = slope(y)
        b = slope(y + 0.5 * dt * a)
        c = slope(y + 0.5 * dt * b)
        d = slope(y + dt * c)
        y = y + dt / 6.0 * (a + 2 * b + 2 * c + d)
        out.append(y)
    return np.array(out)


def test_bead_swings_in_the_loop_like_a_pendulum_of_the_seats_radius(maps):
    """The period is that of a pendulum as long as the seat's radius, not the track's."""
    table, dt = maps['loop'], 0.01
    path = glide(table, 0.3, 0.0, dt, 3000)
    crossings = np.flatnonzero((path[1:, 0] > 0.0) & (path[:-1, 0] <= 0.0))
    share = -path[crossings, 0] / (path[crossings + 1, 0] - path[crossings, 0])
    period = np.diff((crossings + share) * dt).mean()
    assert period == pytest.approx(2.0 * np.pi * np.sqrt((RADIUS - SEAT) / G), rel=1e-4)


@pytest.mark.parametrize('name', ['loop', 'clothoid', 'helix'])
def test_energy_is_kept(maps, name):
    """Half the square of the seat's speed plus its height: the lever is in it, the bend too."""
    table, curve = maps[name], LINES[name][0]
    path = glide(table, 20.0, 26.0, 0.005, 400)[::40]
    energy = []
    for s, v in path:
        stretch = np.linalg.norm(curve(s + 1e-4)[0] - curve(s - 1e-4)[0]) / 2e-4
        energy.append(0.5 * (stretch * v) ** 2 + G * curve(s)[0][2])
    # Of 340 J/kg; without the lever the clothoid loses 2.
    np.testing.assert_allclose(energy, energy[0], atol=0.02)


def test_corrected_attitude_turns_as_its_correction_says():
    """R and its turning: attitudes between two rows lead to the next, also where corrected."""
    table = make('helix')
    s = table.chainage
    correction = 0.01 * np.stack([np.sin(s / 9.0), np.cos(s / 7.0), np.sin(s / 11.0)], axis=1)
    table.turn(correction)
    for i in range(100, 1500, 100):
        R = helix(s[i])[1] @ Rotation.from_rotvec(correction[i]).as_matrix()
        got = line_rows.attitude_at(table.rows, table.step_m, False, float(s[i]))
        np.testing.assert_allclose(got, R, atol=1e-5)
        near = line_rows.attitude_at(table.rows, table.step_m, False, s[i] + 0.999 * table.step_m)
        step = Rotation.from_matrix(near.T @ helix(s[i + 1])[1]).as_matrix()
        step = step @ Rotation.from_rotvec(correction[i + 1]).as_matrix()
        # What is missed is of second order in the correction: 1e-5 over a row.
        assert Rotation.from_matrix(step).magnitude() < 1.2e-5


def test_standing_vehicle_stays_where_the_attitude_was_corrected():
    """At rest the accelerometer shows gravity in the corrected attitude: nothing pulls along."""
    table = make('helix')
    table.turn(np.full((len(table.rows), 3), [0.004, 0.01, -0.006]))
    R = line_rows.attitude_at(table.rows, table.step_m, False, 80.0)
    pull = line_rows.acceleration(
        table.rows, table.step_m, False, 80.0, 0.0, *(R.T @ [0.0, 0.0, G])
    )
    assert abs(pull) < 1e-4

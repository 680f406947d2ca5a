"""Track elements: what they change, how smoothly, and how they close."""

import numpy as np
import pytest

from track_localization.sim.coaster.elements import (
    corkscrew,
    grade,
    hill,
    loop,
    profile,
    roll_hill,
    straight,
    turn,
)
from track_localization.sim.coaster.layout import Layout, attitude, close, lay

ELEMENTS = {
    'straight': (straight(20.0), 0.0, 0.0),
    'turn': (turn(90.0, 12.0), 90.0, 0.0),
    'rising turn': (turn(-120.0, 12.0, 3.0), -120.0, 3.0),
    'lift': (grade(20.0, 30.0, 12.0, 10.0), 0.0, 20.0),
    'drop': (grade(-25.0, 50.0, 12.0, 20.0), 0.0, -25.0),
    'hill': (hill(9.0, 28.0, 20.0, 18.0), 0.0, 0.0),
    'hills': (
        profile([(0, 14), (-20, 18), (-8, 12), (-19, 15), (-3, 14)], [45, 32, 31, 33]),
        0.0,
        -3.0,
    ),
    'loop': (loop(20.0, 8.0, 3.0), 0.0, 0.0),
    'corkscrew': (corkscrew(33.0, 58.0, 1), 0.0, 0.0),
    'zero-g roll': (roll_hill(16.0, 31.0, 26.0, 29.0, -1), 0.0, 0.0),
}


def run_up(elements) -> Layout:
    return lay([*straight(10.0), *elements, *straight(10.0)])


@pytest.mark.parametrize('name', ELEMENTS)
def test_heading_and_height_gained(name):
    """Each element turns and climbs as much as it says, and ends level and upright."""
    elements, heading, rise = ELEMENTS[name]
    at = run_up(elements)
    R = attitude(at.heading, at.slope, at.roll)[-1]
    psi = np.radians(heading)
    expected = [[np.cos(psi), -np.sin(psi), 0], [np.sin(psi), np.cos(psi), 0], [0, 0, 1]]
    np.testing.assert_allclose(R, expected, atol=1e-6)
    assert at.position[-1, 2] == pytest.approx(rise, abs=2e-3)


@pytest.mark.parametrize('name', ELEMENTS)
def test_curvature_and_roll_rate_are_continuous(name):
    """No kinks: over 0.1 m, curvature changes by what 3 m transitions allow and no more."""
    at = run_up(ELEMENTS[name][0])
    R = attitude(at.heading, at.slope, at.roll)
    step = at.s[1]
    turned = np.swapaxes(R[:-1], 1, 2) @ R[1:]
    k = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1) / step
    assert np.abs(np.diff(k, axis=0)).max() < 0.2 * step
    assert np.abs(k[[0, -1]]).max() < 1e-6


def test_tightest_radius_is_the_one_asked_for():
    """A turn's curvature peaks at 1/radius; a loop's at its top."""
    at = run_up(turn(90.0, 12.0))
    assert np.gradient(at.heading, at.s).max() == pytest.approx(1 / 12.0, rel=2e-3)
    at = run_up(loop(20.0, 8.0, 0.0))
    peak = np.argmax(np.gradient(at.slope, at.s))
    assert np.gradient(at.slope, at.s)[peak] == pytest.approx(1 / 8.0, rel=2e-3)
    assert at.slope[peak] == pytest.approx(np.pi, abs=0.02)


def test_loop_goes_over_the_top_and_aside():
    """It is taller than its top diameter and leaves beside where it came in."""
    at = run_up(loop(20.0, 8.0, 3.0))
    assert 16.0 < at.position[:, 2].max() < 32.0
    assert at.position[-1, 1] == pytest.approx(3.0, abs=0.05)


def test_levels_are_reached():
    """Crests and valleys of a profile lie at the heights given."""
    at = run_up(ELEMENTS['hills'][0])
    z = at.position[:, 2]
    turning = np.flatnonzero(np.diff(np.sign(np.diff(z))) != 0) + 1
    inner = [h for h in z[turning] if not np.isclose(h, [0.0, -3.0], atol=1e-3).any()]
    np.testing.assert_allclose(inner, [-20.0, -8.0, -19.0], atol=5e-3)


def test_impossible_hill_is_refused():
    """Bends that alone are higher than the hill raise, by name."""
    with pytest.raises(ValueError, match='camel: 5'):
        hill(5.0, 60.0, 20.0, 20.0, 'camel')


def test_closing_finds_the_lengths():
    """A rectangle of turns closes when the two free sides equal their opposites."""

    def build(x):
        corner = turn(90.0, 10.0)
        return [
            *straight(50.0),
            *corner,
            *straight(30.0),
            *corner,
            *straight(x[0]),
            *corner,
            *straight(x[1]),
            *corner,
        ]

    at = close(build, np.array([10.0, 60.0]))
    np.testing.assert_allclose(at.position[-1], at.position[0], atol=1e-9)
    quarter = turn(90.0, 10.0)[0].length
    assert at.length == pytest.approx(2 * 50.0 + 2 * 30.0 + 4 * quarter, abs=1e-6)


def test_circuit_that_does_not_come_round_is_refused():
    """Heights that do not add up are a mistake of the design."""
    with pytest.raises(ValueError, match='does not close'):
        close(lambda x: [*straight(5.0 + x[0]), *grade(9.0, 20.0, 9.0, 9.0)], np.zeros(2))

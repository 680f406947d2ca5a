"""The line as set out: curves, transitions, slopes and cant."""

import numpy as np
import pytest

from track_localization.sim.train.alignment import set_out
from track_localization.sim.train.config import Line

SPEED = 60.0


def lines(**changes):
    return [set_out(np.random.default_rng(i), Line(**changes), 40e3, SPEED) for i in range(20)]


@pytest.mark.parametrize('line', lines()[:5])
def test_rates_are_the_slopes_of_the_angles(line):
    """Central differences over 2 cm; where a transition ends they miss 1e-7 of 5e-4 rad/m."""
    s, h = np.linspace(10.0, 39990.0, 4001), 0.01
    before, after, here = line.at(s - h), line.at(s + h), line.at(s)
    for angle, rate in (
        ('course', 'course_rate'),
        ('slope', 'slope_rate'),
        ('cant', 'cant_rate'),
    ):
        difference = (getattr(after, angle) - getattr(before, angle)) / (2.0 * h)
        np.testing.assert_allclose(getattr(here, rate), difference, atol=1e-7)


def test_curvature_is_continuous_and_within_its_radii():
    """Every curve reaches a radius of 2.2 to 6 km, by a transition of 250 m or more."""
    s = np.arange(0.0, 40e3, 1.0)
    tightest = []
    for line in lines():
        k = line.at(s).course_rate
        assert np.abs(k).max() <= 1.0 / 2200.0 + 1e-12
        assert np.abs(np.diff(k)).max() < 1.5 / 2200.0 / 250.0 * 1.001  # Bloss's steepest
        for begin, end in line.curve:
            inside = np.abs(k[(s >= begin) & (s <= end)])
            assert 2200.0 - 1e-6 <= 1.0 / inside.max() <= 6000.0 * 1.001
            tightest.append(inside.max())
    assert len(tightest) > 150
    assert 1.0 / np.max(tightest) < 2300.0
    assert 1.0 / np.min(tightest) > 5500.0


def test_cant_leans_into_the_curve_and_follows_it():
    """
    To the left in a left curve (roll negative), as share of the balance, 6 deg at most.

    The balance is where gravity and the centrifugal force meet in the floor: tan = v^2 / g R.
    """
    s = np.arange(0.0, 40e3, 5.0)
    for line in lines():
        angles = line.at(s)
        straight = angles.course_rate == 0.0
        assert straight.any()
        np.testing.assert_allclose(angles.cant[straight], 0.0, atol=1e-12)
        assert (angles.cant * angles.course_rate <= 1e-12).all()
        balance = np.arctan(SPEED**2 * np.abs(line.curvature) / 9.80665)
        wanted = np.minimum(0.7 * balance, np.radians(6.0))
        np.testing.assert_allclose(np.abs(line.cant), wanted)
        assert np.degrees(wanted).max() > 5.0
        share = angles.cant[~straight] / angles.course_rate[~straight]
        assert np.unique(np.round(share, 3)).size <= len(line.curve)


def test_slopes_reach_their_limit_and_bend_gently():
    """2.5 % either way; vertical curves of 20 km or more."""
    s = np.arange(0.0, 40e3, 5.0)
    slopes = np.array([np.tan(line.at(s).slope) for line in lines()])
    bends = np.array([line.at(s).slope_rate for line in lines()])
    assert slopes.max() == pytest.approx(0.025, abs=0.001)
    assert slopes.min() == pytest.approx(-0.025, abs=0.001)
    assert np.abs(slopes).max() <= 0.025 + 1e-12
    assert np.abs(bends).max() <= 1.0 / 20000.0 + 1e-12


def test_the_line_keeps_its_direction():
    """It turns back after 50 deg; a last curve of 30 deg and its transitions may be on top."""
    for line in lines():
        off = np.abs(line.at(np.arange(0.0, 40e3, 50.0)).course - line.course)
        assert np.degrees(off.max()) < 50.0 + 35.0


def test_courses_begin_within_their_range():
    starts = np.degrees([line.course for line in lines(course_deg=(20.0, 40.0))])
    assert starts.min() >= 20.0
    assert starts.max() <= 40.0
    assert np.ptp(starts) > 10.0


def test_a_line_too_short_for_a_curve_is_straight():
    line = set_out(np.random.default_rng(1), Line(), 300.0, SPEED)
    angles = line.at(np.linspace(0.0, 300.0, 50))
    assert (angles.course == angles.course[0]).all()
    assert (angles.cant == 0.0).all()

"""How uneven the simulated rails are."""

import numpy as np
import pytest

from track_localization.sim.train.alignment import Angles
from track_localization.sim.train.config import Rails
from track_localization.sim.train.waves import draw_waves


def level(s):
    return Angles(*(np.zeros_like(s) for _ in range(6)))


def test_rails_deviate_by_as_much_as_is_set():
    """Sideways and upward the angle's integral, the cant times the gauge; over 60 lines."""
    s = np.arange(0.0, 4000.0, 1.0)
    config = Rails(aside_m=0.002, above_m=0.001, cross_m=0.0005)
    power = []
    for seed in range(60):
        at = draw_waves(np.random.default_rng(seed), config).on(level(s), s)
        heights = np.cumsum(at.course), np.cumsum(at.slope), at.cant * config.gauge_m
        power.append([np.var(h) for h in heights])
    expected = [config.aside_m, config.above_m, config.cross_m]
    assert np.sqrt(np.mean(power, axis=0)) == pytest.approx(expected, rel=0.05)


def test_rates_are_the_slopes_of_the_angles():
    s, h = np.linspace(0.0, 1000.0, 501), 0.01
    waves = draw_waves(np.random.default_rng(1), Rails())
    before, here, after = (waves.on(level(s), s + step) for step in (-h, 0.0, h))
    for angle in ('course', 'slope', 'cant'):
        difference = (getattr(after, angle) - getattr(before, angle)) / (2.0 * h)
        np.testing.assert_allclose(getattr(here, f'{angle}_rate'), difference, atol=1e-9)


def test_waves_have_the_lengths_that_are_set():
    number = draw_waves(np.random.default_rng(2), Rails(wave_m=(30.0, 60.0))).number
    assert (2.0 * np.pi / number).min() >= 30.0
    assert (2.0 * np.pi / number).max() <= 60.0

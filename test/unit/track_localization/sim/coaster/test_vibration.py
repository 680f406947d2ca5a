"""Vibration: as strong as asked for, growing with speed, with its resonances."""

import numpy as np
import pytest
from scipy.signal import welch

from track_localization.sim.coaster.vibration import vibrate


def at_speed(speed: float, seconds: float = 400.0, rate: float = 100.0, seed: int = 2, rms=1.5):
    t = np.arange(0.0, seconds, 1.0 / rate)
    v = np.full(len(t), speed)
    return vibrate(np.random.default_rng(seed), v, speed * t, rate, rms, (7.0, 14.0), 8.0, 1.6)


@pytest.mark.parametrize('speed', [5.0, 10.0, 20.0, 30.0])
def test_rms_grows_with_speed(speed):
    """On each axis rms = 1.5 m/s^2 at 20 m/s, in proportion to speed."""
    rms = at_speed(speed).std(axis=0)
    np.testing.assert_allclose(rms, 1.5 * speed / 20.0, rtol=0.12)


def test_standing_train_is_quiet():
    """No motion, no vibration."""
    assert not at_speed(0.0, 10.0).any()


def test_spectrum_has_a_white_floor_a_resonance_and_the_joints_ring():
    """
    The power at 18 Hz and in 7-14 Hz stands above the white floor at 35-45 Hz.

    At 28 m/s both bogies' hits ring in step; the wheelbase filters them at other speeds.
    """
    for axis in range(3):
        frequency, power = welch(at_speed(28.0)[:, axis], 100.0, nperseg=1024)
        floor = np.median(power[(frequency > 35.0) & (frequency < 45.0)])
        band = power[(frequency > 6.5) & (frequency < 14.5)]
        assert band.max() > 5.0 * floor
        assert (
            6.5
            < frequency[(frequency > 5) & (frequency < 16)][
                np.argmax(power[(frequency > 5) & (frequency < 16)])
            ]
            < 14.5
        )
        ring = power[np.argmin(np.abs(frequency - 18.0))]
        assert ring > 2.0 * floor
        # the white part alone has a third of the power
        assert floor * 50.0 == pytest.approx((1.5 * 1.4) ** 2 / 3.0, rel=0.5)

"""Order in which the sensors reach the filter."""

from __future__ import annotations

import numpy as np
import pytest

from track_localization.estimation.imu import ImuSample
from train_localization.config import GnssConfig
from train_localization.gathering import Gathering
from train_localization.measurements import GnssFix, GnssQuality, WheelSpeed
from train_localization.state import Fix, Stretch


def sample(time_s):
    return ImuSample(time_s, np.full(3, time_s), np.zeros(3))


def fix(time_s, covariance=None):
    return GnssFix(time_s, 0.7, 2.0, 0.0, np.eye(3) if covariance is None else covariance)


def feed(gathering, *heard):
    out = []
    for measurement in heard:
        if isinstance(measurement, ImuSample):
            gathering.imu(measurement)
        elif isinstance(measurement, GnssQuality):
            gathering.quality(measurement)
        else:
            gathering.wait(measurement)
        out += gathering.due()
    return out


@pytest.fixture
def gathering():
    return Gathering(GnssConfig(), 0.1)


def test_samples_come_in_stretches_and_none_is_lost(gathering):
    """In time steps of 10 ms an epoch of 0.1 s holds ten, the first one the sample at its start."""
    out = feed(gathering, *(sample(0.01 * k) for k in range(101)))
    assert all(isinstance(s, Stretch) for s in out)
    stamps = np.concatenate([s.stamps for s in out])
    np.testing.assert_allclose(stamps, 0.01 * np.arange(101))
    assert max(len(s.stamps) for s in out) == 11


def test_a_speed_waits_for_the_samples_before_it(gathering):
    before = feed(gathering, *(sample(0.01 * k) for k in range(4)), WheelSpeed(0.055, 5.0, 0.1))
    assert before == []
    out = feed(gathering, *(sample(0.01 * k) for k in range(4, 7)))
    assert [type(x) for x in out] == [Stretch, WheelSpeed]
    assert out[0].time_s == pytest.approx(0.05)


def test_a_late_speed_comes_at_once(gathering):
    feed(gathering, *(sample(0.01 * k) for k in range(12)))
    assert [type(x) for x in feed(gathering, WheelSpeed(0.03, 5.0, 0.1))] == [WheelSpeed]


def test_an_odometer_whose_clock_is_behind_waits_for_the_time_it_means():
    gathering = Gathering(GnssConfig(), 0.1, ahead_s=0.45)
    before = feed(gathering, WheelSpeed(0.0, 5.0, 0.1), *(sample(0.01 * k) for k in range(45)))
    assert all(isinstance(x, Stretch) for x in before)
    speeds = [x for x in feed(gathering, sample(0.46)) if isinstance(x, WheelSpeed)]
    assert [s.time_s for s in speeds] == [pytest.approx(0.45)]


@pytest.mark.parametrize(
    ('satellites', 'hdop', 'axes'),
    [(8, 1.0, 3), (4, 4.9, 3), (3, 1.0, 2), (2, 1.0, 0), (8, 9.0, 0), (8, np.nan, 3)],
)
def test_the_switch_by_satellites_and_hdop(gathering, satellites, hdop, axes):
    """Section 1.1 of the paper; an HDOP that is not told is no reason to refuse."""
    quality = GnssQuality(0.02, satellites, hdop)
    out = feed(gathering, quality, fix(0.02), *(sample(0.01 * k) for k in range(5)))
    assert [x.axes for x in out if isinstance(x, Fix)] == [axes]


def test_a_fix_waits_for_its_quality_where_qualities_are_told(gathering):
    feed(gathering, GnssQuality(0.0, 8, 1.0), sample(0.0))
    out = feed(gathering, fix(1.0), *(sample(0.01 * k) for k in range(1, 121)))
    assert not [x for x in out if isinstance(x, Fix)]
    found = [x for x in feed(gathering, GnssQuality(1.0, 3, 1.0)) if isinstance(x, Fix)]
    assert [x.axes for x in found] == [2]


def test_a_fix_whose_quality_never_comes_is_used_in_the_end(gathering):
    feed(gathering, GnssQuality(0.0, 8, 1.0), sample(0.0))
    out = feed(gathering, fix(1.0), *(sample(0.01 * k) for k in range(1, 180)))
    assert [x.axes for x in out if isinstance(x, Fix)] == [3]


@pytest.mark.parametrize('covariance', [np.zeros((3, 3)), np.full((3, 3), np.nan)])
@pytest.mark.parametrize(('hdop', 'sigma_m'), [(None, 1.5), (np.nan, 1.5), (0.8, 1.5), (2.0, 3.0)])
def test_a_covariance_that_is_not_told_is_assumed(gathering, covariance, hdop, sigma_m):
    told = [] if hdop is None else [GnssQuality(0.02, 9, hdop)]
    out = feed(gathering, *told, fix(0.02, covariance), *(sample(0.01 * k) for k in range(5)))
    (found,) = [x for x in out if isinstance(x, Fix)]
    np.testing.assert_allclose(found.gnss.covariance, sigma_m**2 * np.eye(3))

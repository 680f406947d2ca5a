"""The run: exact, within its limits, as long and as far as asked for."""

import numpy as np
import pytest

from track_localization.sim.train.config import Running
from track_localization.sim.train.motion import plan_motion


def plan(seed=1, **changes):
    return plan_motion(np.random.default_rng(seed), Running(**changes))


@pytest.mark.parametrize('profile', ['stops', 'underway'])
def test_speed_and_acceleration_are_slopes_of_the_way(profile):
    """Central differences over 2 ms."""
    motion = plan(profile=profile)
    t, h = np.linspace(0.01, motion.duration_s - 0.01, 5001), 1e-3
    before, after, here = motion.at(t - h), motion.at(t + h), motion.at(t)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), here[1], atol=1e-6)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), here[2], atol=1e-3)


@pytest.mark.parametrize('seed', range(10))
def test_acceleration_and_jerk_keep_their_limits(seed):
    """0.6 in starting, 0.7 in braking, 0.3 m/s^3; and the train does reach them."""
    motion = plan(seed)
    t = np.arange(0.0, motion.duration_s, 0.01)
    _, speed, acceleration = motion.at(t)
    assert acceleration.max() == pytest.approx(0.6, abs=1e-4)
    assert acceleration.min() == pytest.approx(-0.7, abs=1e-4)
    assert np.abs(np.diff(acceleration)).max() / 0.01 <= 0.3 * 1.001
    assert speed.min() >= 0.0
    assert 50.0 <= speed.max() <= 65.0


def test_standstills():
    """A minute before the first departure, 30 to 60 s at stations, 20 s at the end."""
    motion = plan(3, legs=4)
    t = np.arange(0.0, motion.duration_s, 0.1)
    standing = np.concatenate([[0], (motion.at(t)[1] == 0.0).astype(int), [0]])
    begin, end = np.flatnonzero(np.diff(standing) == 1), np.flatnonzero(np.diff(standing) == -1)
    length = 0.1 * (end - begin)
    assert len(length) == 5
    assert begin[0] == 0
    assert length[0] == pytest.approx(60.0, abs=0.2)
    assert (length[1:-1] > 29.8).all()
    assert (length[1:-1] < 60.2).all()
    assert length[-1] == pytest.approx(20.0, abs=0.2)
    ways = motion.at(0.1 * begin)[0]
    assert ((np.diff(ways) > 9e3) & (np.diff(ways) < 13e3)).all()


@pytest.mark.parametrize('length', [60.0, 500.0, 3000.0])
def test_short_legs_are_run_more_slowly(length):
    """They end where they should; the limits hold."""
    motion = plan(2, leg_m=(length, length), legs=1)
    t = np.arange(0.0, motion.duration_s, 0.01)
    _, speed, acceleration = motion.at(t)
    assert motion.distance_m == pytest.approx(length, abs=1e-6)
    assert speed.max() < 50.0
    assert acceleration.max() <= 0.6 + 1e-9
    assert acceleration.min() >= -0.7 - 1e-9
    assert np.abs(np.diff(acceleration)).max() / 0.01 <= 0.3 * 1.001


@pytest.mark.parametrize('seed', range(5))
def test_underway(seed):
    """The paper's 11 km in 200 s, at 10 % about 55 m/s."""
    motion = plan(seed, profile='underway')
    assert motion.duration_s == 200.0
    assert motion.distance_m == pytest.approx(11e3, abs=1e-6)
    speed = motion.at(np.linspace(0.0, 200.0, 2001))[1]
    assert 44.0 < speed.min() < speed.max() < 68.0
    assert np.ptp(speed) > 1.0


def test_passing_times():
    """When the way is covered, first; NaN for what is not reached."""
    motion = plan()
    ways = np.array([1.0, 500.0, motion.distance_m - 1.0, -1.0, motion.distance_m + 1.0])
    times = motion.passing_times(ways)
    np.testing.assert_allclose(motion.at(times[:3])[0], ways[:3], atol=1e-6)
    assert np.isnan(times[3:]).all()

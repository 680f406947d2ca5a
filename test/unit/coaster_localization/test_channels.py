"""Channels: the same formulas for both rides, no delay, exact grid."""

import numpy as np
import pytest

from coaster_localization import channels
from coaster_localization.sensed import Motion
from track_localization.errors import DataError
from track_localization.estimation import so3


def motion(time_s, force=None, rate=None, R_nb=None, rest=(0.0, 0.0)):
    n = len(time_s)
    force = np.tile([0.0, 0.0, 9.81], (n, 1)) if force is None else force
    rate = np.zeros((n, 3)) if rate is None else rate
    R_nb = np.tile(np.eye(3), (n, 1, 1)) if R_nb is None else R_nb
    start, end = time_s[0] + rest[0], time_s[-1] - rest[1]
    held = (time_s < start) | (time_s > end)
    return Motion(time_s, force, rate, R_nb, held, start, end, (rest[0] > 0, rest[1] > 0))


def bump(t):
    """A smooth signal well below the low-pass."""
    return 3.0 * np.sin(2 * np.pi * 0.21 * t) + np.cos(2 * np.pi * 0.34 * t + 1.0)


@pytest.mark.parametrize('native_hz', [20.0, 73.0, 100.0, 1000.0])
def test_values_belong_to_the_grid_times(native_hz):
    """No delay of any kind: 5 ms would show as 0.02 of the signal."""
    rng = np.random.default_rng(1)
    t = 100.0 + np.arange(0.0, 60.0, 1.0 / native_hz)
    t = t + rng.uniform(-0.2, 0.2, len(t)) / native_hz
    force = np.zeros((len(t), 3))
    force[:, 2] = bump(t)
    grid = channels.sample_channels(motion(t, force), 'z', 50.0, 5.0, 0.0)
    inside = slice(200, -200)
    exact = channels.low_pass(bump(grid.time_s)[:, None], 50.0, 5.0)
    error = grid.values[inside, 0] - exact[inside, 0]
    late = error @ np.gradient(exact[:, 0], 0.02)[inside]
    late /= (np.gradient(exact[:, 0], 0.02)[inside] ** 2).sum()
    assert abs(late) < 5e-4
    assert np.abs(error).max() < (0.05 if native_hz < 50.0 else 0.01)
    np.testing.assert_allclose(np.diff(grid.time_s), 0.02, atol=1e-9)


def test_low_pass_has_no_phase():
    t = np.arange(3000) / 50.0
    slow = np.sin(2 * np.pi * 0.3 * t)
    fast = np.sin(2 * np.pi * 9.0 * t)
    smooth = channels.low_pass((slow + fast)[:, None], 50.0, 2.0)[:, 0]
    inside = slice(300, -300)
    assert np.abs(smooth - slow)[inside].max() < 5e-3
    np.testing.assert_allclose(channels.low_pass(np.full((90, 1), 4.2), 50.0, 1.0), 4.2, rtol=1e-12)


def test_rests_are_cut_to_what_is_kept():
    t = np.arange(0.0, 60.0, 0.01)
    grid = channels.sample_channels(motion(t, rest=(20.0, 10.0)), 'z', 50.0, 2.0, 1.5)
    assert grid.time_s[0] == pytest.approx(18.5, abs=0.011)
    assert grid.time_s[-1] == pytest.approx(51.49, abs=0.025)
    assert grid.standing[:70].all()
    assert not grid.standing[80:1500].any()
    assert grid.standing[-60:].all()


def test_a_loop_is_a_pitch_that_goes_on():
    """Yaw and roll stay where they are, though ZYX angles flip at the loop's sides."""
    angle = np.linspace(0.0, 2 * np.pi, 400)
    R = so3.matrix_from_rpy(0.0, 0.0, 0.7) @ so3.exp(np.stack([0 * angle, -angle, 0 * angle], -1))
    np.testing.assert_allclose(channels.euler_channel(R, 'pitch'), -angle, atol=1e-6)
    np.testing.assert_allclose(channels.euler_channel(R, 'yaw'), 0.7, atol=1e-5)
    np.testing.assert_allclose(channels.euler_channel(R, 'roll'), 0.0, atol=1e-5)


@pytest.mark.parametrize(('channel', 'axis'), [('yaw', 2), ('roll', 0)])
def test_turns_are_counted_on(channel, axis):
    angle = np.linspace(0.0, 6 * np.pi, 900)
    vectors = np.zeros((900, 3))
    vectors[:, axis] = angle
    np.testing.assert_allclose(channels.euler_channel(so3.exp(vectors), channel), angle, atol=1e-6)


def test_scaling_is_the_designs():
    rng = np.random.default_rng(0)
    design, measured = rng.normal(3.0, 2.0, (500, 1)), rng.normal(4.0, 1.0, (300, 1))
    a, b = channels.comparable(measured, design, 'z')
    assert b.mean() == pytest.approx(0.0, abs=1e-12)
    assert b.std() == pytest.approx(1.0)
    np.testing.assert_allclose(a * design.std() + design.mean(), measured)
    constant = channels.comparable(np.ones((5, 1)), np.ones((6, 1)), 'z')
    assert all(np.all(x == 0.0) for x in constant)


@pytest.mark.parametrize('heading', [-2.5, -0.05, 0.0, 0.4, 3.1])
def test_heading_of_the_mount_is_found(heading):
    rng = np.random.default_rng(3)
    design = rng.normal(size=(400, 4))
    c, s = np.cos(heading), np.sin(heading)
    back = np.array([[c, s], [-s, c]])
    measured = np.hstack([design[:, :2] @ back.T, design[:, 2:] @ back.T])
    measured += rng.normal(0, 0.1, measured.shape)
    assert channels.mount_heading(measured, design) == pytest.approx(heading, abs=0.02)


def test_heading_free_channels_do_not_know_the_heading():
    rng = np.random.default_rng(4)
    t = np.arange(300) / 50.0
    R = so3.exp(np.cumsum(rng.normal(0, 0.05, (300, 3)), axis=0))
    one = motion(t, rng.normal(size=(300, 3)), rng.normal(size=(300, 3)), R)
    other = one.turned(1.1)
    np.testing.assert_allclose(
        channels.channel_values(one, 'heading_free'),
        channels.channel_values(other, 'heading_free'),
        atol=1e-12,
    )
    assert (
        np.abs(
            channels.channel_values(one, 'multi') - channels.channel_values(other, 'multi')
        ).max()
        > 0.5
    )


def test_without_a_gyro_only_z_is_there():
    t = np.arange(0.0, 20.0, 0.01)
    none = motion(t, rate=np.full((len(t), 3), np.nan), R_nb=np.full((len(t), 3, 3), np.nan))
    assert len(channels.sample_channels(none, 'z', 50.0, 2.0, 1.0)) > 900
    for channel in ('pitch', 'multi'):
        with pytest.raises(DataError, match='no gyro'):
            channels.sample_channels(none, channel, 50.0, 2.0, 1.0)


def test_a_ride_of_nothing_is_named():
    with pytest.raises(DataError, match='nothing to match'):
        channels.sample_channels(motion(np.arange(5) / 50.0), 'z', 50.0, 2.0, 0.0)
    with pytest.raises(DataError, match='unknown channel'):
        channels.sample_channels(motion(np.arange(90) / 50.0), 'x', 50.0, 2.0, 0.0)

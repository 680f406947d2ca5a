"""IMU errors: their statistics are those of the settings."""

import dataclasses

import numpy as np
import pytest

from track_localization.settings import override
from track_localization.sim.imu_error import ImuErrors, corrupt, draw_mount, jitter

QUIET = override(
    ImuErrors(),
    {f'{s}_{e}': 0.0 for s in ('accel', 'gyro') for e in ('bias', 'walk', 'scale', 'noise')},
)
STILL = np.zeros((5000, 3))


def runs(count: int = 300, truth=STILL[:2], **change):
    errors = dataclasses.replace(QUIET, **change)
    return np.array(
        [np.stack(corrupt(np.random.default_rng(i), truth, truth, errors)) for i in range(count)]
    )


def test_noise():
    """White, per sample, of the settings' size."""
    force, rate = corrupt(
        np.random.default_rng(1),
        STILL,
        STILL,
        dataclasses.replace(QUIET, accel_noise=0.012, gyro_noise=0.0012),
    )
    assert force.std() == pytest.approx(0.012, rel=0.03)
    assert rate.std() == pytest.approx(0.0012, rel=0.03)
    assert abs(np.mean(force[1:] * force[:-1])) < 0.05 * 0.012**2


def test_bias_is_drawn_once_a_run():
    """Constant within a run, N(0, sigma) over runs."""
    out = runs(accel_bias=0.04, gyro_bias=0.004)
    assert np.ptp(out, axis=2).max() < 1e-15
    assert out[:, 0].std() == pytest.approx(0.04, rel=0.08)
    assert out[:, 1].std() == pytest.approx(0.004, rel=0.08)


def test_walk_grows_with_the_root_of_time():
    """After 50 s the spread is walk * sqrt(50)."""
    out = runs(150, STILL, accel_walk=0.002, gyro_walk=1e-4)
    assert out[:, 0, -1].std() == pytest.approx(0.002 * np.sqrt(50.0), rel=0.1)
    assert out[:, 1, -1].std() == pytest.approx(1e-4 * np.sqrt(50.0), rel=0.1)


def test_scale():
    """A factor on each axis."""
    out = runs(truth=np.full((2, 3), 10.0), accel_scale=0.004, gyro_scale=0.003)
    assert (out[:, 0] / 10.0 - 1.0).std() == pytest.approx(0.004, rel=0.08)
    assert (out[:, 1] / 10.0 - 1.0).std() == pytest.approx(0.003, rel=0.08)


def test_clipping():
    """Both ends of the range."""
    truth = np.array([[50.0, -50.0, 9.8]])
    force, rate = corrupt(
        np.random.default_rng(0),
        truth,
        truth,
        dataclasses.replace(QUIET, clip_g=4.0, clip_dps=90.0),
    )
    np.testing.assert_allclose(force[0], [39.2266, -39.2266, 9.8])
    np.testing.assert_allclose(rate[0], [np.pi / 2, -np.pi / 2, np.pi / 2])


def test_mounts():
    """Small angles about each axis, exactly one angle, or anything at all."""

    def angles(**change):
        errors = dataclasses.replace(QUIET, **change)
        R = [draw_mount(np.random.default_rng(i), errors) for i in range(400)]
        np.testing.assert_allclose(np.linalg.det(R), 1.0)
        return np.degrees(np.arccos(np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1)))

    small = angles(mount_sigma_deg=2.5)
    assert np.sqrt(np.mean(small**2) / 3.0) == pytest.approx(2.5, rel=0.08)
    np.testing.assert_allclose(angles(mount='angle', mount_angle_deg=20.0), 20.0, atol=1e-6)
    every = angles(mount='any')
    # uniform rotations: the mean angle is 90 + 360 / pi^2 = 126.5 degrees
    assert every.mean() == pytest.approx(126.5, abs=5.0)


def test_stamps_jitter_but_increase():
    """0.5 ms at 100 Hz; even 20 ms of jitter keeps their order."""
    t = np.arange(0.0, 50.0, 0.01)
    rng = np.random.default_rng(1)
    assert (jitter(rng, t, 0.0005) - t).std() == pytest.approx(0.0005, rel=0.05)
    assert np.diff(jitter(rng, t, 0.02)).min() > 0.0

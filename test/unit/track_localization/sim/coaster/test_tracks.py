"""The tracks of our own design: real coasters, smooth, clear of themselves."""

import numpy as np
import pytest

from track_localization.sim.coaster import (
    TRACKS,
)
from track_localization.sim.coaster.simulate import built_in_model

GRAVITY = 9.80665


def test_tracks_are_as_rough_as_documented():
    """Cross-track 8-20 mm by track, steel vibrates with 0.5-3 m/s^2, wood with 8."""
    plans = {name: built_in_model(name).plan for name in TRACKS}
    cross = [p.cross_track_m for p in plans.values()]
    assert (min(cross), max(cross)) == (0.008, 0.020)
    assert plans['wooden'].vibration_mps2 >= 8.0
    for name, p in plans.items():
        assert 6.0 <= p.joint_spacing_m <= 10.0
        assert 0.02 <= p.gyro_vibration_radps <= 0.06
        assert name == 'wooden' or 0.5 <= p.vibration_mps2 <= 3.0


@pytest.mark.parametrize('name', TRACKS)
def test_tracks_are_real_coasters(name):
    """Length, duration, speed and the forces on the seat stay within what trains are built for."""
    model = built_in_model(name)
    ride = model.design
    assert 480.0 < model.line.length < 1300.0
    assert 60.0 < ride.time_s[-1] < 190.0
    assert 13.0 < ride.speed.max() < 30.0
    g = ride.specific_force / GRAVITY
    assert -1.5 < g[:, 2].min() < 0.3
    assert 2.0 < g[:, 2].max() < 5.1
    assert np.abs(g[:, 1]).max() < 1.0
    assert np.abs(g[:, 0]).max() < 1.0
    assert np.abs(ride.angular_rate).max() < 3.5
    assert model.line.closed is (name != 'shuttle')


@pytest.mark.parametrize('name', TRACKS)
def test_curvature_of_every_track_is_continuous(name):
    """Over 0.25 m it changes by no more than transitions a few metres long allow."""
    line = built_in_model(name).line
    ends = (0.0, line.length) if line.closed else (1.0, line.length - 1.0)
    k = line.curvature(np.arange(*ends, 0.25))
    if line.closed:
        k = np.vstack([k, k[:1]])
    assert np.abs(np.diff(k, axis=0)).max() < 0.05


@pytest.mark.parametrize('name', TRACKS)
def test_track_keeps_clear_of_itself(name):
    """Two stretches more than 20 m apart along the track are never closer than 3 m."""
    line = built_in_model(name).line
    s = np.arange(0.0, line.length, 1.0)
    p = line.position(s)
    distance = np.linalg.norm(p[:, None] - p[None], axis=2)
    along = np.abs(s[:, None] - s[None])
    if line.closed:
        along = np.minimum(along, line.length - along)
    assert distance[along > 20.0].min() > 3.0

"""The seat's line from a track file alone, held against the simulator's own seat."""

import numpy as np
import pytest

from coaster_localization.seat_line import seat_line
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_map import track_map
from coaster_localization.track_rides import filter_ride
from track_localization.estimation import so3
from track_localization.estimation.imu import clean
from track_localization.sim.coaster import scenario, simulate_coaster
from track_localization.sim.coaster.simulate import built_in_model
from track_localization.track.centreline import Centreline


@pytest.mark.parametrize('name', ['looping', 'mine', 'shuttle'])
def test_same_as_the_design_ride(name):
    model = built_in_model(name)
    train, design = model.plan.train, model.design
    seat = np.array([0.0, 0.0, train.seat_height_m])
    line = Centreline.from_track(model.track)
    own = seat_line(line, train.wheelbase_m, seat, model.plan.line_height_m)
    assert own.closed == line.closed
    inside = (design.chainage > 2.0) & (design.chainage < own.length - 2.0) | own.closed
    s = design.chainage[inside][::7]
    off = np.linalg.norm(own.position(s) - design.position[inside][::7], axis=1)
    assert off.max() < 0.02
    R = so3.matrix_from_quat(design.quaternion[inside][::7])
    turned = so3.log(np.swapaxes(R, 1, 2) @ own.attitude(s))
    assert np.linalg.norm(turned, axis=1).max() < 0.003


def test_a_long_wheelbase_cuts_the_corner():
    """On a level circle of radius R a seat between bogies b apart runs at sqrt(R^2 - b^2/4)."""
    a = np.linspace(0.0, 2.0 * np.pi, 800, endpoint=False)
    circle = 30.0 * np.stack([np.cos(a), np.sin(a), np.zeros_like(a)], axis=1)
    yaw = a + 0.5 * np.pi
    zero = np.zeros_like(a)
    axes = so3.matrix_from_quat(np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1))
    track = Centreline(30.0 * a, circle, axes, True, 60.0 * np.pi)
    line = seat_line(track, 6.0, np.zeros(3))
    radius = np.linalg.norm(line.position(np.linspace(0.0, 180.0, 50)), axis=1)
    # The bogies stand 6 m of arc apart: half the chord's angle is 0.1 rad.
    np.testing.assert_allclose(radius, 30.0 * np.cos(0.1), atol=2e-3)


def test_a_ride_is_located_without_a_design_ride():
    """No speed by chainage and no design ride: the track file, wheelbase and seat are enough."""
    config = TrackFilterConfig()
    model = built_in_model('looping')
    ride = simulate_coaster('looping', scenario('nominal'), 3)
    train = model.plan.train
    seat = np.array([0.0, 0.0, train.seat_height_m])
    line = track_map(ride.track, config, train.wheelbase_m, seat, model.plan.line_height_m)
    start_m = float(ride.design.chainage[0])
    found = filter_ride(clean(ride.imu)[0], line, start_m, config).smoothed()
    there = found.position_at(ride.markers.time_s)
    assert np.linalg.norm(there - ride.markers.position, axis=1).mean() < 0.12

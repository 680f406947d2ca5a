"""Which rests are the station's; where a train is quiet is read off simulated design rides."""

import numpy as np
import pytest

from coaster_localization.config import EskfConfig, MatcherConfig
from coaster_localization.online import OnlineMatcher
from coaster_localization.pipeline import CoasterEskf
from coaster_localization.sensed import measured_motion
from coaster_localization.start import observe_rest
from coaster_localization.station import Station
from track_localization.estimation.so3 import matrix_from_rpy
from track_localization.sim.coaster import scenario, simulate_coaster

UP = np.array([0.0, 0.0, 9.81])


@pytest.fixture(scope='module')
def ride():
    return simulate_coaster('looping', scenario('nominal'), 71)


def on_the_lift(ride):
    """Return the times [s] of the slow climb, by the truth."""
    climbs = ride.truth.velocity[:, 2] > 0.3 * ride.truth.speed
    return ride.truth.time_s[climbs & (ride.truth.speed > 1.0) & (ride.truth.speed < 6.0)]


def test_a_rest_tilted_as_on_the_lift_is_elsewhere(ride):
    station = Station(ride.design)
    times = on_the_lift(ride)
    middle = (ride.imu.time_s > times[0] + 3.0) & (ride.imu.time_s < times[0] + 5.0)
    assert station.is_elsewhere(ride.R_bm @ ride.imu.specific_force[middle].mean(axis=0))


@pytest.mark.parametrize(
    'rpy_deg', [(0, 0, 0), (0, -10, 0), (14, 0, 0), (90, 0, 0), (0, 70, 0), (180, 0, 0)]
)
def test_however_the_phone_lies_in_the_station_it_is_there(ride, rpy_deg):
    tilted = matrix_from_rpy(*np.deg2rad(rpy_deg)).T @ UP
    assert not Station(ride.design).is_elsewhere(tilted)


def test_no_force_is_nowhere(ride):
    assert not Station(ride.design).is_elsewhere(np.zeros(3))
    assert not Station(ride.design).is_elsewhere(np.full(3, np.nan))


def test_a_stream_joined_on_the_lift_is_not_taken_to_the_station(ride):
    start = on_the_lift(ride)[0] + 6.0
    matcher, found = OnlineMatcher(ride.design, MatcherConfig()), []
    imu = ride.imu[ride.imu.time_s > start]
    for i in range(len(imu)):
        found += matcher.push(imu.sample(i))
    error = [np.linalg.norm(m.position - ride.truth.position_at(m.time_s)) for m in found]
    assert np.median(error) < 2.0
    assert max(error) < 40.0  # the length of the lift: it looks alike


def test_the_filter_does_not_level_itself_on_the_lift(ride):
    """Without matches it waits: nothing says where it is."""
    start = on_the_lift(ride)[0] + 6.0
    filter_ = CoasterEskf(ride.design, EskfConfig())
    imu = ride.imu[(ride.imu.time_s > start) & (ride.imu.time_s < start + 5.0)]
    for i in range(len(imu)):
        assert filter_.push(imu.sample(i)) == []
    assert filter_.history is None
    assert observe_rest([imu.sample(i) for i in range(300)]) is not None


def test_a_recording_begun_on_the_lift_has_no_rest_before_the_ride(ride):
    imu = ride.imu[ride.imu.time_s > on_the_lift(ride)[0] + 6.0]
    assert measured_motion(imu, ride.design).rests == (False, True)
    assert measured_motion(ride.imu, ride.design).rests == (True, True)

"""Where the track filter does not know where the train is: it says so, and finds it."""

import numpy as np
import pytest

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_filter import CoasterTrackFilter
from coaster_localization.track_map import line_map
from track_localization.estimation.imu import clean
from track_localization.estimation.line_bank import merge, news
from track_localization.estimation.line_state import ERRORS, NOMINAL
from track_localization.sim.coaster import scenario, simulate_coaster

CONFIG = TrackFilterConfig()


@pytest.fixture(scope='module')
def ride():
    return simulate_coaster('looping', scenario('nominal'), 3)


def follow(ride, filter_, begin_s=-np.inf, end_s=np.inf):
    """Return stamps, distances from the simulator's truth, sigmas and chances of being lost."""
    imu, _ = clean(ride.imu)
    states = []
    for i in range(len(imu)):
        if begin_s <= imu.time_s[i] <= end_s:
            states += filter_.push(imu.sample(i))
    time_s = np.array([s.time_s for s in states])
    place = filter_.line.line.position(np.array([s.x[0] for s in states]))
    error = np.linalg.norm(place - ride.truth.position_at(time_s), axis=1)
    sigma = np.sqrt([s.P[0, 0] for s in states])
    return time_s, error, sigma, np.array([s.lost for s in states])


def fastest(ride):
    speed = np.linalg.norm(ride.truth.velocity, axis=1)
    return float(ride.truth.time_s[np.argmax(speed)])


def test_begun_in_mid_ride(ride):
    filter_ = CoasterTrackFilter(
        line_map(ride.design, CONFIG), float(ride.design.chainage[0]), CONFIG
    )
    begin = fastest(ride)
    time_s, error, sigma, lost = follow(ride, filter_, begin, begin + 25.0)
    settled = time_s > begin + 12.0
    assert settled.any()
    assert error[settled].max() < 1.0
    assert lost[settled].max() < 0.05
    # Whenever it was far off, it had not claimed otherwise.
    assert not ((error > 1.0) & (error > 5.0 * np.hypot(sigma, 0.06))).any()


def test_lost_is_noticed_and_mended(ride):
    """
    Told the train stands 60 m further back, and sure of it: no restart is needed.

    The line is as level there as in the station: only where it begins to climb can tell.
    """
    line = line_map(ride.design, CONFIG)
    start_m = (float(ride.design.chainage[0]) - 60.0) % line.length
    filter_ = CoasterTrackFilter(line, start_m, CONFIG)
    time_s, error, _, lost = follow(ride, filter_, end_s=fastest(ride) + 20.0)
    assert filter_.relocations >= 1
    assert lost[error > 50.0].max() > 0.5
    late = time_s > fastest(ride) + 12.0
    assert late.any()
    assert error[late].max() < 1.0
    assert lost[late].max() < 0.05


def test_a_doubtful_start_is_weighed(ride):
    config = TrackFilterConfig(start_sigma_m=20.0)
    start_m = float(ride.design.chainage[0]) + 16.0
    filter_ = CoasterTrackFilter(line_map(ride.design, config), start_m, config)
    time_s, error, _, _ = follow(ride, filter_, end_s=fastest(ride) + 10.0)
    late = time_s > fastest(ride)
    assert late.any()
    assert error[late].max() < 1.0
    assert filter_.hypotheses == 1


def test_back_in_the_station_no_departure_is_made_up():
    """
    The line is built askew in the slow brakes and the station, and the train a tenth slow there.

    The place drifts, but the standing train does not take the speed of those that leave, and no
    answer is off by more than a metre and five sigmas.
    """
    ride = simulate_coaster('mine', scenario('nominal'), 423)
    start_m = float(ride.design.chainage[0])
    filter_ = CoasterTrackFilter(line_map(ride.design, CONFIG), start_m, CONFIG)
    _, error, sigma, _ = follow(ride, filter_)
    known = np.isfinite(error)
    assert not ((error > 1.0) & (error > 5.0 * np.hypot(sigma, 0.026)))[known].any()
    assert error[known][-1] < 5.0


def bank(*places):
    """Return states, covariances (sigma 1 m) and equal weights of hypotheses at these places."""
    X = np.zeros((len(places), NOMINAL))
    X[:, 0], X[:, 1] = places, 10.0
    X[:, 2:11] = X[:, 11:20] = np.eye(3).ravel()
    P = np.tile(np.eye(ERRORS), (len(places), 1, 1))
    return X, P, np.log(np.full(len(places), 1.0 / len(places)))


def test_twins_are_merged_with_their_weight():
    X, P, log_weight = bank(100.0, 100.4, 300.0)
    kept = merge(X, P, log_weight, 1e-7, np.inf)
    assert sorted(X[kept, 0].round()) == [100.0, 300.0]
    assert np.exp(log_weight[kept]).sum() == pytest.approx(1.0)
    assert sorted(np.exp(log_weight[kept])) == pytest.approx([1.0 / 3.0, 2.0 / 3.0])


def test_a_lap_further_is_the_same_place():
    X, P, log_weight = bank(20.0, 1020.0)
    assert len(merge(X.copy(), P, log_weight.copy(), 1e-7, np.inf)) == 2
    assert len(merge(X, P, log_weight, 1e-7, 1000.0)) == 1


def test_another_mount_is_another_hypothesis():
    X, P, log_weight = bank(20.0, 20.0)
    X[1, 11:20] = np.diag([-1.0, -1.0, 1.0]).ravel()
    assert len(merge(X, P, log_weight, 1e-7, np.inf)) == 2


def test_the_lightest_go():
    X, P, log_weight = bank(20.0, 200.0)
    log_weight[1] = log_weight[0] - 20.0
    assert list(merge(X, P, log_weight, 1e-7, np.inf)) == [0]


def test_what_does_not_turn_shows_the_same_again(ride):
    """Half a second on the straight tells nothing new; in a bend or a turning sensor it does."""
    line = line_map(ride.design, CONFIG)
    bend = np.linalg.norm(line.rows[:, 9:12], axis=1)
    straight, curve = line.chainage[bend.argmin()], line.chainage[bend.argmax()]
    table = (line.rows, line.step_m, line.closed)
    X, _, log_weight = bank(straight, curve)
    still, turning = np.zeros(3), np.array([0.0, 0.0, 0.12])
    assert news(0.5, still, X[:1], log_weight[:1], *table) < 0.05
    assert news(0.5, turning, X[:1], log_weight[:1], *table) == pytest.approx(0.5 * 0.12 / 0.15)
    X[0, 22] = 0.12
    assert news(0.5, turning, X[:1], log_weight[:1], *table) < 0.05
    X[0, 22] = 0.0
    # Of two hypotheses the likelier says how much the line turns.
    assert news(0.5, still, X, np.array([0.0, 20.0]), *table) == pytest.approx(0.5 / 0.6)
    assert news(0.5, still, X, np.array([20.0, 0.0]), *table) < 0.05

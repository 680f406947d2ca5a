"""Learning from simulated rides over one built track, whose truth the simulator knows."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coaster_localization.learning import differences, learn
from coaster_localization.ride_passes import SmoothedRide
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_map import line_map, usual_speed
from coaster_localization.track_rides import filter_ride
from track_localization.errors import DataError
from track_localization.evaluation.metrics import ride_errors
from track_localization.settings import override
from track_localization.sim.coaster import CoasterSimConfig, simulate_coaster
from track_localization.track.line_map import ATTITUDE, SIGMA, SPEED

CONFIG = TrackFilterConfig()
SEEDS = (1, 2, 3, 4)
ONE_TRACK = {'track.build_seed': 1, 'ride.dwell_before_s': (5.0, 5.0)}


def simulated(seed, **changes):
    return simulate_coaster('launch', override(CoasterSimConfig(), ONE_TRACK | changes), seed)


def smoothed(ride, line):
    start_m = float(ride.design.chainage[0])
    return SmoothedRide.of(filter_ride(ride.imu, line, start_m, CONFIG))


@pytest.fixture(scope='module')
def rides():
    return [simulated(seed) for seed in SEEDS]


@pytest.fixture(scope='module')
def lesson(rides):
    line = line_map(rides[0].design, CONFIG)
    return learn([smoothed(ride, line) for ride in rides], rides[0].design, CONFIG)


@pytest.fixture(scope='module')
def built(rides, lesson):
    """Return the true deviation (M, 3) of the built track's attitude: a sensor in its place."""
    truth = simulated(1, **{'track.seat_m': 0.0}).truth
    line = line_map(rides[0].design, CONFIG).line
    moving = truth.speed > 1.0
    s = np.unwrap(truth.chainage[moving], period=line.length)
    order = np.argsort(s % line.length)
    design = Rotation.from_matrix(line.attitude(s % line.length))
    vector = (design.inv() * Rotation.from_quat(truth.quaternion[moving])).as_rotvec()
    grid = lesson.learned.chainage
    columns = [np.interp(grid, (s % line.length)[order], c[order]) for c in vector.T]
    return np.stack(columns, axis=1)


def test_the_built_track_shows_in_what_is_learnt(lesson, built):
    """Each axis follows the truth, and correcting by it leaves less than three quarters."""
    seen = lesson.learned.rides > 1
    turn = lesson.learned.turn[seen]
    for k in range(3):
        assert np.corrcoef(turn[:, k], built[seen, k])[0, 1] > 0.7
    left = np.sqrt(np.mean((built[seen] - turn) ** 2))
    assert left < 0.75 * np.sqrt(np.mean(built[seen] ** 2))


def test_what_is_flagged_is_there(lesson, built):
    """Nine of ten flagged stretches deviate in truth, to the same side."""
    found = differences(lesson, least_rad=0.002)
    assert len(found) >= 10
    right = 0
    for d in found:
        k = ('roll', 'pitch', 'yaw').index(d.axis)
        inside = (lesson.learned.chainage >= d.from_m) & (lesson.learned.chainage <= d.to_m)
        right += float(built[inside, k].mean()) * d.largest > 0.0
    assert right >= 0.9 * len(found)


def test_the_next_ride_profits(lesson, rides):
    """Rides not learnt from: the live error over the whole ride is smaller."""
    design = rides[0].design
    lines = {False: line_map(design, CONFIG), True: line_map(design, CONFIG, lesson.learned)}
    error = {}
    for learnt, line in lines.items():
        total = []
        for seed in (6, 7):
            ride = simulated(seed)
            live = filter_ride(ride.imu, line, float(design.chainage[0]), CONFIG).live()
            total.append(ride_errors(live, ride.truth).distance)
        error[learnt] = float(np.concatenate(total).mean())
    assert error[True] < error[False]


def test_a_design_that_is_too_slow_is_corrected(rides):
    """The design's ride takes 12 % longer than the rides do: the usual speed is theirs."""
    design = rides[0].design
    slow = dataclasses.replace(design, time_s=1.12 * design.time_s, velocity=design.velocity / 1.12)
    line = line_map(slow, CONFIG)
    lesson = learn([smoothed(ride, line) for ride in rides[:3]], slow, CONFIG)
    usual = usual_speed(design, line)
    true = np.interp(lesson.learned.chainage, line.chainage, usual)
    known = np.isfinite(lesson.learned.speed + true) & (true > 5.0)
    ratio = lesson.learned.speed[known] / true[known]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.04)
    used = line_map(slow, CONFIG, lesson.learned)
    fast = np.isfinite(usual) & (usual > 5.0)
    assert np.nanmedian(used.rows[fast, SPEED] / usual[fast]) == pytest.approx(1.0, abs=0.04)


def test_what_was_learnt_is_in_the_line(lesson, rides):
    """Attitude and sigma of the corrected line are the design's turned by the correction."""
    before = line_map(rides[0].design, CONFIG)
    after = line_map(rides[0].design, CONFIG, lesson.learned)
    R = [Rotation.from_matrix(m.rows[:, ATTITUDE].reshape(-1, 3, 3)) for m in (before, after)]
    turned = (R[0].inv() * R[1]).as_rotvec()
    there = np.interp(before.chainage, lesson.learned.chainage, lesson.learned.turn[:, 1])
    np.testing.assert_allclose(turned[:, 1], there, atol=1e-9)
    assert (after.rows[:, SIGMA] <= CONFIG.attitude_sigma + 1e-12).all()
    assert np.median(after.rows[:, SIGMA]) < 0.6 * CONFIG.attitude_sigma


def test_one_ride_teaches_nothing(rides):
    line = line_map(rides[0].design, CONFIG)
    with pytest.raises(DataError, match='two rides'):
        learn([smoothed(rides[0], line)], rides[0].design, CONFIG)


def test_another_track_is_refused(lesson, circle):
    with pytest.raises(DataError, match='learn it anew'):
        line_map(circle, CONFIG, lesson.learned)

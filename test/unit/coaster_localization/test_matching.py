"""Matching of simulated rides against their design, held to the simulator's truth."""

import dataclasses

import numpy as np
import pytest

from coaster_localization import matching
from coaster_localization.config import MATCHERS, PAPER_MATCHER, MatcherConfig
from coaster_localization.matching import match_ride
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.settings import override
from track_localization.sim.coaster import CoasterSimConfig, scenario, simulate_coaster
from track_localization.sim.coaster.config import PERFECT

DEFAULT = MatcherConfig()
PAPER = override(DEFAULT, PAPER_MATCHER)


@pytest.fixture(scope='module')
def ride():
    return simulate_coaster('looping', scenario('nominal'), 21)


@pytest.fixture(scope='module')
def best(ride):
    return match_ride(ride.imu, ride.design, 'dtw_penalised', 'multi', DEFAULT)


def marker_error(ride, match):
    """Mean distance of the match at the markers' times from the markers [m]."""
    at = np.stack(
        [np.interp(ride.markers.time_s, match.time_s, p) for p in match.position.T], axis=-1
    )
    return float(np.linalg.norm(at - ride.markers.position, axis=1).mean())


def truth_error(ride, match):
    """Distance from the truth (N,) [m] and which samples move."""
    truth = ride.truth.position_at(match.time_s)
    speed = np.interp(match.time_s, ride.truth.time_s, ride.truth.speed)
    return np.linalg.norm(match.position - truth, axis=1), speed > 0.5


def test_an_ideal_ride_is_matched_exactly():
    """No error of any kind: what is left is half a grid step, 0.26 m at 26 m/s."""
    ride = simulate_coaster('looping', override(CoasterSimConfig(), PERFECT), 5)
    for method, channel in (('dtw_penalised', 'multi'), ('srdtw', 'z')):
        match = match_ride(ride.imu, ride.design, method, channel, DEFAULT)
        assert marker_error(ride, match) < 0.26
        error, moving = truth_error(ride, match)
        assert np.median(error[moving]) < 0.1


def test_no_systematic_lateness():
    """
    Ten milliseconds at 25 m/s are 0.25 m: the mean lateness where it is fast is less than five.

    At 100 Hz: where the two grids fall against each other shifts a match by up to half a step.
    """
    late = []
    fine = dataclasses.replace(DEFAULT, rate_hz=100.0)
    for seed in (31, 32, 33):
        ride = simulate_coaster('looping', scenario('nominal'), seed)
        match = match_ride(ride.imu, ride.design, 'dtw_penalised', 'multi', fine)
        speed = np.interp(match.time_s, ride.truth.time_s, ride.truth.speed)
        velocity = np.stack(
            [np.interp(match.time_s, ride.truth.time_s, v) for v in ride.truth.velocity.T], axis=-1
        )
        error = match.position - ride.truth.position_at(match.time_s)
        fast = speed > 12.0
        late.append(((error * velocity).sum(axis=1)[fast] / speed[fast] ** 2).mean())
    assert abs(np.mean(late)) < 0.005


@pytest.mark.parametrize(
    ('method', 'channel', 'limit'),
    [
        ('dtw_penalised', 'multi', 0.3),
        ('srdtw', 'multi', 0.3),
        ('srdtw', 'z', 0.46),
        ('dtw_penalised', 'z', 0.8),
        ('srdtw', 'pitch', 1.5),
    ],
)
def test_markers_are_found(ride, method, channel, limit):
    match = match_ride(ride.imu, ride.design, method, channel, DEFAULT)
    assert marker_error(ride, match) < limit
    assert match.method == method
    assert match.channel == channel


def test_srdtw_beats_plain_dtw():
    """The paper's claim: nearer at the markers, and fewer samples crowded on single points."""
    ride = simulate_coaster('launch', scenario('nominal'), 21)
    plain, segments = (match_ride(ride.imu, ride.design, m, 'z', DEFAULT) for m in ('dtw', 'srdtw'))
    assert marker_error(ride, segments) < 0.7 * marker_error(ride, plain)
    moving = truth_error(ride, plain)[1]
    longest = [np.bincount(m.path[:, 0])[moving].max() for m in (plain, segments)]
    assert longest[1] < longest[0]


def test_a_sample_gets_the_mean_of_its_first_and_last_partner(ride):
    """Paper 1, section 2.1, sample by sample from the path."""
    match = match_ride(ride.imu, ride.design, 'srdtw', 'z', PAPER)
    at = ride.design.at(match.design_grid_s)
    for i in range(0, len(match.time_s), 97):
        partners = match.path[match.path[:, 0] == i, 1]
        mean = 0.5 * (at.position[partners[0]] + at.position[partners[-1]])
        np.testing.assert_allclose(match.position[i], mean, atol=1e-9)
    assert match.cuts is not None
    assert {tuple(c - 1) for c in match.cuts[1:]} <= {tuple(p) for p in match.path}


def test_match_fits_together(ride, best):
    """Shapes, order, unit quaternions, path over all rows."""
    n = len(best.time_s)
    assert best.position.shape == (n, 3)
    assert best.quaternion.shape == (n, 4)
    assert len(best.measured) == n
    assert len(best.design) == len(best.design_grid_s)
    assert (np.diff(best.time_s) > 0).all()
    assert (np.diff(best.design_time_s) >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(best.quaternion, axis=1), 1.0, atol=1e-9)
    assert best.path[0].tolist() == [0, 0]
    assert best.path[-1].tolist() == [n - 1, len(best.design) - 1]
    expected = np.interp(best.design_time_s, ride.design.time_s, ride.design.chainage)
    assert np.abs(best.chainage - expected).max() < 0.5


def test_sigma_is_honest():
    """Error over sigma on three tracks: rms about 1, not a tenth, not ten."""
    ratios = []
    for track in ('looping', 'mine', 'wooden'):
        ride = simulate_coaster(track, scenario('nominal'), 41)
        match = match_ride(ride.imu, ride.design, 'dtw_penalised', 'multi', DEFAULT)
        error, moving = truth_error(ride, match)
        ratios.append((error / match.sigma_along)[moving])
    rms = np.sqrt((np.concatenate(ratios) ** 2).mean())
    assert 0.4 < rms < 2.0


def test_gross_mismatches_are_flagged():
    """A stop of 25 s that the design does not have throws SRDTW on Z off by tens of metres."""
    ride = simulate_coaster('looping', scenario('blockstop'), 51)
    match = match_ride(ride.imu, ride.design, 'srdtw', 'z', PAPER)
    error, moving = truth_error(ride, match)
    gross = moving & (error > 10.0)
    assert gross.sum() > 100
    assert match.flagged[gross].mean() > 0.8
    assert match.flagged[moving & (error < 2.0)].mean() < 0.3
    better = match_ride(ride.imu, ride.design, 'dtw_penalised', 'multi', DEFAULT)
    assert marker_error(ride, better) < 0.5


@pytest.mark.parametrize('name', ['mount20', 'mountany'])
def test_any_mount_is_matched(name):
    ride = simulate_coaster('looping', scenario(name), 61)
    match = match_ride(ride.imu, ride.design, 'dtw_penalised', 'multi', DEFAULT)
    assert marker_error(ride, match) < 0.6
    assert any('heading' in note for note in match.notes)


def test_a_recording_that_is_cut_off_is_matched_openly(ride):
    """It ends in the middle: nothing is stretched to the design's end."""
    middle = ride.imu.time_s[0] + 0.6 * np.ptp(ride.imu.time_s)
    cut = ride.imu[ride.imu.time_s < middle]
    for method in ('dtw_penalised', 'srdtw'):
        match = match_ride(cut, ride.design, method, 'multi', DEFAULT)
        error, moving = truth_error(ride, match)
        assert np.median(error[moving]) < 1.5
        assert match.chainage[-1] < 0.95 * ride.design.chainage[-1]


def test_without_a_gyro_z_is_matched_and_the_rest_refused(ride):
    deaf = ImuSeries(ride.imu.time_s, ride.imu.specific_force, ride.imu.angular_rate * np.nan)
    match = match_ride(deaf, ride.design, 'srdtw', 'z', DEFAULT)
    assert marker_error(ride, match) < 0.46
    assert any('no gyro' in note for note in match.notes)
    with pytest.raises(DataError, match='no gyro'):
        match_ride(deaf, ride.design, 'srdtw', 'pitch', DEFAULT)


def test_unmatchable_segments_fall_back_and_say_so(ride, monkeypatch):
    def five_against_one(a, b, *_):
        return np.linspace(0, len(a), 6).astype(int), np.array([0, len(b)])

    monkeypatch.setattr(matching, 'matched_cut_points', five_against_one)
    match = match_ride(ride.imu, ride.design, 'srdtw', 'z', DEFAULT)
    assert any('5 measured segments cannot be recombined with 1' in n for n in match.notes)
    assert match.cuts is None
    assert marker_error(ride, match) < 1.0


def test_rate_of_the_grid_hardly_matters(ride, best):
    half = match_ride(
        ride.imu, ride.design, 'dtw_penalised', 'multi', dataclasses.replace(DEFAULT, rate_hz=100.0)
    )
    assert marker_error(ride, half) < marker_error(ride, best) + 0.15


def test_each_method_runs_its_own_algorithm(ride):
    paths = [match_ride(ride.imu, ride.design, m, 'z', DEFAULT).path for m in MATCHERS]
    for k, one in enumerate(paths):
        for other in paths[k + 1 :]:
            assert one.shape != other.shape or (one != other).any()


def test_unknown_names_are_refused(ride):
    for method, channel in (('dwt', 'z'), ('dtw', 'x')):
        with pytest.raises(DataError, match='methods are'):
            match_ride(ride.imu, ride.design, method, channel, DEFAULT)

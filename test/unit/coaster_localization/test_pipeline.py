"""
The coaster's filter on a simulated ride, fed with matches made from the truth.

The matches stand in for the matcher: the truth's place on the line, wrong by a slowly wandering
error. What is tested here is the filter alone.
"""

import dataclasses

import numpy as np
import pytest

from coaster_localization.config import EskfConfig
from coaster_localization.observation import MatchObservation, observation_covariance
from coaster_localization.pipeline import CoasterEskf
from coaster_localization.smoothing import estimates_to_trajectory, run_filter, smooth
from track_localization.estimation.imu import ImuSample
from track_localization.estimation.so3 import quat_from_matrix
from track_localization.sim.coaster import scenario, simulate_coaster
from track_localization.track.centreline import Centreline
from track_localization.track.line_table import LineTable

MATCH_SIGMA = 0.8
WHOLE = EskfConfig(history_s=1e9)


@pytest.fixture(scope='module')
def ride():
    return simulate_coaster('looping', scenario('nominal'), 3)


@pytest.fixture(scope='module')
def line(ride):
    return LineTable(Centreline.from_design_ride(ride.design))


@pytest.fixture(scope='module')
def matches(ride, line):
    """Truth on the line every 0.2 s, with an Ornstein-Uhlenbeck error of 0.8 m over 2 s."""
    rng = np.random.default_rng(8)
    decay = np.exp(-0.1)
    error, s, out = 0.0, line.nearest(ride.truth.position[0]), []
    for k in range(0, len(ride.truth), 20):
        error = decay * error + MATCH_SIGMA * np.sqrt(1 - decay**2) * rng.normal()
        s = line.project(ride.truth.position[k], s)
        moving = min(1.0, float(ride.truth.speed[k]) / 3.0)
        out.append(match_at(line, float(ride.truth.time_s[k]), s + error * moving))
    return out


def match_at(line, time_s, s, sigma=MATCH_SIGMA):
    R = line.axes[line.index(s)]
    V = observation_covariance(R, sigma**2, 0.03**2, 0.03**2)
    return MatchObservation(time_s, line.point(s), quat_from_matrix(R), V, s)


@pytest.fixture(scope='module')
def filtered(ride, line, matches):
    filter_ = CoasterEskf(ride.design, WHOLE, line)
    estimates = run_filter(filter_, ride.imu, matches)
    return filter_, estimates_to_trajectory(estimates, line)


def errors(trajectory, ride):
    truth = np.stack(
        [
            np.interp(trajectory.time_s, ride.truth.time_s, ride.truth.position[:, k])
            for k in range(3)
        ],
        axis=1,
    )
    return trajectory.position - truth


def test_one_estimate_for_every_sample(ride, filtered):
    _, trajectory = filtered
    np.testing.assert_array_equal(trajectory.time_s, ride.imu.time_s)


def test_fusion_beats_the_matches_and_smoothing_beats_fusion(ride, filtered):
    filter_, trajectory = filtered
    live = np.linalg.norm(errors(trajectory, ride), axis=1).mean()
    smoothed = np.linalg.norm(errors(smooth(filter_), ride), axis=1).mean()
    assert live < 0.9 * MATCH_SIGMA
    assert smoothed < 0.8 * live


def test_claimed_covariance_covers_the_error(ride, filtered):
    """At least 95 % of the ride inside the claimed 3 sigma ellipsoid (chi-square 3, 99.7 %)."""
    filter_, trajectory = filtered
    for estimate in (trajectory, smooth(filter_)):
        e = errors(estimate, ride)
        nees = np.einsum('ni,ni->n', e, np.linalg.solve(estimate.covariance, e[..., None])[..., 0])
        assert (nees < 14.2).mean() > 0.95


def test_order_of_arrival_does_not_matter(ride, line, matches):
    """Matches one second late, and out of order among themselves, end in the same state."""
    config = EskfConfig(history_s=30.0)
    imu = ride.imu[: int(60.0 * 100)]
    # Matches before the filter knows its start are refused, so leave those out.
    early = [m for m in matches if imu.time_s[0] + 3.0 < m.time_s < imu.time_s[-1] - 2.0]
    in_time = CoasterEskf(ride.design, config, line)
    run_filter(in_time, imu, early)

    late = CoasterEskf(ride.design, config, line)
    rng = np.random.default_rng(0)
    arrival = sorted(early, key=lambda m: m.time_s + rng.uniform(0.5, 2.0))
    due = [m.time_s + 2.0 for m in arrival]
    sent = 0
    for i in range(len(imu)):
        late.push(imu.sample(i))
        while sent < len(arrival) and sorted(due)[sent] <= imu.time_s[i]:
            late.push(arrival[sent])
            sent += 1
    for match in arrival[sent:]:
        late.push(match)
    np.testing.assert_allclose(
        late.history.state.nav.x, in_time.history.state.nav.x, rtol=0, atol=1e-9
    )


def test_repeating_many_steps_is_the_same_as_one_after_the_other(ride, line, matches):
    """To the bit: standstills, matches and gaps among them; or live would not be offline."""
    filter_ = CoasterEskf(ride.design, WHOLE, line)
    kept = np.r_[0:4000, 4040:5000]
    run_filter(filter_, ride.imu[kept], [m for m in matches if m.time_s < ride.imu.time_s[5000]])
    _, measurements, states = zip(*filter_.history.entries(), strict=True)
    kinds = [isinstance(m, MatchObservation) or m.quiet for m in measurements[1:]]
    assert 0.1 < np.mean(kinds) < 0.9
    runs = filter_.apply_all(states[0], measurements[1:])
    repeated = [run[k] for run in runs for k in range(len(run))]
    for again, state in zip(repeated, states[1:], strict=True):
        np.testing.assert_array_equal(again.nav.x, state.nav.x)
        np.testing.assert_array_equal(again.nav.P, state.nav.P)
        np.testing.assert_array_equal(
            (again.nav.time_s, again.chainage, *again[2:]),
            (state.nav.time_s, state.chainage, *state[2:]),
        )


def test_no_standstill_is_seen_before_the_train_stands(ride, line, matches):
    """Rolling into the station shakes little; taken for standing it puts the train metres off."""
    filter_ = CoasterEskf(ride.design, WHOLE, line)
    run_filter(filter_, ride.imu, matches)
    quiet = {m.step.time_s for _, m, _ in filter_.history.entries() if getattr(m, 'quiet', False)}
    speed = np.interp(sorted(quiet), ride.truth.time_s, ride.truth.speed)
    assert np.mean(speed < 0.01) > 0.9
    assert speed.max() < 0.25


def test_a_match_older_than_the_history_is_counted(ride, line, matches):
    filter_ = CoasterEskf(ride.design, EskfConfig(history_s=2.0), line)
    for i in range(1500):
        filter_.push(ride.imu.sample(i))
    filter_.push(matches[10])
    assert filter_.rejected['match'] == {'too_late': 1}


def test_bad_samples_are_counted_and_survived(ride, line):
    filter_ = CoasterEskf(ride.design, EskfConfig(), line)
    for i in range(400):
        filter_.push(ride.imu.sample(i))
    good = ride.imu.sample(400)
    zero = np.zeros(3)
    before = filter_.history.state
    for bad in (
        ImuSample(good.time_s, np.array([np.nan, 0, 0]), zero),
        ImuSample(good.time_s, zero, np.array([0, np.inf, 0])),
        ImuSample(float('nan'), zero, zero),
        ImuSample(float(ride.imu.time_s[399]), zero, zero),
        ImuSample(float(ride.imu.time_s[10]), zero, zero),
        ImuSample(1.7e9, zero, zero),
    ):
        assert filter_.push(bad) == []
    assert filter_.history.state is before
    assert filter_.rejected['imu'] == {
        'not_finite': 3,
        'repeated_time': 1,
        'backward_time': 1,
        'time_jump': 1,
    }
    assert len(filter_.push(good)) == 1


def test_a_single_gross_mismatch_is_refused(ride, line, matches, filtered):
    k = next(i for i, m in enumerate(matches) if m.time_s > ride.imu.time_s[0] + 70.0)
    wrong = [*matches[:k], match_at(line, matches[k].time_s, matches[k].chainage + 120.0)]
    filter_ = CoasterEskf(ride.design, WHOLE, line)
    trajectory = estimates_to_trajectory(
        run_filter(filter_, ride.imu, [*wrong, *matches[k + 1 :]]), line
    )
    assert filter_.rejected['match']['gate'] == 1
    _, right = filtered
    assert np.linalg.norm(trajectory.position - right.position, axis=1).max() < 2.0


def test_a_filter_that_is_wrong_gives_in_to_steady_matches(ride, line, matches):
    """Pushed 60 m off in mid-ride with a small covariance, it comes back, and says meanwhile."""
    filter_ = CoasterEskf(ride.design, EskfConfig(), line)
    stop = int(np.searchsorted(ride.imu.time_s, ride.imu.time_s[0] + 100.0))
    moved = int(np.searchsorted(ride.imu.time_s, ride.imu.time_s[0] + 75.0))
    done, doubted = 0, False
    for i in range(stop):
        sample = ride.imu.sample(i)
        while done < len(matches) and matches[done].time_s < sample.time_s:
            filter_.push(matches[done])
            done += 1
        filter_.push(sample)
        if i == moved:
            s = filter_.history.state.chainage
            filter_.set_start(line.point(s + 60.0), np.eye(3) * 0.01)
        doubted |= filter_.diagnostics()['status'].startswith('matches disagree')
    assert doubted
    assert filter_.diagnostics()['relocations'] >= 1
    truth = ride.truth.position_at(np.array([sample.time_s]))[0]
    assert np.linalg.norm(filter_.history.state.nav.position - truth) < 5.0


def test_start_in_mid_ride_from_a_match(ride, line, matches):
    first = int(np.searchsorted(ride.imu.time_s, ride.imu.time_s[0] + 70.0))
    imu = ride.imu[first:]
    filter_ = CoasterEskf(ride.design, WHOLE, line)
    late = [m for m in matches if m.time_s > imu.time_s[0] + 0.5]
    trajectory = estimates_to_trajectory(run_filter(filter_, imu, late), line)
    error = np.linalg.norm(errors(trajectory, ride), axis=1)
    settled = trajectory.time_s > imu.time_s[0] + 10.0
    assert np.median(error[settled]) < 1.0


def test_a_gap_opens_the_covariance(ride, line, matches):
    start = ride.imu.time_s[0]
    keep = (ride.imu.time_s < start + 75.0) | (ride.imu.time_s > start + 77.0)
    filter_ = CoasterEskf(ride.design, WHOLE, line)
    early = [m for m in matches if m.time_s < start + 75.0]
    trajectory = estimates_to_trajectory(run_filter(filter_, ride.imu[keep], early), line)
    k = int(np.searchsorted(trajectory.time_s, start + 76.0))
    sigma = np.sqrt(np.trace(trajectory.covariance, axis1=1, axis2=2))
    assert sigma[k - 1] < 3.0
    assert sigma[k] > 15.0
    error = np.linalg.norm(errors(trajectory, ride), axis=1)[k]
    assert error < 3.0 * sigma[k]


def test_paper_preset_uses_every_match_with_the_fixed_covariance(ride, line, matches):
    config = dataclasses.replace(WHOLE, preset='paper', lambda_x=10.0, n=1000.0)
    filter_ = CoasterEskf(ride.design, config, line)
    run_filter(filter_, ride.imu, matches)
    assert 'gate' not in filter_.rejected.get('match', {})
    tiny = dataclasses.replace(config, n=1e-3)
    other = CoasterEskf(ride.design, tiny, line)
    run_filter(other, ride.imu, matches)
    assert np.trace(other.history.state.nav.P[:3, :3]) > np.trace(
        filter_.history.state.nav.P[:3, :3]
    )


def test_reset_waits_for_a_start_again(ride, line):
    filter_ = CoasterEskf(ride.design, EskfConfig(), line)
    for i in range(400):
        filter_.push(ride.imu.sample(i))
    assert filter_.history is not None
    filter_.reset()
    assert filter_.history is None
    assert 'waiting' in filter_.diagnostics()['status']
    estimates = [e for i in range(400, 800) for e in filter_.push(ride.imu.sample(i))]
    assert len(estimates) == 400


@pytest.mark.parametrize('early', [-150, 0, 45, 300])
def test_when_a_match_arrives_does_not_matter(ride, line, matches, early):
    """Matches come 1.5 s after their sample, at once, or before it: also before the start."""
    config, count = EskfConfig(), 3000
    matches = [m for m in matches if ride.imu.time_s[0] < m.time_s < 125.0]
    due = np.searchsorted(ride.imu.time_s, [m.time_s for m in matches]) - early
    filter_, expected = (CoasterEskf(ride.design, config, line) for _ in range(2))
    run_filter(expected, ride.imu[:count], matches)
    k = 0
    for i in range(count):
        filter_.push(ride.imu.sample(i))
        while k < len(matches) and due[k] <= i:
            filter_.push(matches[k])
            k += 1
    np.testing.assert_array_equal(filter_.history.state.nav.x, expected.history.state.nav.x)
    assert filter_.accepted == expected.accepted
    assert filter_.rejected == expected.rejected == {}


def test_a_match_far_ahead_of_the_imu_is_refused(ride, line, matches):
    filter_ = CoasterEskf(ride.design, EskfConfig(), line)
    for i in range(300):
        filter_.push(ride.imu.sample(i))
    filter_.push(dataclasses.replace(matches[0], time_s=float(ride.imu.time_s[399]) + 31.0))
    ahead = dataclasses.replace(matches[0], time_s=float(ride.imu.time_s[399]) + 1.0)
    for _ in range(550):
        filter_.push(ahead)
    assert filter_.rejected == {'match': {'ahead_of_imu': 1, 'too_early': 50}}

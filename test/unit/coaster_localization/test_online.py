"""The live matcher on simulated rides, and on streams that no ride would give."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coaster_localization.config import MatcherConfig
from coaster_localization.online import OnlineMatcher
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSample, ImuSeries
from track_localization.sim.coaster import scenario, simulate_coaster

CONFIG = MatcherConfig()


@pytest.fixture(scope='module')
def ride():
    return simulate_coaster('mine', scenario('nominal'), 71)


def feed(matcher, imu):
    found = []
    for i in range(len(imu)):
        found += matcher.push(imu.sample(i))
    return found


@pytest.fixture(scope='module')
def found(ride):
    return feed(OnlineMatcher(ride.design, CONFIG), ride.imu)


def errors(ride, found, speed=0.5):
    """Distances from the truth, sigmas along the track [m], of matches on the move."""
    time_s = np.array([m.time_s for m in found])
    error = np.linalg.norm(
        np.array([m.position for m in found]) - ride.truth.position_at(time_s), axis=1
    )
    sigma = np.sqrt([np.linalg.eigvalsh(m.covariance)[-1] for m in found])
    moving = np.interp(time_s, ride.truth.time_s, ride.truth.speed) > speed
    return error[moving], sigma[moving]


def test_the_ride_is_followed(ride, found):
    error, sigma = errors(ride, found)
    assert error.mean() < 1.5
    assert np.median(errors(ride, found, speed=6.0)[0]) < 0.4
    assert 0.3 < np.sqrt(((error / sigma) ** 2).mean()) < 2.0


def test_matches_come_at_their_rate_with_their_lag(ride):
    config = dataclasses.replace(CONFIG, lag_s=2.0, observation_rate_hz=4.0)
    matcher = OnlineMatcher(ride.design, config)
    pairs = []
    for i in range(4000):
        sample = ride.imu.sample(i)
        pairs += [(sample.time_s, match.time_s) for match in matcher.push(sample)]
    lag = np.array([now - then for now, then in pairs])
    assert ((lag > 1.99) & (lag < 2.1)).all()
    gaps = np.diff([then for _, then in pairs])
    np.testing.assert_allclose(gaps, 0.25, atol=0.041)
    assert gaps.mean() == pytest.approx(0.25, rel=0.15)


def test_nothing_runs_away_in_the_station(ride):
    """Two minutes at rest, as long as it takes: the match stays at the platform."""
    rest = ride.imu[ride.imu.time_s < ride.truth.time_s[ride.truth.speed > 0.05][0] - 0.5]
    matcher = OnlineMatcher(ride.design, CONFIG)
    shift, found = 0.0, []
    while shift < 120.0:
        found += feed(
            matcher, ImuSeries(rest.time_s + shift, rest.specific_force, rest.angular_rate)
        )
        shift += rest.time_s[-1] - rest.time_s[0] + 0.01
    start = ride.design.position[0]
    assert max(np.linalg.norm(m.position - start) for m in found) < 0.3
    assert matcher.diagnostics()['match_phase'] == 'waiting'


def test_covariance_lies_along_the_track(ride, found):
    for match in found[::50]:
        values, vectors = np.linalg.eigh(match.covariance)
        near = np.argmin(np.abs(ride.design.chainage - match.chainage))
        velocity = ride.design.velocity[near]
        if np.linalg.norm(velocity) > 1.0 and values[-1] > 4 * values[0]:
            along = abs(vectors[:, -1] @ velocity) / np.linalg.norm(velocity)
            assert along > 0.98


def test_the_same_samples_give_the_same_matches(ride, found):
    matcher = OnlineMatcher(ride.design, CONFIG)
    feed(matcher, ride.imu[:3000])
    matcher.reset()
    again = feed(matcher, ride.imu)
    assert [m.time_s for m in again] == [m.time_s for m in found]
    np.testing.assert_array_equal([m.position for m in again], [m.position for m in found])


@pytest.mark.parametrize('rate_hz', [40.0, 400.0])
def test_the_sensors_rate_hardly_matters(ride, found, rate_hz):
    """Resampled from 100 Hz; no delay may come with the rate."""
    t = np.arange(ride.imu.time_s[0], ride.imu.time_s[-1], 1.0 / rate_hz)
    rows = [
        np.stack([np.interp(t, ride.imu.time_s, c) for c in values.T], axis=-1)
        for values in (ride.imu.specific_force, ride.imu.angular_rate)
    ]
    other = feed(OnlineMatcher(ride.design, CONFIG), ImuSeries(t, rows[0], rows[1]))
    assert errors(ride, other)[0].mean() < errors(ride, found)[0].mean() + 0.3
    assert np.median(errors(ride, other, 6.0)[0]) < 0.4


def test_a_second_ride_begins_anew(ride):
    """The train stops in the station and leaves again: the next ride is matched as the first."""
    length = ride.imu.time_s[-1] - ride.imu.time_s[0] + 0.01
    matcher = OnlineMatcher(ride.design, CONFIG)
    feed(matcher, ride.imu)
    again = feed(
        matcher,
        ImuSeries(ride.imu.time_s + length, ride.imu.specific_force, ride.imu.angular_rate),
    )
    shifted = [dataclasses.replace(m, time_s=m.time_s - length) for m in again]
    assert errors(ride, shifted)[0].mean() < 1.5


def test_a_stop_on_the_way_is_waited_for():
    ride = simulate_coaster('mine', scenario('blockstop'), 72)
    found = feed(OnlineMatcher(ride.design, CONFIG), ride.imu)
    assert errors(ride, found)[0].mean() < 2.5
    assert np.median(errors(ride, found, 6.0)[0]) < 0.5


def test_a_ride_under_way_is_sought_and_found(ride):
    """The stream begins in the middle, without a rest."""
    fast = ride.truth.time_s[ride.truth.speed > 9.0][0]
    found = feed(OnlineMatcher(ride.design, CONFIG), ride.imu[ride.imu.time_s > fast])
    late = [m for m in found if m.time_s > fast + 25.0]
    assert np.median(errors(ride, late, 6.0)[0]) < 1.0


def test_a_gap_is_counted_and_the_ride_found_again(ride):
    fast = ride.truth.time_s[ride.truth.speed > 9.0][0]
    kept = (ride.imu.time_s < fast) | (ride.imu.time_s > fast + 6.0)
    matcher = OnlineMatcher(ride.design, CONFIG)
    found = feed(matcher, ride.imu[kept])
    assert matcher.rejected['gap'] == 1
    late = [m for m in found if m.time_s > fast + 30.0]
    assert np.median(errors(ride, late, 6.0)[0]) < 1.0


def test_without_a_gyro_z_is_followed(ride):
    deaf = ImuSeries(ride.imu.time_s, ride.imu.specific_force, ride.imu.angular_rate * np.nan)
    matcher = OnlineMatcher(ride.design, CONFIG)
    found = feed(matcher, deaf)
    assert not matcher.rejected
    assert np.median(errors(ride, found, 6.0)[0]) < 2.0


def test_a_gyro_that_wakes_up_is_used(ride, found):
    """The first samples lack the rates; what follows is as if it had begun with them."""
    rate = ride.imu.angular_rate.copy()
    rate[:30] = np.nan
    matcher = OnlineMatcher(ride.design, CONFIG)
    late = feed(matcher, ImuSeries(ride.imu.time_s, ride.imu.specific_force, rate))
    assert errors(ride, late)[0].mean() < errors(ride, found)[0].mean() + 0.2


def test_bad_samples_are_counted_and_cost_nothing(ride, found):
    matcher = OnlineMatcher(ride.design, CONFIG)
    bad = ImuSample(float('nan'), np.zeros(3), np.zeros(3))
    again = []
    for i in range(len(ride.imu)):
        sample = ride.imu.sample(i)
        again += matcher.push(sample)
        if i == 50:
            matcher.push(sample)
            matcher.push(sample._replace(time_s=sample.time_s - 0.5))
            matcher.push(sample._replace(time_s=sample.time_s + 1e9))
            matcher.push(bad)
            matcher.push(sample._replace(specific_force=np.full(3, np.inf)))
    expected = {'repeated_time': 1, 'backward_time': 1, 'time_leap': 1, 'not_finite': 2}
    assert dict(matcher.rejected) == expected
    np.testing.assert_array_equal([m.position for m in again], [m.position for m in found])


def test_a_recording_played_again_restarts(ride):
    matcher = OnlineMatcher(ride.design, CONFIG)
    feed(matcher, ride.imu[:6000])
    found = feed(matcher, ride.imu)
    assert matcher.rejected['restart'] == 1
    assert errors(ride, found)[0].mean() < 1.5


number = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-50.0, 50.0),
    st.sampled_from([0.0, 9.81, 1e308, -1e308]),
)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.just(0.02), st.just(0.02), st.just(0.3), number),
            st.one_of(
                st.just([0.0, 0.0, 9.8, 0.0, 0.0, 0.0]),
                st.lists(st.floats(-1e5, 1e5), min_size=6, max_size=6),
                st.lists(number, min_size=6, max_size=6),
            ),
        ),
        min_size=1,
        max_size=150,
    )
)
def test_no_stream_breaks_it(circle, stream):
    """Whatever comes: finite matches or none, and every sample used or counted."""
    matcher = OnlineMatcher(circle, dataclasses.replace(CONFIG, seek_after_s=0.5, lag_s=0.2))
    time_s = 0.0
    for step, values in stream:
        row = np.array(values)
        time_s = time_s + step if np.isfinite(time_s + step) else 0.0
        for match in matcher.push(ImuSample(time_s, row[:3], row[3:])):
            assert np.isfinite(match.position).all()
            assert np.isfinite(match.covariance).all()
    assert sum(matcher.rejected.values()) <= len(stream) + 5
    assert all(isinstance(k, str) for k in matcher.diagnostics())


def test_only_some_channels_live(ride):
    with pytest.raises(DataError, match='multi and z'):
        OnlineMatcher(ride.design, dataclasses.replace(CONFIG, channel='yaw'))

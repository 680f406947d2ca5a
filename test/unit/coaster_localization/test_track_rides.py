"""The track filter over simulated rides, one on each built-in track, and damaged recordings."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_map import line_map
from coaster_localization.track_rides import filter_ride
from coaster_localization.track_smoothing import smooth_epochs
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.evaluation.consistency import inside_sigma, position_nees
from track_localization.evaluation.metrics import marker_errors, ride_errors
from track_localization.sim.coaster import scenario, simulate_coaster

CONFIG = TrackFilterConfig()
RIDES = {'looping': 1, 'mine': 2, 'launch': 3, 'wooden': 1, 'shuttle': 2}
"""Track and seed of each ride."""


def run(ride, imu=None, config=CONFIG):
    return filter_ride(
        ride.imu if imu is None else imu,
        line_map(ride.design, config),
        float(ride.design.chainage[0]),
        config,
    )


@dataclasses.dataclass(repr=False)
class Result:
    """A simulated ride, what the filter made of it, and its trajectories."""

    ride: object
    filtered: object
    live: object
    lagged: object
    smoothed: object

    def errors(self, which):
        return ride_errors(getattr(self, which), self.ride.truth)

    def at_markers(self, which):
        passed = self.ride.markers.time_s - self.ride.clock_offset_s
        trajectory = getattr(self, which)
        return marker_errors(trajectory, passed, self.ride.markers.position).design


def result(name, seed, what='nominal', config=CONFIG):
    ride = simulate_coaster(name, scenario(what), seed)
    filtered = run(ride, config=config)
    return Result(ride, filtered, filtered.live(), filtered.lagged(), filtered.smoothed())


@pytest.fixture(scope='module')
def results():
    return {name: result(name, seed) for name, seed in RIDES.items()}


@pytest.fixture(scope='module')
def stopped():
    """A ride that waits 25 s in the first block."""
    return result('looping', 2, 'blockstop')


@pytest.mark.parametrize('name', list(RIDES))
def test_ride_is_found_to_decimetres(results, name):
    """
    Position over the whole moving ride and at the markers.

    Bounds are about twice what these rides have; the markers' own floor is 0.05 m, and a filter
    without one of its updates, or with a wrong sign in one, is off by metres.
    """
    done = results[name]
    bounds = {'live': (1.0, 0.2), 'lagged': (0.9, 0.16), 'smoothed': (0.5, 0.15)}
    for which, (whole, at_markers) in bounds.items():
        errors = done.errors(which)
        assert errors.covered > 0.999, which
        assert errors.distance.mean() < whole, which
        marks = done.at_markers(which)
        assert np.isfinite(marks).all(), which
        assert marks.mean() < at_markers, which
    assert done.errors('live').distance.max() < 12.0
    assert done.errors('smoothed').distance.max() < 4.0


def test_later_knowledge_helps(results):
    """Over all rides the lag's mean error is below the live one, the smoothed one well below."""
    mean = {
        which: np.mean([r.errors(which).distance.mean() for r in results.values()])
        for which in ('live', 'lagged', 'smoothed')
    }
    assert mean['lagged'] < 0.97 * mean['live']
    assert mean['smoothed'] < 0.6 * mean['live']


def test_sigma_is_honest(results):
    """Two sigma along the line hold nine tenths of all epochs; NEES per state is about one."""
    for which in ('live', 'lagged', 'smoothed'):
        inside, nees = [], []
        for name, done in results.items():
            e = done.errors(which)
            inside.append(inside_sigma(e.along, e.sigma_along, 2.0))
            nees.append(np.mean(position_nees(e.vector, e.covariance)) / 3.0)
            assert inside[-1] > 0.8, (which, name)
        assert np.mean(inside) > 0.9, which
        assert 0.25 < np.mean(nees) < 1.5, which


def test_attitude_and_speed_are_the_vehicles(results):
    """
    Of the seat, though the sensor is mounted askew by some degrees: 0.3 degrees, 0.5 m/s rms.

    Attitudes are compared at the epochs, with the truth interpolated to their stamps.
    """
    for done in results.values():
        truth, (x, _) = done.ride.truth, smooth_epochs(done.filtered.epochs)
        times = np.array([e.time_s for e in done.filtered.epochs])
        true = Slerp(truth.time_s, Rotation.from_quat(truth.quaternion))(
            np.clip(times, truth.time_s[0], truth.time_s[-1])
        )
        bodies = x[:, 2:11].reshape(-1, 3, 3) @ np.swapaxes(x[:, 11:20].reshape(-1, 3, 3), 1, 2)
        off = (true.inv() * Rotation.from_matrix(bodies)).magnitude()
        assert np.sqrt(np.mean(off**2)) < np.deg2rad(0.3)
        errors = done.errors('smoothed')
        assert np.sqrt(np.mean(errors.speed**2)) < 0.5
        M, sigma = done.filtered.mount
        off = Rotation.from_matrix(M.T @ done.ride.R_bm).magnitude()
        assert off < max(np.deg2rad(0.5), 4.0 * sigma)


def test_trajectories_have_every_sample_once(results):
    for done in results.values():
        for trajectory in (done.live, done.lagged, done.smoothed):
            assert len(trajectory.time_s) == len(done.filtered.states)
            assert (np.diff(trajectory.time_s) > 0.0).all()
            for values in (trajectory.position, trajectory.velocity, trajectory.covariance):
                assert np.isfinite(values).all()
        assert (np.diff([e.time_s for e in done.filtered.epochs]) > 0.0).all()
        assert done.filtered.rejected == {}


def stands(filtered):
    """Stamps and a mask of the epochs that claim a standstill: slower than 0.1 m/s at 2 sigma."""
    times = np.array([e.time_s for e in filtered.epochs])
    v = np.array([e.x[1] for e in filtered.epochs])
    sigma = np.sqrt([e.P[1, 1] for e in filtered.epochs])
    return times, np.abs(v) + 2.0 * sigma < 0.1


def test_no_standstill_while_it_moves(results, stopped):
    """Quiet lifts and slow drives included: wherever the filter is sure to stand, it does."""
    for done in [*results.values(), stopped]:
        times, still = stands(done.filtered)
        speed = np.interp(times, done.ride.truth.time_s, done.ride.truth.speed)
        assert speed[still].max(initial=0.0) < 0.3
    assert stands(stopped.filtered)[1].sum() > 300


def test_block_stop_is_a_standstill_and_costs_nothing(stopped):
    """25 s at rest in mid-ride: seen as such within a second, the ride goes on where it stood."""
    truth = stopped.ride.truth
    times, still = stands(stopped.filtered)
    slow = np.interp(times, truth.time_s, truth.speed) < 1e-3
    first = truth.time_s[np.flatnonzero(truth.speed > 0.5)[0]]
    last = truth.time_s[np.flatnonzero(truth.speed > 0.5)[-1]]
    middle = slow & (times > first + 2.0) & (times < last - 2.0)
    assert np.ptp(times[middle]) > 20.0
    settled = middle & (times > times[middle][0] + 2.0)
    assert still[settled].mean() > 0.95
    for which, bound in (('live', 1.0), ('lagged', 1.0), ('smoothed', 0.4)):
        assert stopped.errors(which).distance.mean() < bound, which
    assert stopped.at_markers('smoothed').mean() < 0.15


def test_damaged_samples_are_counted_and_survived(results):
    """NaN in force and rate, repeated stamps, and half a second and two that are missing."""
    ride = results['looping'].ride
    truth = ride.truth
    moving = np.flatnonzero(truth.speed > 5.0)
    rng = np.random.default_rng(6)
    bad = rng.choice(moving, 60, replace=False)
    force, rate = ride.imu.specific_force.copy(), ride.imu.angular_rate.copy()
    force[bad[:20], 1], rate[bad[20:30], 2], force[bad[30:40], 0] = np.nan, np.nan, np.inf
    keep = np.ones(len(force), dtype=int)
    keep[bad[40:60]] = 2
    gaps = (moving[len(moving) // 3], moving[2 * len(moving) // 3])
    keep[gaps[0] : gaps[0] + 50] = 0
    keep[gaps[1] : gaps[1] + 200] = 0
    rows = np.repeat(np.arange(len(force)), keep)
    imu = ImuSeries(ride.imu.time_s[rows], force[rows], rate[rows])
    filtered = run(ride, imu)
    finite = np.isfinite(imu.specific_force + imu.angular_rate).all(axis=1)
    expected = {
        'not_finite': int((~finite).sum()),
        'repeated_time': int((np.diff(imu.time_s[finite]) == 0.0).sum()),
    }
    assert min(expected.values()) > 15
    assert filtered.rejected == {'imu': expected}
    for trajectory, bound in ((filtered.live(), 2.0), (filtered.smoothed(), 1.0)):
        assert np.isfinite(trajectory.position).all()
        assert np.isfinite(trajectory.covariance).all()
        assert ride_errors(trajectory, truth).distance.mean() < bound


def test_time_that_is_missing_is_doubt(results):
    """Two seconds without a sample at speed: the covariance says that the train may be anywhere."""
    ride = results['mine'].ride
    gap = np.flatnonzero(ride.truth.speed > 8.0)[500]
    rows = np.r_[0:gap, gap + 200 : gap + 300]
    filtered = run(ride, ride.imu[rows])
    sigma = np.sqrt([state.P[0, 0] for state in filtered.states])
    times = np.array([state.time_s for state in filtered.states])
    after = np.searchsorted(times, ride.imu.time_s[gap + 200])
    assert sigma[after] > 4.0 * sigma[after - 1]
    last = filtered.live()
    error = abs(last.chainage[after] - ride.truth.chainage[gap + 200])
    assert error < 4.0 * np.hypot(sigma[after], 0.3)


def test_recording_too_short_for_a_start_is_refused(results):
    ride = results['looping'].ride
    with pytest.raises(DataError, match='record the ride'):
        run(ride, ride.imu[:50])


def test_recording_without_a_ride_is_refused(results):
    """Standing all the time there is nothing to compare with the line."""
    ride = results['looping'].ride
    with pytest.raises(DataError, match='design ride'):
        run(ride, ride.imu[:500])

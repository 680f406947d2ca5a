"""Simulated rides: repeatable, consistent with their own truth, as hard as documented."""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from track_localization.errors import DataError
from track_localization.settings import override, walk
from track_localization.sim.coaster import (
    SCENARIOS,
    TRACKS,
    CoasterSimConfig,
    prepare,
    scenario,
    simulate_coaster,
)
from track_localization.sim.coaster.config import PERFECT, RideErrors
from track_localization.sim.coaster.dynamics import DONE, run_train
from track_localization.sim.coaster.simulate import built_in_model, draw_conditions
from track_localization.track.centreline import Centreline

GRAVITY = 9.80665
NOMINAL = {
    'ride.mass': 0.05,
    'ride.friction': 0.10,
    'ride.drag': 0.06,
    'ride.wind_mps': 2.5,
    'ride.gusts': 0.30,
    'ride.chain': 0.03,
    'ride.tyres': 0.05,
    'ride.launch': 0.03,
    'ride.brake': 0.08,
    'ride.brake_shift_m': 0.5,
    'ride.start_m': 0.15,
    'ride.dwell_before_s': (8.0, 40.0),
    'ride.dwell_after_s': (4.0, 10.0),
    'track.deviations': 1.0,
    'track.along_m': 0.020,
    'track.along_correlation_m': 40.0,
    'track.stretch': 1.2e-4,
    'track.seat_m': 0.015,
    'vibration.scale': 1.0,
    'vibration.resonance_hz': (7.0, 14.0),
    'imu.rate_hz': 100.0,
    'imu.accel_bias': 0.04,
    'imu.accel_walk': 0.002,
    'imu.accel_scale': 0.004,
    'imu.accel_noise': 0.012,
    'imu.gyro_bias': 0.004,
    'imu.gyro_walk': 1e-4,
    'imu.gyro_scale': 0.003,
    'imu.gyro_noise': 0.0012,
    'imu.clip_g': 0.0,
    'imu.jitter_s': 0.0005,
    'imu.mount': 'gauss',
    'imu.mount_sigma_deg': 2.5,
    'clock.offset_s': 0.0,
    'clock.random_offset_s': 0.0,
}


def perfect(**changes):
    return override(CoasterSimConfig(), {**PERFECT, **changes})


def test_nominal_errors_are_the_documented_ones():
    """The figures in the README hold for these and nothing milder."""
    values = {name: value for name, _, value in walk(CoasterSimConfig())}
    assert {name: values[name] for name in NOMINAL} == NOMINAL


def test_same_seed_same_bits():
    """Two runs agree to the last bit, another seed does not."""
    first, again = (simulate_coaster('looping', CoasterSimConfig(), 7) for _ in range(2))
    for part in ('imu', 'truth', 'markers'):
        a, b = getattr(first, part), getattr(again, part)
        for field in dataclasses.fields(a):
            np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))
    other = simulate_coaster('looping', CoasterSimConfig(), 8)
    assert len(other.imu) != len(first.imu) or not np.array_equal(
        other.imu.specific_force, first.imu.specific_force
    )


def test_one_built_track_for_several_rides():
    """``build_seed`` N is the track that the ride of seed N has; the rides themselves differ."""

    def built(seed, build_seed):
        changes = {'track.build_seed': build_seed, 'track.seat_m': 0.0}
        return simulate_coaster('looping', override(CoasterSimConfig(), changes), seed)

    def path(ride):
        s, first = np.unique(np.maximum.accumulate(ride.truth.chainage), return_index=True)
        at = np.linspace(100.0, 800.0, 500)
        return np.stack([np.interp(at, s, p) for p in ride.truth.position[first].T], axis=1)

    own, named, other = built(3, -1), built(3, 3), built(4, 3)
    np.testing.assert_array_equal(own.imu.specific_force, named.imu.specific_force)
    assert not np.array_equal(own.markers.time_s, other.markers.time_s)
    # Between samples the path is read off chords, at most 5 mm from the curve.
    np.testing.assert_allclose(path(other), path(own), atol=0.005)
    assert np.abs(path(built(4, -1)) - path(own)).max() > 0.02


def test_vibration_does_not_change_what_else_was_drawn():
    """Each kind of error has its own stream: scenarios of one seed are the same ride."""
    a = simulate_coaster('mine', scenario('nominal'), 5)
    b = simulate_coaster('mine', scenario('novib'), 5)
    np.testing.assert_array_equal(a.truth.position, b.truth.position)
    np.testing.assert_array_equal(a.imu.time_s, b.imu.time_s)
    np.testing.assert_array_equal(a.R_bm, b.R_bm)


def integrate(time_s, force, rate, position, R):
    """Integrate by fourth-order steps over pairs of samples; return R (M,3,3) and p (M,3)."""
    h = float(time_s[1] - time_s[0])
    w0, w1, w2 = rate[:-2:2], rate[1:-1:2], rate[2::2]
    steps = h / 3.0 * (w0 + 4.0 * w1 + w2) + h**2 / 3.0 * np.cross(w0, w2)
    turns = Rotation.from_rotvec(steps).as_matrix()
    attitude = np.empty((len(turns) + 1, 3, 3))
    attitude[0] = R
    for i, turn in enumerate(turns):
        attitude[i + 1] = attitude[i] @ turn
    acceleration = np.einsum('nij,nj->ni', attitude, force[::2]) - [0.0, 0.0, GRAVITY]
    fit = CubicSpline(time_s[::2], acceleration)
    return attitude, position + fit.antiderivative(2)(time_s[::2])


@pytest.mark.parametrize('name', ['looping', 'shuttle'])
def test_force_and_rate_integrate_to_the_pose(name):
    """
    A perfect sensor on a real track: rate integrates to attitude, force twice to position.

    The bounds are the integrator's own error at 2 kHz over a whole ride: 1e-6 rad, and from it
    and the jumps of the brakes' jerk 1 cm.
    """
    config = perfect(**{'track.deviations': 1.0, 'track.seat_m': 0.02, 'imu.rate_hz': 2000.0})
    config = override(config, {'ride.dwell_before_s': (0.5, 0.5), 'ride.dwell_after_s': (1.0, 1.0)})
    ride = simulate_coaster(name, config, 3)
    n = (len(ride.imu) - 1) // 2 * 2 + 1
    imu, truth = ride.imu[:n], ride.truth[:n]
    R = Rotation.from_quat(truth.quaternion[::2])
    attitude, position = integrate(
        truth.time_s, imu.specific_force, imu.angular_rate, truth.position[0], R[0].as_matrix()
    )
    wrong = (Rotation.from_matrix(attitude).inv() * R).magnitude()
    assert wrong.max() < 1e-6
    assert np.linalg.norm(position - truth.position[::2], axis=1).max() < 0.01


def test_perfect_ride_is_the_design_ride():
    """With every error off the recording is the design ride, shifted by the dwell."""
    config = override(perfect(), {'ride.dwell_before_s': (2.0, 2.0)})
    ride = simulate_coaster('wooden', config, 1)
    n = len(ride.design) - 300
    np.testing.assert_allclose(
        ride.imu.specific_force[:n], ride.design.specific_force[:n], atol=1e-9
    )
    np.testing.assert_allclose(ride.truth.position[:n], ride.design.position[:n], atol=1e-9)
    assert ride.imu.time_s[0] == 100.0


def test_truth_velocity_and_chainage_fit_its_positions():
    """Velocity is the slope of position; chainage is the nearest point of the design line."""
    ride = simulate_coaster('looping', CoasterSimConfig(), 4)
    truth, line = ride.truth, Centreline.from_track(ride.track)
    slope = np.gradient(truth.position, truth.time_s, axis=0)
    np.testing.assert_allclose(slope, truth.velocity, atol=0.05)
    at = slice(None, None, 50)
    foot = line.position(truth.chainage[at])
    across = np.sum((truth.position[at] - foot) * line.tangent(truth.chainage[at]), axis=1)
    assert np.abs(across).max() < 2e-3
    assert truth.chainage.min() >= 0.0
    assert truth.chainage.max() < line.length
    # design chainage goes on counting: the ride ends one lap after it began
    assert ride.design.chainage[-1] - ride.design.chainage[0] == pytest.approx(line.length, abs=0.2)


def test_built_track_deviates_by_centimetres():
    """The truth lies off the design seat path by what the track's deviations say, no more."""
    model = built_in_model('looping')
    config = perfect(**{'track.deviations': 1.0})
    off = []
    for seed in range(1, 9):
        ride = simulate_coaster(model, config, seed)
        moving = ride.truth.speed > 3.0
        p = ride.truth.position[moving][::20]
        path = Centreline.from_design_ride(ride.design)
        s = path.nearest(p, near=ride.truth.chainage[moving][::20], window=5.0)
        off.append(np.linalg.norm(p - path.position(s), axis=1))
    rms = np.sqrt(np.mean(np.concatenate(off) ** 2))
    assert rms == pytest.approx(0.010 * np.sqrt(2.0), rel=0.2)


def test_markers():
    """Sixteen points, four to a place; times are when the seat passed the built track's marks."""
    ride = simulate_coaster('launch', CoasterSimConfig(), 6)
    marks = ride.markers
    assert len(marks) == 16
    assert marks.name[0] == 'A1'
    assert marks.name[-1] == 'D4'
    assert np.all(np.diff(marks.time_s) > 0.0)
    gaps = np.linalg.norm(np.diff(marks.position.reshape(4, 4, 3), axis=1), axis=2)
    assert gaps.min() > 1.5
    assert gaps.max() < 4.5
    error = np.linalg.norm(ride.truth.position_at(marks.time_s) - marks.position, axis=1)
    assert 0.002 < np.median(error) < 0.15
    exact = simulate_coaster('launch', perfect(), 6)
    error = exact.truth.position_at(exact.markers.time_s) - exact.markers.position
    assert np.abs(error).max() < 1e-3


def test_clock_offset_moves_markers_only():
    """The ground's clock is off by up to 2 s; the recording is what it was."""
    plain = simulate_coaster('mine', scenario('nominal'), 9)
    shifted = simulate_coaster('mine', scenario('clock_offset'), 9)
    np.testing.assert_array_equal(plain.imu.time_s, shifted.imu.time_s)
    offset = shifted.markers.time_s - plain.markers.time_s
    np.testing.assert_allclose(offset, shifted.clock_offset_s)
    assert 0.0 < abs(shifted.clock_offset_s) <= 2.0
    assert plain.clock_offset_s == 0.0


@pytest.mark.parametrize('name', SCENARIOS)
def test_every_scenario_runs(name):
    """Each scenario gives a finite ride with increasing stamps."""
    track = 'shuttle' if name == 'shuttle' else 'looping'
    ride = simulate_coaster(track, scenario(name), 2)
    assert np.isfinite(ride.imu.specific_force).all()
    assert np.isfinite(ride.imu.angular_rate).all()
    assert np.diff(ride.imu.time_s).min() > 0.0
    assert len(ride.truth) == len(ride.imu)


def first_motion(ride) -> float:
    return float(ride.truth.time_s[np.argmax(ride.truth.speed > 0.05)] - 100.0)


def test_scenarios_do_what_they_say():
    """Dwell, mount, clipping, stop in the block, deviations, vibration."""
    rides = {
        name: simulate_coaster('looping', scenario(name), 2)
        for name in SCENARIOS
        if name != 'shuttle'
    }
    assert first_motion(rides['dwell0']) < 1.0
    assert first_motion(rides['dwell120']) == pytest.approx(120.3, abs=0.5)
    angle = {k: np.degrees(Rotation.from_matrix(r.R_bm).magnitude()) for k, r in rides.items()}
    assert angle['mount0'] == 0.0
    assert angle['mount8'] == pytest.approx(8.0)
    assert angle['mount20'] == pytest.approx(20.0)
    assert np.abs(rides['clip4g'].imu.specific_force).max() <= 4.0 * GRAVITY + 1e-9
    assert np.abs(rides['nominal'].imu.specific_force).max() > 4.0 * GRAVITY
    truth = rides['blockstop'].truth
    resting = (truth.speed < 1e-6) & (truth.chainage > 300.0)
    assert resting.sum() / 100.0 == pytest.approx(25.0, abs=0.5)
    quiet = rides['novib'].imu.specific_force
    shaken = [rides[k].imu.specific_force - quiet for k in ('nominal', 'vib3')]
    assert shaken[1].std() == pytest.approx(3.0 * shaken[0].std(), rel=1e-6)


def test_shuttle_runs_its_track_three_times():
    """Backward up the first lift, forward through, backward again, and to rest where it began."""
    ride = simulate_coaster('shuttle', scenario('shuttle'), 3)
    s = ride.truth.chainage
    top = np.argmax(s)
    assert s[:top].min() < s[0] - 40.0
    assert s[top] > s[0] + 300.0
    assert s[top:].min() < s[0] - 20.0
    assert s[-1] == pytest.approx(s[0], abs=1.0)


@pytest.mark.parametrize('name', TRACKS)
def test_no_track_strands_its_train(name):
    """Twelve perturbed trains get round: the tracks have energy to spare."""
    model = built_in_model(name)
    for seed in range(1, 13):
        rng = np.random.default_rng(seed)
        run = run_train(model.line, model.plan, draw_conditions(rng, RideErrors(), model.plan))
        assert run.outcome == DONE


def test_stranded_train_is_reported_with_its_seed():
    """Three times the friction strands the train: the error says where, and names the seed."""
    model = built_in_model('looping')
    train = dataclasses.replace(model.plan.train, friction=0.08)
    with pytest.raises(DataError, match=r'rolled back|came to rest'):
        prepare(model.track, dataclasses.replace(model.plan, train=train), 'slow')
    slow = dataclasses.replace(model, plan=dataclasses.replace(model.plan, train=train))
    with pytest.raises(DataError, match='with seed 12'):
        simulate_coaster(slow, CoasterSimConfig(), 12)


def test_unknown_names():
    """Tracks and scenarios are listed when one is unknown."""
    with pytest.raises(DataError, match='looping'):
        simulate_coaster('spinner')
    with pytest.raises(DataError, match='novib'):
        scenario('hail')

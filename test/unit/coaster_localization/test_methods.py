"""Methods over whole rides: the mount that is found, what feeds a filter, slow sections."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coaster_localization.config import CoasterConfig
from coaster_localization.methods import run_methods
from track_localization.settings import override
from track_localization.sim.coaster import scenario, simulate_coaster


def angle_deg(R_bm, true):
    return np.rad2deg(Rotation.from_matrix(R_bm @ true.T).magnitude())


def mount_of(ride, config):
    (result,) = run_methods(ride.imu, ride.design, config, ['track_filter'])
    return result.mount


@pytest.mark.parametrize('what', ['mountany', 'mount20'])
@pytest.mark.parametrize('seed', [1, 2, 3])
def test_mount_is_found_with_an_honest_sigma(what, seed):
    """Within 0.6 deg of the true one, and within 4 of its own sigmas, however the phone lies."""
    ride = simulate_coaster('looping', scenario(what), seed)
    R_bm, sigma = mount_of(ride, CoasterConfig())
    error = angle_deg(R_bm, ride.R_bm)
    assert error < 0.6
    assert error < 4.0 * np.rad2deg(sigma)
    assert np.rad2deg(sigma) < 0.3


def test_the_given_mount_is_part_of_the_found_one():
    """A parameter file that is 25 deg wrong changes what the filter sees, not what is told."""
    ride = simulate_coaster('looping', scenario('mountany'), 2)
    yaw, pitch, roll = Rotation.from_matrix(ride.R_bm).as_euler('ZYX', degrees=True)
    config = override(
        CoasterConfig(), {'mount_rpy_deg': [float(roll), float(pitch) + 25.0, float(yaw)]}
    )
    assert angle_deg(mount_of(ride, config)[0], ride.R_bm) < 0.6


def test_methods_without_a_mount_of_their_own_tell_none():
    ride = simulate_coaster('looping', scenario('nominal'), 1)
    (result,) = run_methods(ride.imu, ride.design, CoasterConfig(), ['dtw_z'])
    assert result.mount is None


def test_a_filter_is_not_left_behind_in_a_long_slow_section():
    """At 3.8 m/s for 50 s it once thought that it crawled, and was 30 m off at the end."""
    ride = simulate_coaster('launch', scenario('nominal'), 100)
    (result,) = run_methods(ride.imu, ride.design, CoasterConfig(), ['eskf'])
    there = result.trajectory.position_at(ride.truth.time_s)
    error = np.linalg.norm(there - ride.truth.position, axis=1)
    assert np.nanmax(error[ride.truth.speed > 0.5]) < 12.0


def test_the_filter_fed_by_srdtw_says_so_and_gives_its_own_answer():
    ride = simulate_coaster('looping', scenario('nominal'), 1)
    names = ['eskf_smoothed', 'eskf_srdtw']
    usual, segments = run_methods(ride.imu, ride.design, CoasterConfig(), names)
    assert (usual.fed_by, segments.fed_by) == ('dtw_penalised', 'srdtw_multi')
    apart = np.linalg.norm(usual.trajectory.position - segments.trajectory.position, axis=1)
    assert 0.0 < apart.max() < 10.0


def test_the_filter_is_fed_by_any_algorithm_that_the_configuration_names():
    """And live matching, which has one of its own, says so."""
    ride = simulate_coaster('looping', scenario('nominal'), 1)
    settings = {'matcher.method': 'dtw_derivative', 'matcher.channel': 'z'}
    config = override(CoasterConfig(), settings)
    derivative, live = run_methods(ride.imu, ride.design, config, ['eskf', 'eskf_live'])
    (usual,) = run_methods(ride.imu, ride.design, CoasterConfig(), ['eskf'])
    assert derivative.fed_by == 'dtw_derivative_z'
    apart = np.linalg.norm(usual.trajectory.position - derivative.trajectory.position, axis=1)
    assert apart.max() > 0.1
    assert 'dtw_derivative: live matching is an open-end' in live.notes[0]
    assert usual.notes == ()

"""Figures of a method from results made by hand."""

import dataclasses

import numpy as np
import pytest

from coaster_localization.matching import Match
from coaster_localization.methods import MethodResult
from track_localization.cli.coaster.results import (
    Reference,
    figures,
    floor_figures,
    rpy_deg,
    table,
)
from track_localization.estimation import so3
from track_localization.estimation.trajectory import Trajectory
from track_localization.track.design_ride import DesignRide

RATE = 50.0


@pytest.fixture
def design() -> DesignRide:
    """20 s along x at 10 m/s, after and before a rest of 2 s."""
    t = np.arange(0.0, 24.0, 1.0 / RATE)
    x = 10.0 * np.clip(t - 2.0, 0.0, 20.0)
    zero = np.zeros_like(t)
    ones = np.ones_like(t)
    return DesignRide(
        time_s=t,
        chainage=x + 5.0,
        position=np.stack([x, zero, zero], axis=1),
        quaternion=np.stack([zero, zero, zero, ones], axis=1),
        velocity=np.stack([10.0 * ((t > 2.0) & (t < 22.0)), zero, zero], axis=1),
        specific_force=np.stack([zero, zero, 9.81 * ones], axis=1),
        angular_rate=np.zeros((len(t), 3)),
    )


@pytest.fixture
def reference(design) -> Reference:
    """The vehicle runs 0.1 m beside the design line; markers every second."""
    beside = design.position + np.array([0.0, 0.1, 0.0])
    truth = Trajectory(design.time_s, beside, velocity=design.velocity)
    times = np.arange(4.0, 20.0)
    places = np.stack([10.0 * (times - 2.0), 0.0 * times, 0.0 * times], axis=1)
    return Reference.of(truth, design, times, places)


def match_of(design: DesignRide, ahead: np.ndarray, sigma: float, flagged: np.ndarray) -> Match:
    n = len(design)
    rows = np.stack([np.arange(n)] * 2, axis=1)
    return Match(
        method='dtw',
        channel='z',
        time_s=design.time_s,
        design_time_s=design.time_s,
        position=design.position + ahead[:, None] * [1.0, 0.0, 0.0],
        chainage=design.chainage + ahead,
        quaternion=design.quaternion,
        sigma_along=np.full(n, sigma),
        flagged=flagged,
        held=np.zeros(n, dtype=bool),
        path=rows,
        cuts=None,
        measured=np.zeros((n, 1)),
        design=np.zeros((n, 1)),
        design_grid_s=design.time_s,
    )


def test_figures_of_a_fused_method(design, reference):
    """Fused 0.5 m ahead of the design, fed by a match 2 m ahead: a quarter of it at markers."""
    n = len(design)
    match = match_of(design, np.full(n, 2.0), 1.0, np.zeros(n, dtype=bool))
    position = design.position + np.array([0.5, 0.0, 0.0])
    fused = Trajectory(design.time_s, position, sigma_along=np.full(n, 0.3))
    runtime = {'matching': 0.5, 'filter': 1.5}
    result = MethodResult(
        'eskf', fused, match, 'dtw_z', {'match': {'gate': 3}}, runtime, ('a note',)
    )
    out = figures(result, reference, 40.0)
    assert out['markers_m']['mean'] == pytest.approx(0.5, abs=1e-9)
    assert out['markers_truth_m']['mean'] == pytest.approx(np.hypot(0.5, 0.1), abs=1e-9)
    assert out['markers_floor_m']['mean'] == pytest.approx(0.0, abs=1e-6)
    assert out['along_m']['median'] == pytest.approx(0.5, abs=1e-6)
    assert out['cross_m']['median'] == pytest.approx(0.1, abs=1e-6)
    assert out['inside_2_sigma'] == 1.0
    assert out['ratio_to_matching']['markers_m'] == pytest.approx(0.25, abs=1e-9)
    assert out['fed_by'] == 'dtw_z'
    assert out['runtime_s'] == 2.0
    assert out['real_time_factor'] == pytest.approx(0.05)
    assert out['stages'] == runtime
    assert out['rejected'] == {'match': {'gate': 3}}
    assert out['markers_clock_offset_s'] == pytest.approx(-0.05, abs=0.0015)
    assert out['markers_clock_offset_sigma_s'] == pytest.approx(0.3 / 10.0, rel=0.1)
    assert 'nees_mean' not in out
    assert 'mount_rpy_deg' not in out


@pytest.mark.parametrize('rpy', [(10.0, -20.0, 170.0), (30.0, 90.0, 0.0), (-50.0, -90.0, 0.0)])
def test_a_found_mount_is_told_as_parameter_files_take_it(design, reference, rpy):
    R_bm = so3.matrix_from_rpy(*np.deg2rad(rpy))
    trajectory = Trajectory(design.time_s, design.position)
    result = MethodResult(
        'track_filter', trajectory, None, None, {}, {'filter': 1.0}, (), (R_bm, np.deg2rad(0.2))
    )
    out = figures(result, reference, 40.0)
    assert out['mount_rpy_deg'] == pytest.approx(rpy, abs=1e-6)
    assert out['mount_sigma_deg'] == pytest.approx(0.2)
    assert rpy_deg(R_bm @ so3.matrix_from_rpy(0.0, 0.0, 0.0)) == pytest.approx(rpy, abs=1e-6)


def test_gross_mismatches_are_counted_by_flag_and_by_sigma(design, reference):
    """5 of 20 moving seconds are 30 m off, 2 of them flagged, none within 3 sigma of 1 m."""
    t = design.time_s
    ahead = np.where((t > 5.0) & (t <= 10.0), 30.0, 0.0)
    match = match_of(design, ahead, 1.0, (t > 5.0) & (t <= 7.0))
    trajectory = Trajectory(t, match.position)
    result = MethodResult('dtw_z', trajectory, match, None, {}, {'matching': 0.1})
    got = figures(result, reference, 24.0)['match']
    assert got['gross_share'] == pytest.approx(0.25, abs=0.01)
    assert got['gross_flagged'] == pytest.approx(0.4, abs=0.01)
    assert got['gross_inside_3_sigma'] == 0.0
    sure = dataclasses.replace(match, sigma_along=np.full(len(t), 11.0))
    result = dataclasses.replace(result, match=sure)
    assert figures(result, reference, 24.0)['match']['gross_inside_3_sigma'] == 1.0


def test_the_floor_is_the_distance_of_the_design_line(reference):
    floor = floor_figures(reference)
    assert floor['position_m']['mean'] == pytest.approx(0.1, abs=1e-6)
    assert floor['markers_m']['max'] == pytest.approx(0.0, abs=1e-6)


def test_the_truth_gets_the_chainage_of_the_design_line(reference):
    truth = reference.truth
    inside = (truth.time_s > 4.0) & (truth.time_s < 20.0)
    expected = 5.0 + 10.0 * (truth.time_s - 2.0)
    np.testing.assert_allclose(truth.chainage[inside], expected[inside], atol=0.02)


def test_without_truth_and_markers_only_run_times_are_left(design):
    reference = Reference.of(None, design)
    trajectory = Trajectory(design.time_s, design.position)
    result = MethodResult('imu', trajectory, None, None, {}, {'filter': 1.0})
    out = figures(result, reference, 10.0)
    assert set(out) == {'runtime_s', 'stages', 'real_time_factor', 'rejected'}
    assert floor_figures(reference) == {}
    assert table({'imu': out}, '').columns == ['method', 'run time [s]']

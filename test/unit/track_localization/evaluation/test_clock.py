import dataclasses

import numpy as np
import pytest

from coaster_localization.config import CoasterConfig
from coaster_localization.methods import run_methods
from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.clock import ClockOffset, fit_clock_offset, offset_from_event
from track_localization.sim.coaster import scenario, simulate_coaster


def ride() -> Trajectory:
    time = np.arange(0.0, 60.0, 0.02)
    angle = 0.3 * time + 0.5 * np.sin(0.2 * time)
    position = np.stack([40 * np.cos(angle), 40 * np.sin(angle), 5 * np.sin(0.7 * time)], axis=1)
    return Trajectory(time, position)


def straight(chainage: np.ndarray, sigma: float = 0.2) -> Trajectory:
    """Along x at 100 Hz from t = 100 s, as ``chainage`` (N,) says."""
    time = 100.0 + 0.01 * np.arange(len(chainage))
    position = np.stack([chainage, 0.0 * chainage, 0.0 * chainage], axis=1)
    return Trajectory(
        time,
        position,
        chainage=chainage,
        speed=np.abs(np.gradient(chainage, time)),
        sigma_along=np.full(len(time), sigma),
    )


def test_offset_of_the_markers_clock_is_found_despite_a_wrong_marker():
    markers = np.linspace(5.0, 55.0, 16)
    design = ride().position_at(markers)
    design[3] += 30.0
    clock = fit_clock_offset(ride(), markers - 0.737, design)
    assert clock.offset_s == pytest.approx(0.737, abs=0.0015)
    assert clock.sigma_s < 0.0015
    assert np.median(clock.distance) < 0.02


def test_too_few_markers_give_no_offset():
    clock = fit_clock_offset(ride(), np.array([100.0, 200.0]), np.zeros((2, 3)))
    assert np.isnan(clock.offset_s)
    assert np.isnan(clock.sigma_s)
    assert np.isnan(clock.distance).all()


def test_an_offset_beyond_the_reach_is_not_guessed():
    markers = np.linspace(10.0, 50.0, 16)
    design = ride().position_at(markers)
    assert np.isnan(fit_clock_offset(ride(), markers - 4.0, design).offset_s)
    clock = fit_clock_offset(ride(), markers - 4.0, design, reach_s=30.0)
    assert clock.offset_s == pytest.approx(4.0, abs=0.002)


@pytest.mark.parametrize('sigma_along', [None, 0.1, 0.5])
@pytest.mark.parametrize('wrong', [0, 2])
def test_sigma_is_that_of_the_errors(sigma_along, wrong):
    """
    150 draws of 16 markers 0.3 m off each way, some 10 m off, and a ride off along its track.

    The ride's error, drawn from the sigma that it claims, is the same at all markers. The rms of
    error over sigma is one by theory; 150 draws and the scale of 16 residuals, itself uncertain by
    a fifth, give 0.7 to 1.4.
    """
    true = ride()
    velocity = np.gradient(true.position, true.time_s, axis=0)
    tangent = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    ratios = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        estimate = true
        if sigma_along is not None:
            shifted = true.position + sigma_along * rng.standard_normal() * tangent
            claimed = np.full(len(true), sigma_along)
            estimate = dataclasses.replace(true, position=shifted, sigma_along=claimed)
        markers = np.sort(rng.uniform(5.0, 55.0, 16))
        design = true.position_at(markers) + rng.normal(0.0, 0.3, (16, 3))
        design[:wrong] += rng.normal(0.0, 10.0, (wrong, 3))
        clock = fit_clock_offset(estimate, markers - 0.737, design)
        ratios.append((clock.offset_s - 0.737) / clock.sigma_s)
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_sigma_holds_over_simulated_rides():
    """
    The track filter's own errors, which go on from marker to marker: three rides of three tracks.

    The rms of nine ratios lies within 0.55 to 1.45 at 95 %; a sigma of independent markers
    is four times too small here.
    """
    ratios = []
    for track in ('looping', 'mine', 'launch'):
        for seed in range(1, 4):
            sim = simulate_coaster(track, scenario('clock_offset'), seed)
            (result,) = run_methods(sim.imu, sim.design, CoasterConfig(), ['track_filter_smoothed'])
            clock = fit_clock_offset(result.trajectory, sim.markers.time_s, sim.markers.position)
            ratios.append((clock.offset_s + sim.clock_offset_s) / clock.sigma_s)
    assert 0.55 < np.sqrt(np.mean(np.square(ratios))) < 1.45


def test_text_has_both_figures():
    assert ClockOffset(-0.0123, 0.002, np.empty(0)).text() == '-12 ms +- 4 ms (95 %)'
    assert ClockOffset(75.25, 0.01, np.empty(0)).text() == '75.250 s +- 20 ms (95 %)'
    assert 'not known' in ClockOffset(0.1, float('nan'), np.empty(0)).text()


def test_one_event_gives_the_offset_and_its_sigma():
    """8 m/s from 100 s on: 50 m are passed at 106.25 s; 0.2 m there are 25 ms."""
    clock = offset_from_event(straight(8.0 * np.arange(0.0, 20.0, 0.01)), 6.0, 50.0)
    assert clock.offset_s == pytest.approx(100.25, abs=1e-6)
    assert clock.sigma_s == pytest.approx(0.2 / 8.0, rel=1e-6)


def test_a_jittering_estimate_passes_once():
    """Corrections of 0.15 m throw a live estimate back over the place; the passing is one."""
    s = 8.0 * np.arange(0.0, 20.0, 0.01)
    jitter = np.random.default_rng(1).normal(0.0, 0.15, len(s))
    clock = offset_from_event(straight(s + jitter), 106.25, 50.0)
    assert clock.offset_s == pytest.approx(0.0, abs=0.03)


def test_a_circuit_is_passed_at_its_seam():
    """Laps of 200 m, 1.8 of them from chainage 100 m on: seam and 50 m are passed once."""
    travelled = 100.0 + 8.0 * np.arange(0.0, 35.0, 0.01)
    angle = 2.0 * np.pi * travelled / 200.0
    radius = 200.0 / (2.0 * np.pi)
    position = radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    time = 0.01 * np.arange(len(travelled))
    circuit = Trajectory(time, position, chainage=travelled % 200.0)
    for place, passed in ((50.0, 18.75), (0.01, 12.50125), (199.99, 12.49875)):
        assert offset_from_event(circuit, 0.0, place).offset_s == pytest.approx(passed, abs=0.005)
    with pytest.raises(DataError, match=r'2 times, at 3\.75, 28\.75 s'):
        offset_from_event(circuit, 0.0, 130.0)


def test_events_that_give_no_offset_are_told_apart():
    """Out to 50 m with a rest of 5 s at 30 m, and back to 34 m."""
    out = np.arange(0.0, 30.0, 0.08)
    s = np.concatenate([out, np.full(500, 30.0), np.arange(30.0, 50.0, 0.08)])
    s = np.concatenate([s, s[::-1][:200]])
    with pytest.raises(DataError, match=r'60 m is never passed; the ride goes from 0\.0 to'):
        offset_from_event(straight(s), 0.0, 60.0)
    with pytest.raises(DataError, match=r'stands there, between 103\.7\d and 108\.7'):
        offset_from_event(straight(s), 0.0, 30.1)
    with pytest.raises(DataError, match=r'passed 2 times, at 110\.00, 112\.49 s'):
        offset_from_event(straight(s), 0.0, 40.0)
    with pytest.raises(DataError, match='turns back there, at'):
        offset_from_event(straight(s, 0.01), 0.0, 49.5)
    with pytest.raises(DataError, match='gives no chainage'):
        offset_from_event(ride(), 0.0, 10.0)


def test_a_passing_in_a_gap_is_not_timed():
    whole = straight(8.0 * np.arange(0.0, 20.0, 0.01))
    parts = whole[(whole.time_s < 104.0) | (whole.time_s > 108.0)]
    with pytest.raises(DataError, match='in a gap'):
        offset_from_event(parts, 0.0, 50.0)
    assert offset_from_event(parts, 0.0, 20.0).offset_s == pytest.approx(102.5)

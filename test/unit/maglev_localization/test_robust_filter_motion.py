"""The bank on trains that stand, set out, back and run for hours; its covariances on the way."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helpers.maglev_rider import CONFIG, Rider

from maglev_localization.config import MotionConfig
from maglev_localization.line_kernels import SIZE, B, C, K, V
from maglev_localization.measurements import LoopPosition, RadarSpeed
from maglev_localization.robust_filter import RobustFilter
from track_localization.track.balise_table import BaliseTable

SHARE = 0.5


def test_a_train_that_backs_comes_to_rest_where_it_does(make_train):
    """Braking from -1 m/s to 0 its radar tells nothing below 0.5 m/s: it is not stopped early."""
    base = 1000.0
    rng = np.random.default_rng(16)
    stream = []
    for k in range(1500):
        t = 0.02 * k
        v = -min(t, 1.0) if t < 10.0 else -max(1.0 - 0.2 * (t - 10.0), 0.0)
        s = 500.0 - (0.5 * t * t if t < 1.0 else t - 0.5 if t < 10.0 else 9.5 + backed(t - 10.0))
        stream.append(LoopPosition(base + t, 0.2 * math.floor(s / 0.2), 0.2**2 / 12 + 4e-4))
        if k % 2 == 0:
            told = v + 0.05 * rng.normal() if abs(v) > 0.5 else 0.0
            stream.append(RadarSpeed(base + t + 0.005, float(told), 0.05**2))
    train = make_train(start_m=500.0)
    rider = Rider(train, variance=0.03**2).ride(stream)
    assert rider.estimates[-1].chainage == pytest.approx(500.0 - 9.5 - backed(20.0), abs=0.25)


def backed(seconds):
    """Return the way of a train that brakes from 1 m/s at 0.2 m/s^2 [m]."""
    seconds = min(seconds, 5.0)
    return seconds - 0.1 * seconds**2


BALISES = BaliseTable(
    ('a', 'b', 'c', 'd'), np.array([300.0, 900.0, 1500.0, 2400.0]), np.full(4, 0.05)
)


def test_standstill_holds_the_train(make_train):
    """
    A minute of rest with a radar that trembles: the place does not wander, its sigma neither.

    One reading in eighty is beyond what a radar tells of a train that stands; two such in a row
    look like a departure, until the count is seen to stand: within a crossing all is possible.
    """
    train = make_train(rest_s=60.0, seconds=62.0)
    rng = np.random.default_rng(13)
    stream = [
        z._replace(speed=float(0.2 * rng.normal())) if isinstance(z, RadarSpeed) else z
        for z in train.measurements()
        if z.time_s < 1060.0
    ]
    rider = Rider(train).ride(stream)
    time_s, along, sigma, speed, _ = train.errors(rider.estimates)
    rested = time_s > 1003.0
    wandered = np.abs(along[rested] - along[rested][0])
    assert np.mean(wandered < 0.2) > 0.97
    assert wandered.max() < 0.5
    assert np.mean(np.abs(speed[rested]) < 0.05) > 0.95
    assert sigma[-1] < 1.1 * sigma[rested][0]


@pytest.mark.parametrize('pull', [0.1, 0.5, 1.0])
def test_departure_is_noticed(make_train, pull):
    """From the first crossing on: within a metre and half a metre a second of a gentle start."""
    train = make_train(rest_s=20.0, pull=pull, seconds=60.0)
    rider = Rider(train).ride(train.measurements())
    time_s, along, sigma, speed, sigma_speed = train.errors(rider.estimates)
    after = time_s > 1020.0
    assert np.abs(along - along[time_s < 1020.0][-1])[after].max() < 0.6
    assert np.abs(speed[after]).max() < 0.7
    assert (np.abs(along) < 3.0 * sigma)[after].all()
    assert np.mean((np.abs(speed) < 3.0 * sigma_speed)[after]) > 0.95


def test_a_radar_that_reads_nought_does_not_hold_a_train_that_counts(make_train):
    """It lost the ground at a standstill, and for half a minute: the loop alone tells."""
    train = make_train(rest_s=20.0, seconds=60.0)
    stream = [
        z._replace(speed=0.0) if isinstance(z, RadarSpeed) and z.time_s < 1050.0 else z
        for z in train.measurements()
    ]
    rider = Rider(train, variance=0.05**2).ride(stream)
    time_s, along, _, speed, _ = train.errors(rider.estimates)
    assert np.abs(along[time_s > 1020.0]).max() < 0.6
    assert np.abs(speed[time_s > 1023.0]).max() < 0.5


@pytest.mark.parametrize(
    ('lost_m', 'silent_s'), [(1.0, 0.0), (5.0, 0.0), (30.0, 0.0), (5.0, 1.5), (30.0, 1.5)]
)
def test_departure_over_a_dead_zone_is_told_by_the_radar(make_train, lost_m, silent_s):
    """The count stands while the train sets out, the radar may be silent then: sigma knows it."""
    train = make_train(rest_s=20.0, seconds=40.0)
    held = train.at(1000.0)[0] + lost_m
    stream = [
        z._replace(reading=5.0 if train.at(z.time_s)[0] < held else z.reading - 0.2 * 5 * lost_m)
        if isinstance(z, LoopPosition)
        else z
        for z in train.measurements()
        if not (isinstance(z, RadarSpeed) and 1020.0 < z.time_s < 1020.0 + silent_s)
    ]
    rider = Rider(train, variance=0.05**2).ride(stream)
    time_s, along, sigma, speed, _ = train.errors(rider.estimates)
    told = time_s > 1020.6 + silent_s
    assert np.abs(along[told]).max() < (0.4 if silent_s == 0.0 else 1.5)
    assert (np.abs(along) < 3.0 * sigma)[told].all()
    assert np.abs(speed[time_s > 1022.0 + silent_s]).max() < 0.3


def positive(P):
    """Whether all covariances of a bank are symmetric and positive definite, units apart."""
    d = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    R = P / (d[..., :, None] * d[..., None, :])
    symmetric = np.abs(R - np.swapaxes(R, -1, -2)).max() < 1e-12
    return bool(symmetric and np.isfinite(d).all() and np.linalg.eigvalsh(R)[..., 0].min() > 0.0)


def wild(train, rng):
    """Return a stream in which everything fails now and then."""
    out, shift = [], 0
    for z in train.measurements(rng):
        chance = rng.random()
        if chance < 0.02:
            continue
        if isinstance(z, LoopPosition):
            if chance > 0.995:
                shift += int(rng.integers(-40, 41))
            if chance > 0.9995:
                shift += int(rng.integers(-5_000_000, 5_000_000))
            z = z._replace(reading=z.reading + 0.2 * shift)
        elif isinstance(z, RadarSpeed):
            if chance > 0.95:
                z = z._replace(speed=float(rng.uniform(-50.0, 90.0)))
            elif chance > 0.9:
                z = z._replace(speed=0.0, variance=1e-12)
        elif chance > 0.5:
            z = z._replace(balise=f'b{rng.integers(12)}', variance=1e-9)
        out.append(z)
    return out


@pytest.mark.parametrize('seed', [1, 2])
@pytest.mark.parametrize('line_m', [3e4, 1e6])
def test_covariances_stay_positive_in_a_long_run_of_faults(make_train, seed, line_m):
    """
    Twenty minutes of jumps, outliers, wrong ids and claims of millionths, on 20 Hz and 10 Hz.

    The start is anywhere on a line of up to 1000 km. Smaller tables and rates only make it faster.
    """
    places = tuple(np.arange(500.0, 24_000.0, 1000.0))
    train = make_train(seconds=1000.0, loop_hz=20.0, radar_hz=10.0, balises=places)
    config = dataclasses.replace(
        CONFIG,
        particles=50,
        motion=MotionConfig(start_known=False),
        balise=dataclasses.replace(CONFIG.balise, jitter_s=0.0),
    )
    rider = Rider(train, config, line_m, 0.5 * line_m, (0.5 * line_m) ** 2)
    stream = wild(train, np.random.default_rng(seed))
    for begin in range(0, len(stream), 20):
        rider.ride(stream[begin : begin + 20])
        state = rider.state
        assert positive(state.P)
        assert np.isfinite(state.x).all()
        assert 1 <= len(state.log_w) <= 50
        assert math.isclose(np.exp(state.log_w).sum(), 1.0, rel_tol=1e-9)
        covariance = rider.filter.estimate(state).covariance
        assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_two_hours_without_a_balise(make_train):
    """
    175 km by loop and radar alone: the slope of the count is all that is not known.

    From 1e-4 on it walks 1e-6 in a metre: over L that is sqrt(1e-8 L^2 + 1e-12 L^3 / 3), 46 m.
    """
    train = make_train(seconds=7200.0, top=24.37, loop_hz=5.0, radar_hz=2.0, balises=())
    stream = [
        z._replace(reading=0.2 * math.floor(z.reading * (1.0 + 6e-5) / 0.2))
        if isinstance(z, LoopPosition)
        else z
        for z in train.measurements()
    ]
    rider = Rider(train, length=2e5).ride(stream)
    _, along, sigma, speed, _ = train.errors(rider.estimates)
    length = float(train.at(8200.0)[0])
    assert length > 170e3
    assert positive(rider.state.P)
    assert sigma[-1] == pytest.approx(
        math.sqrt(1e-8 * length**2 + 1e-12 * length**3 / 3.0), rel=0.05
    )
    assert np.abs(speed[1000:]).max() < 0.3
    assert (np.abs(along) < 3.0 * sigma).all()


def test_start_spreads_what_is_not_known():
    """Speed, scale and slope as set; both locals have the same, and fused give the start back."""
    rider = RobustFilter(CONFIG, BALISES, 3000.0).start(5.0, 700.0, 4.0)
    x, P = rider.x[0], SHARE * rider.P[0]
    assert x[:, C] - x[:, B] == pytest.approx(700.0)
    assert np.array_equal(x[0], x[1])
    assert np.array_equal(P[0], P[1])
    assert P[0][B, B] == pytest.approx(4.0)
    assert np.sqrt(P[0][V, V]) == pytest.approx(30.0)
    assert np.sqrt(P[0][K, K]) == pytest.approx(CONFIG.radar.scale_sigma)
    assert P.shape == (2, SIZE, SIZE)

"""The bank on readings by hand: whichever way the sensors fail, the right account wins soon."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.maglev_rider import Rider

from maglev_localization import hearing
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed


def jumped(stream, when_s, crossings, pitch=0.2, until_s=math.inf):
    """Return the stream with the loop's readings changed by so many crossings from a stamp on."""
    return [
        z._replace(reading=z.reading + crossings * pitch)
        if isinstance(z, LoopPosition) and when_s <= z.time_s < until_s
        else z
        for z in stream
    ]


@pytest.mark.parametrize('crossings', [-1, 1, -2, -17, 40, -60, -200, -2400])
@pytest.mark.parametrize('when_s', [1015.0, 1060.0])
def test_a_count_that_jumps_is_seen_through(train, crossings, when_s):
    """
    A missed crossing, an extra one, a burst, a glitch, a dead zone: at 11 m/s and at 25 m/s.

    No error is a crossing at any time half a second after, and at the next balise nothing is to be
    mended. Before the first balise 1 m of the start is left: there only the change counts.
    """
    clean = Rider(train).ride(train.measurements())
    rider = Rider(train).ride(jumped(train.measurements(), when_s, crossings))
    along, _ = rider.errors(when_s + 0.5)
    expected, sigma = clean.errors(when_s + 0.5)
    change = np.abs(along - expected)
    assert change.max() < 0.15
    assert (np.abs(along) <= 3.5 * rider.errors(when_s + 0.5)[1]).all()
    assert sigma.max() < 1.2
    if abs(crossings) > 3:
        first = next(t for t in rider.said(LoopPosition, hearing.SHIFT) if t >= when_s)
        assert first < when_s + 0.05


def test_a_reading_that_means_nothing_is_passed_over(train):
    """One reading 33 crossings off, and back: two jumps or none, the train stays."""
    stream = train.measurements()
    i = next(i for i, z in enumerate(stream) if isinstance(z, LoopPosition) and z.time_s > 1060.0)
    stream[i] = stream[i]._replace(reading=stream[i].reading + 6.6)
    clean, rider = (Rider(train).ride(s) for s in (train.measurements(), stream))
    assert np.abs(rider.errors(1060.0)[0] - clean.errors(1060.0)[0]).max() < 0.1


@pytest.mark.parametrize('zero_m', [0.0, -1234.4, 9e6])
def test_a_counter_that_starts_over_at_nought(make_train, zero_m):
    """From any number, at 25 m/s: a jump like any other."""
    train = make_train(zero_m=-zero_m)
    stream = train.measurements()
    first = next(z.reading for z in stream if isinstance(z, LoopPosition) and z.time_s > 1060.0)
    stream = jumped(stream, 1060.0, -round(first / 0.2))
    rider = Rider(train).ride(stream)
    along, sigma = rider.errors(1060.5)
    assert np.abs(along).max() < 0.4
    assert (np.abs(along) < 3.5 * sigma).all()


def test_a_counter_that_freezes_and_goes_on(train):
    """Ten seconds at 25 m/s without a count: the radar carries on, then the offset is another."""
    held = {}
    stream = []
    for z in train.measurements():
        if isinstance(z, LoopPosition) and z.time_s >= 1060.0:
            lost = held.setdefault('lost', z.reading)
            if z.time_s < 1070.0:
                z = z._replace(reading=lost)
            else:
                z = z._replace(reading=z.reading - held.setdefault('unseen', z.reading - lost))
        stream.append(z)
    rider = Rider(train).ride(stream)
    along, sigma = rider.errors(train.passing_s(300.0))
    assert (np.abs(along) < 3.5 * sigma).all()
    along, sigma = rider.errors(train.passing_s(2000.0))
    assert np.abs(along).max() < 0.4
    assert sigma.max() < 0.2


def test_crossings_missed_one_by_one_are_learnt(make_train):
    """
    One in 300 is missed, ten times as many as set: errors stay, the share is found.

    Not at a speed that is a whole number of crossings from reading to reading, where a missed one
    is hard to tell from rounding.
    """
    train = make_train(seconds=200.0, top=39.0, balises=tuple(np.arange(300.0, 7000.0, 600.0)))
    rng = np.random.default_rng(12)
    missed = np.cumsum(rng.random(50_000) < 1.0 / 300.0)
    stream = [
        z._replace(reading=0.2 * (round(z.reading / 0.2) - missed[round(z.reading / 0.2)]))
        if isinstance(z, LoopPosition)
        else z
        for z in train.measurements()
    ]
    rider = Rider(train, length=9000.0).ride(stream)
    along, sigma = rider.errors(train.passing_s(900.0))
    assert np.sqrt(np.mean(along**2)) < 0.3
    assert np.mean(np.abs(along) < 2.0 * sigma) > 0.9
    assert 3e-4 < rider.state.missed_share < 1.0 / 150.0


@pytest.mark.parametrize(('scale', 'seconds'), [(0.03, 8.0), (-0.03, 15.0)])
def test_a_radar_that_slips(train, scale, seconds):
    """Its scale changes at once, and back: the loop tells, and the speed follows neither."""
    stream = [
        z._replace(speed=z.speed * (1.0 + scale))
        if isinstance(z, RadarSpeed) and 1050.0 < z.time_s < 1050.0 + seconds
        else z
        for z in train.measurements()
    ]
    rider = Rider(train).ride(stream)
    time_s, along, _, speed, _ = train.errors(rider.estimates)
    assert np.abs(along[time_s > train.passing_s(300.0)]).max() < 0.4
    assert np.abs(speed[time_s > 1030.0]).max() < 0.4


@pytest.mark.parametrize('sensor', [LoopPosition, RadarSpeed])
def test_a_sensor_that_claims_too_little_noise_is_not_believed_more_than_it_merits(train, sensor):
    """0.3 m and 0.5 m/s of white noise, claimed as a tenth: the train stays on the line."""
    rng = np.random.default_rng(14)
    stream = []
    for z in train.measurements():
        if isinstance(z, sensor):
            if isinstance(z, LoopPosition):
                noisy = float(train.at(z.time_s)[0] + 0.3 * rng.normal())
                z = LoopPosition(z.time_s, noisy, 0.03**2)
            elif z.speed > 0.0:
                z = RadarSpeed(z.time_s, float(z.speed + 0.5 * rng.normal()), 0.05**2)
        stream.append(z)
    rider = Rider(train).ride(stream)
    along, sigma = rider.errors(train.passing_s(300.0) + 1.0)
    assert np.abs(along).max() < 0.5
    assert np.mean(np.abs(along) < 2.0 * sigma) > 0.9


@pytest.mark.parametrize(('told', 'says'), [('b1', hearing.PLAIN), ('b3', hearing.NEARBY)])
def test_a_balise_is_known_by_its_place(train, told, says):
    stream = [
        z._replace(balise=told) if getattr(z, 'balise', '') == 'b1' else z
        for z in train.measurements()
        if z.time_s < train.passing_s(900.0) + 1.0
    ]
    rider = Rider(train).ride(stream)
    assert rider.said(BalisePassing, says)[-1] == train.passing_s(900.0)
    assert np.abs(rider.errors(train.passing_s(900.0))[0]).max() < 0.3


def test_a_train_far_astray_is_found_by_two_balises(train):
    """
    The start is 480 m wrong and claims 1 m: after one balise it may be, after two it is sure.

    Between them loop and radar tell nothing of the place, so the doubt stays as it is.
    """
    rider = Rider(train, chainage=485.03).ride(train.measurements())
    time_s, along, sigma, *_ = train.errors(rider.estimates)
    first, second = train.passing_s(300.0), train.passing_s(900.0)
    between = (time_s > first) & (time_s < second)
    assert np.abs(along[between]).max() < 1.0
    assert sigma[between].min() > 100.0
    assert np.ptp(sigma[between]) < 0.1 * sigma[between].mean()
    assert np.abs(along[time_s > second]).max() < 0.4
    assert sigma[time_s > second].max() < 0.2


def test_a_wrong_id_far_away_does_not_carry_the_train_off(train):
    """Heard between two balises, it tells one far away: sigma opens until the next is heard."""
    stray = BalisePassing(1055.0, 'b3', 0.0, 0.02**2)
    stream = sorted([*train.measurements(), stray], key=lambda z: z.time_s)
    rider = Rider(train).ride(stream)
    time_s, along, sigma, *_ = train.errors(rider.estimates)
    assert (np.abs(along) < 3.5 * sigma)[time_s > 1055.0].all()
    assert np.abs(along[time_s > train.passing_s(1500.0)]).max() < 0.4

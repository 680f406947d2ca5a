"""What readings of a counter mean: crossings, bounds, departures, distances that are no counts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from maglev_localization import counting
from maglev_localization.config import LoopConfig
from maglev_localization.counting import Counting
from maglev_localization.measurements import LoopPosition, RadarSpeed

LOOP = LoopConfig()
CLAIMED = 0.2**2 / 12.0 + 0.02**2


def hear_all(readings, speed, dt=0.02, loop=LOOP, variance=CLAIMED):
    """Return the memory, and what every reading says, at a predicted speed."""
    memory, told = Counting.begin(100.0), []
    for k, reading in enumerate(readings):
        z = LoopPosition(100.0 + k * dt, float(reading), variance)
        memory, crossing = counting.hear(memory, z, speed, loop)
        told.append(crossing)
    return memory, told


def counted(s, pitch=0.2):
    return pitch * np.floor(np.asarray(s) / pitch + 1e-9)


def test_the_first_reading_is_known_within_the_pitch():
    memory, (crossing,) = hear_all([7.4], 0.0)
    assert crossing.position == pytest.approx(7.5)
    assert crossing.variance == pytest.approx(0.2**2 / 12.0 + CLAIMED)
    assert (memory.reading, memory.sampled_s, memory.changed_s) == (7.4, 100.0, 100.0)


@pytest.mark.parametrize('speed', [0.307, 3.07, 9.13, 27.8, -3.07, -27.8])
def test_changed_readings_are_unbiased_and_their_variance_true(speed):
    """
    Over 4000 readings at a steady speed, forward or back: what they say less the truth.

    The mean of a uniform error over that many is good to 2 % of the pitch; its variance to 10 %
    (speeds are such that stamps and crossings do not beat). Backward a crossing is counted where
    the train comes to it, from above.
    """
    s = 500.0 + speed * (0.02 * np.arange(4000) + 1e-4 * math.pi)
    _, told = hear_all(counted(s), speed)
    told = [
        (c.position - place, c.variance)
        for c, place in zip(told[1:], s[1:], strict=True)
        if c and c.moved
    ]
    error, variance = np.array(told).T
    assert len(error) > 100
    assert np.mean(error) == pytest.approx(0.0, abs=0.004)
    assert np.var(error) + 0.02**2 == pytest.approx(np.mean(variance), rel=0.1)


def test_readings_in_step_are_no_more_than_a_few():
    """
    At 20 m/s and 50 Hz two crossings each: rounded alike.

    At 19.6 m/s not for a quarter of a second; once a second, no train keeps step.
    """
    base = 0.2**2 / 12.0
    cases = ((20.0, 0.02, 3.0), (19.6, 0.02, 1.0), (19.9, 0.1, 3.0), (20.0, 1.0, 1.0))
    for speed, dt, times in cases:
        _, told = hear_all(counted(100.0 + speed * dt * np.arange(5) + 0.01), speed, dt)
        assert told[-1].variance == pytest.approx(times * base + 0.02**2, rel=1e-6)


def test_expected_crossings_and_travel():
    """20 m/s over 20 ms are 0.4 m: two crossings of 0.2 m; travel adds one for what was left."""
    _, told = hear_all(counted(100.0 + 20.0 * 0.02 * np.arange(5)), 20.0)
    assert told[-1].crossings == pytest.approx(2.0)
    assert told[-1].travel == pytest.approx(0.4 + 0.2)
    _, told = hear_all(counted(100.0 + 0.02 * np.arange(30)), 1.0)
    assert told[10].crossings == 1.0


def test_a_standing_count_tells_bounds_now_and_then_to_a_slow_train():
    """Every 0.2 s, the whole pitch; nothing at all to one that runs, as over a dead zone."""
    _, told = hear_all([50.0] * 100, 0.4)
    bounds = [c for c in told[1:] if c is not None]
    assert len(bounds) == pytest.approx(2.0 / 0.2, abs=2)
    for crossing in bounds:
        assert not crossing.moved
        assert crossing.position == pytest.approx(50.1)
        assert crossing.variance == pytest.approx(0.2**2 / 12.0 + 0.02**2)
    assert hear_all([50.0] * 100, 27.0)[1][1:] == [None] * 99


def test_a_standing_count_tells_no_bounds_while_a_living_radar_says_that_the_train_moves():
    memory, _ = hear_all([50.0] * 100, 0.4)
    for speed, radar_s, moves in ((0.6, 101.9, True), (0.1, 101.9, False), (0.6, 100.5, False)):
        told = memory._replace(radar_mps=speed, radar_s=radar_s)
        z = LoopPosition(102.2, 50.0, CLAIMED)
        assert (counting.hear(told, z, 0.4, LOOP)[1] is None) == moves
    frozen = memory._replace(radar_mps=0.6, radar_s=101.9, radar_same=5)
    assert counting.hear(frozen, z, 0.4, LOOP)[1] is not None


@pytest.mark.parametrize(
    ('standing', 'change', 'departed'), [(160, 0.2, True), (160, 0.4, False), (140, 0.2, False)]
)
def test_departure_is_one_crossing_after_a_standstill(standing, change, departed):
    """More at once is a jump of the counter; sooner than 3 s it may be the last of the braking."""
    _, told = hear_all([50.0] * standing + [50.0 + change], 0.0)
    assert told[-1].moved
    assert told[-1].departed == departed


def test_claimed_noise_beside_the_pitch_is_believed_and_less_than_the_least_is_not():
    s = counted(100.0 + 25.0 * 0.02 * np.arange(5))
    base = 0.2**2 / 12.0
    for claimed, noise in ((base + 0.05**2, 0.05**2), (1e-9, 0.02**2), (1.0, 1.0 - base)):
        _, told = hear_all(s, 25.0, variance=claimed)
        assert told[-1].variance == pytest.approx(base + noise, rel=1e-6)


@pytest.mark.parametrize('noise', [0.02, 0.05, 0.3])
@pytest.mark.parametrize('speed', [0.0, 5.0, 27.8])
def test_distances_that_are_no_counts_are_found_out(noise, speed):
    """After a score of readings the pitch is forgotten: unbiased, the claimed variance believed."""
    rng = np.random.default_rng(4)
    s = 500.0 + speed * 0.02 * np.arange(2000)
    memory, told = hear_all(s + noise * rng.normal(size=2000), speed, variance=noise**2)
    error = np.array([c.position for c in told[20:]]) - s[20:]
    assert memory.pitch(LOOP) == 0.0
    assert {c.pitch for c in told[20:]} == {0.0}
    assert np.mean(error) == pytest.approx(0.0, abs=0.1 * noise)
    assert told[-1].variance == pytest.approx(max(noise, 0.02) ** 2)


@pytest.mark.parametrize('pitch', [0.5, 0.3, 0.07, 0.9])
def test_a_pitch_that_is_not_the_one_set_is_found_out(pitch):
    """The reading is then the distance itself, as uncertain as the sender says."""
    s = 500.0 + 20.0 * 0.02 * np.arange(300)
    memory, told = hear_all(counted(s, pitch), 20.0, variance=pitch**2 / 12.0)
    assert memory.pitch(LOOP) == 0.0
    assert told[-1].position == counted(s, pitch)[-1]
    assert told[-1].variance == pytest.approx(max(pitch**2 / 12.0, 0.02**2))


@pytest.mark.parametrize('factor', [1.0, 1.0002, 0.9995])
def test_counts_stay_counts(factor):
    """Misses, bursts, jumps of whole crossings, one that is not, a slope: the pitch is believed."""
    rng = np.random.default_rng(8)
    count = np.cumsum(rng.integers(0, 5, 3000))
    count[1000:] -= 17
    count[2000:] += 40
    readings = 0.2 * factor * count
    readings[2500:] += 0.137
    memory, told = hear_all(readings, 20.0)
    assert memory.pitch(LOOP) == 0.2
    assert {c.pitch for c in told if c is not None} == {0.2}


def test_a_counter_mended_is_believed_again():
    rng = np.random.default_rng(9)
    s = 500.0 + 0.4 * np.arange(400)
    wild = np.where(np.arange(400) < 200, s + 0.05 * rng.normal(size=400), counted(s))
    assert hear_all(wild[:200], 20.0)[0].pitch(LOOP) == 0.0
    assert hear_all(wild, 20.0)[0].pitch(LOOP) == 0.2


def test_without_a_pitch_there_is_nothing_to_find_out():
    loop = dataclasses.replace(LOOP, pitch_m=0.0)
    memory, told = hear_all([5.0, 5.0, 5.3, 4.9], 0.0, loop=loop, variance=0.01)
    assert memory.uneven == 0.0
    assert [c.position for c in told] == [5.0, 5.0, 5.3, 4.9]
    assert all(c.variance == pytest.approx(0.01) and c.moved for c in told)


def test_noise_that_is_greater_than_claimed_is_found_out():
    """Ten times: the mean NIS of 100 comes down to 1.5; one surprise in a while is forgotten."""
    rng = np.random.default_rng(15)
    doubt, found = 0.0, []
    for nu in 10.0 * rng.normal(size=2000):
        doubt = counting.doubted(doubt, nu * nu / math.exp(doubt), False)
        found.append(doubt)
    assert np.mean(np.exp(found[500:])) == pytest.approx(100.0 / 1.5, rel=0.35)
    doubt, found = 0.0, []
    for k, nu in enumerate(rng.normal(size=5000)):
        doubt = counting.doubted(doubt, nu * nu / math.exp(doubt), k % 100 == 0)
        found.append(doubt)
    assert np.mean(np.exp(found)) < 1.15
    assert counting.doubted(0.3, math.nan, False) == 0.3


def test_heading_is_that_of_the_last_speed_worth_the_name():
    memory = Counting.begin(100.0)
    assert memory.headed(-0.4, 0.5).heading == 1.0
    assert memory.headed(-0.6, 0.5).heading == -1.0
    assert memory.headed(-0.6, 0.5).headed(0.2, 0.5).heading == -1.0


def test_a_standing_counter_may_tremble():
    """A few centimetres are no crossing: the train does not go back and forth."""
    rng = np.random.default_rng(10)
    s = np.concatenate([counted(np.arange(100) * 0.4), np.full(100, 39.6)])
    _, told = hear_all(s + 0.002 * rng.normal(size=200), 0.0)
    assert not any(c.moved for c in told[101:] if c is not None)


def radar_after(memory, *speeds):
    for k, speed in enumerate(speeds):
        memory = counting.hear_radar(memory, RadarSpeed(200.0 + 0.05 * k, speed, 0.01))
    return memory


def test_a_radar_that_repeats_itself_is_frozen():
    memory = Counting.begin(100.0)
    assert not radar_after(memory, 20.1, 20.1, 20.1).frozen
    assert radar_after(memory, 20.1, 20.1, 20.1, 20.1).frozen
    assert not radar_after(memory, 20.1, 20.1, 20.1, 20.1, 20.2).frozen
    assert not radar_after(memory, 0.0, 0.0, 0.0, 0.0, 0.0).frozen


@pytest.mark.parametrize(
    ('changed', 'sampled', 'radar', 'speed', 'told', 'sigma'),
    [
        (-2.0, -0.01, -0.02, 0.1, -1.0, 0.05),
        (-20.0, -0.01, -0.02, -0.1, -1.0, 0.02),
        (-0.9, -0.01, -0.02, 0.1, -1.0, 0.0),
        (-2.0, -1.1, -0.02, 0.1, -1.0, 0.0),
        (-2.0, -0.01, -1.1, 0.1, -1.0, 0.0),
        (-2.0, -0.01, -0.02, 0.31, -1.0, 0.0),
        (-2.0, -0.01, -0.02, 0.1, -0.1, 0.0),
    ],
)
def test_standstill_needs_a_living_count_and_a_living_radar(
    changed, sampled, radar, speed, told, sigma
):
    """Half a crossing in the time that the count has stood; not told again within 0.2 s."""
    now = 500.0
    memory = Counting(50.0, now + sampled, now + changed, now, speed, now + radar, now + told)
    assert memory.still_sigma(now) == pytest.approx(sigma)


def test_how_far_a_train_may_have_gone_unseen():
    """To 0.5 m/s at 0.3 m/s^2; at 1.5 m/s^2 in a silence, of which five seconds count."""
    stood = Counting(50.0, 499.9, 490.0, 499.9, 0.0, 499.95, 499.9)

    def unseen(memory, speed):
        return memory.unseen(RadarSpeed(500.0, speed, 0.01), 0.5)

    assert unseen(stood, 0.6) == pytest.approx((0.419, 0.575), abs=1e-3)
    assert unseen(stood, -0.6) == pytest.approx((-0.419, 0.575), abs=1e-3)
    assert unseen(stood._replace(radar_s=498.0), 3.0) == pytest.approx((3.417, 3.5), abs=1e-3)
    assert unseen(stood._replace(radar_s=400.0), 3.0)[1] == pytest.approx(8.0)
    assert unseen(stood._replace(changed_s=499.95), 0.6) == (0.0, 0.0)


def test_nothing_heard_is_no_standstill():
    assert Counting.begin(100.0).still_sigma(105.0) == 0.0

"""The true motion: from stop to stop within the limits of jerk, or as the paper's train."""

import itertools

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.settings import override
from track_localization.sim.maglev.config import Line, MotionErrors
from track_localization.sim.maglev.motion import Motion, leg_times, plan_motion, stops_of


def planned(seed=1, line=None, **changes):
    return plan_motion(
        np.random.default_rng(seed),
        override(Line(), line or {}),
        override(MotionErrors(), changes),
    )


def sampled(motion, dt=0.01):
    t = np.arange(round(motion.duration_s / dt) + 1) * dt
    return t, *motion.at(t)


def even(speed=20.0, duration=100.0, start=0.0):
    """Return motion at an even speed, by its closed form."""
    s = np.array([start, start + speed * duration])
    return Motion(np.array([0.0, duration]), s, np.array([speed] * 2), np.zeros(2), np.zeros(1))


def test_a_long_leg_takes_its_closed_form():
    """D/v + v/a + a/j: the time of a trapezoid of speed, and of rounding its corners."""
    assert leg_times(1700.0, 27.8, 1.0, 0.5).sum() == pytest.approx(1700 / 27.8 + 27.8 + 2.0)


@pytest.mark.parametrize('length', [0.01, 1.0, 7.9, 8.1, 50.0, 400.0, 900.0, 30000.0])
@pytest.mark.parametrize(('speed', 'acceleration', 'jerk'), [(27.8, 1.0, 0.5), (1.5, 1.0, 0.5)])
def test_any_leg_ends_at_rest_where_it_should(length, speed, acceleration, jerk):
    """Jerk integrated by small steps leads to rest, ``length`` further on, within all limits."""
    spans = leg_times(length, speed, acceleration, jerk)
    assert (spans >= 0.0).all()
    steps = 20000
    dt = np.repeat(spans / steps, steps)
    j = np.repeat(jerk * np.array([1, 0, -1, 0, -1, 0, 1]), steps)
    a = np.cumsum(j * dt)
    v = np.cumsum((a - 0.5 * j * dt) * dt)
    s = np.cumsum((v - 0.5 * a * dt) * dt)
    assert a[-1] == pytest.approx(0.0, abs=1e-9)
    assert v[-1] == pytest.approx(0.0, abs=1e-7)
    assert s[-1] == pytest.approx(length, rel=1e-6)
    assert np.abs(a).max() <= acceleration * (1 + 1e-9)
    assert v.max() <= speed * (1 + 1e-6)
    # One of the limits of speed and acceleration binds, or the jerk does throughout: no quicker.
    bound = np.array([v.max() / speed, np.abs(a).max() / acceleration])
    assert bound.max() > 1.0 - 1e-6 or spans[[1, 3, 5]].sum() < 1e-9


def test_limits_hold_on_the_line():
    """Speed, acceleration and jerk, by differences of the 100 Hz truth."""
    t, s, v, a = sampled(planned())
    assert v.min() >= -1e-9
    assert v.max() == pytest.approx(27.8)
    assert np.abs(a).max() == pytest.approx(1.0)
    assert np.abs(np.diff(a) / np.diff(t)).max() <= 0.5 + 1e-9
    assert np.diff(s).min() >= -1e-9


def test_speed_and_acceleration_are_the_derivatives():
    """Central differences err by dt^2/6 of the third derivative, 0.5 m/s^3; jumps of it by dt."""
    _, s, v, a = sampled(planned())
    np.testing.assert_allclose((s[2:] - s[:-2]) / 0.02, v[1:-1], atol=1e-5)
    np.testing.assert_allclose((v[2:] - v[:-2]) / 0.02, a[1:-1], atol=0.5 * 0.01)


def test_stands_at_every_stop_for_its_dwell():
    """Five stops of 20 s; nothing moves there, at all."""
    _, s, v, _ = sampled(planned())
    for stop in (0.0, 1700.0, 3300.0, 5200.0, 7000.0):
        standing = s == stop
        assert standing.sum() == pytest.approx(2000, abs=2)
        assert (v[standing] == 0.0).all()


def test_dwell_is_drawn_uniformly():
    """Random dwells of 100 runs fill their span; their mean is 30 s, sigma 5.8 s over 20 draws."""
    motions = [planned(seed, dwell_s=(20.0, 40.0)) for seed in range(100)]
    moving = planned(dwell_s=(0.0, 0.0)).duration_s
    mean = np.array([(m.duration_s - moving) / 5 for m in motions])
    assert mean.mean() == pytest.approx(30.0, abs=4 * 5.8 / np.sqrt(500))
    assert ((mean > 20.0) & (mean < 40.0)).all()


def test_without_dwell_it_only_touches_rest():
    motion = planned(dwell_s=(0.0, 0.0))
    legs = np.diff([0.0, 1700.0, 3300.0, 5200.0, 7000.0])
    assert motion.duration_s == pytest.approx((legs / 27.8 + 27.8 + 2.0).sum())


def test_sections_follow_each_other():
    """Three sections: the end of one is the beginning of the next."""
    line = override(Line(), {'stops_m': '0, 600 1000', 'length_m': 1000.0, 'sections': 3})
    np.testing.assert_array_equal(stops_of(line), [0, 600, 1000, 1600, 2000, 2600, 3000])


def test_passing_times_by_their_closed_form():
    """At an even speed; the place of the start was not passed, the end was, nothing beyond."""
    times = even(20.0, 100.0, start=500.0).passing_times(
        np.array([499.0, 500.0, 510.0, 1234.5, 2500.0, 2500.1])
    )
    np.testing.assert_allclose(times[2:5], [0.5, 36.725, 100.0], atol=1e-9)
    assert np.isnan(times[[0, 1, 5]]).all()


def test_passing_times_on_the_line():
    """The train is there then; a stop's own time is that of arrival, not of departure."""
    motion = planned()
    place = np.array([3.0, 999.97, 1700.0, 6999.999])
    times = motion.passing_times(place)
    np.testing.assert_allclose(motion.at(times)[0], place, atol=1e-9)
    assert times[2] == pytest.approx(20.0 + 1700 / 27.8 + 29.8, abs=0.01)


def test_a_start_between_stops_at_a_standstill():
    motion = planned(start_chainage_m=(2500.0, 2500.0))
    _, s, v, _ = sampled(motion)
    assert (s[:1990] == 2500.0).all()
    assert s[-1] == 7000.0
    assert v[5000] > 1.0


def test_a_start_between_stops_at_speed():
    """It runs as it would have run from the stop before."""
    moving = planned(start_chainage_m=(2500.0, 2500.0), start_moving=True)
    whole = planned()
    passed = whole.passing_times(np.array([2500.0]))[0]
    t = np.linspace(0.0, 60.0, 601)
    for begun, full in zip(moving.at(t), whole.at(t + passed), strict=True):
        np.testing.assert_allclose(begun, full, atol=1e-6)


def test_random_starts_fill_their_span():
    """Uniform from 1000 to 3000 m: the mean of 200 within four sigma, 577 m over 200 draws."""
    starts = [
        float(planned(seed, start_chainage_m=(1000.0, 3000.0), start_moving=True).s[0])
        for seed in range(200)
    ]
    assert np.mean(starts) == pytest.approx(2000.0, abs=4 * 577 / np.sqrt(200))
    assert min(starts) >= 1000.0
    assert max(starts) <= 3000.0


def test_the_papers_train_follows_its_equation():
    """x(k+1) = F x(k) + G W(k), second by second; var W = 0.001 over 50 runs."""
    F = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    G = np.array([1.0 / 6.0, 0.5, 1.0])
    drawn = []
    for seed in range(50):
        motion = planned(seed, profile='accelerating')
        x = np.stack(motion.at(np.arange(101.0)), axis=1)
        np.testing.assert_array_equal(x[0], [0.0, 20.0, 1.0])
        w = np.diff(x[:, 2])
        np.testing.assert_allclose(x[1:], x[:-1] @ F.T + w[:, None] * G, rtol=1e-12)
        drawn.append(w)
    # 5000 draws: the variance's own sigma is sqrt(2/5000) = 2 %.
    assert np.var(drawn) == pytest.approx(0.001, rel=0.08)
    assert np.mean(drawn) == pytest.approx(0.0, abs=4 * np.sqrt(0.001 / 5000))


def test_without_jerk_the_papers_train_is_a_parabola():
    motion = planned(profile='accelerating', jerk_variance=0.0, duration_s=10.5)
    assert motion.duration_s == 10.5
    s, v, a = motion.at(np.array([10.5]))
    assert (s[0], v[0], a[0]) == pytest.approx((20 * 10.5 + 0.5 * 10.5**2, 30.5, 1.0))


@pytest.mark.parametrize(
    ('line', 'changes', 'words'),
    [
        ({'stops_m': '0 here 3'}, {}, ['line.stops_m', 'not numbers']),
        ({'stops_m': '0 3000 2000'}, {}, ['line.stops_m', 'increasing']),
        ({'stops_m': '0 0 2000'}, {}, ['line.stops_m', 'increasing']),
        ({'stops_m': '100'}, {}, ['line.stops_m', 'two or more']),
        ({'stops_m': ''}, {}, ['line.stops_m', 'two or more']),
        ({'stops_m': '0 nan'}, {}, ['line.stops_m', 'increasing']),
        ({'stops_m': '0 8000'}, {}, ['line.stops_m', 'line.length_m']),
        ({'stops_m': '-5 100'}, {}, ['line.stops_m', 'leave the line']),
        ({}, {'start_chainage_m': (0.0, 7000.0)}, ['motion.start_chainage_m', '7000']),
        ({'stops_m': '9 99'}, {}, ['motion.start_chainage_m', '9.0 m']),
        (
            {},
            {'profile': 'accelerating', 'jerk_variance': 9.0, 'start_speed_mps': 0.0},
            ['motion.jerk_variance', 'backward'],
        ),
    ],
)
def test_settings_that_contradict_each_other(line, changes, words):
    with pytest.raises(DataError) as caught:
        planned(2, line, **changes)
    for word in words:
        assert word in str(caught.value)


def test_stretches_meet():
    """Where one ends the next begins: no jump of place, speed or acceleration on the line."""
    motion = planned()
    for t in motion.time_s[1:-1]:
        before, after = motion.at(np.array([t - 1e-9])), motion.at(np.array([t + 1e-9]))
        for x, y in itertools.zip_longest(before, after):
            np.testing.assert_allclose(x, y, atol=1e-7)

"""Whether sensors are named right: waiting, ok, silent, isolated; and their mean NIS."""

from __future__ import annotations

import math

import pytest

from maglev_localization.health import SensorHealth


def running(seconds=3.0, refused=False, sensor='radar', health=None, begin=0.0):
    """Return health after so long of a sensor at 20 Hz, judged at every reading."""
    health = SensorHealth() if health is None else health
    for k in range(1, round(20 * seconds) + 1):
        health.heard(sensor, begin + 0.05 * k, refused, math.nan)
        health.judge(begin + 0.05 * k, 0.0)
    return health


def test_a_sensor_never_heard_is_waited_for():
    health = running()
    assert health.states == {'loop': 'waiting', 'radar': 'ok', 'balise': 'waiting'}
    assert health.changes == [(0.05, 'radar', 'ok')]


def test_silence_is_told_after_a_second_and_ends_with_the_next_reading():
    health = running()
    health.judge(3.9, 0.0)
    assert health.states['radar'] == 'ok'
    health.judge(4.1, 0.0)
    assert health.states['radar'] == 'silent'
    health.heard('radar', 4.2, False, math.nan)
    health.judge(4.2, 0.0)
    assert [state for _, _, state in health.changes] == ['ok', 'silent', 'ok']


def test_a_slow_sensor_is_not_silent_between_its_readings():
    """Once in 1.5 s: silent after three such intervals."""
    health = SensorHealth()
    for k in range(60):
        health.heard('radar', 1.5 * k, False, math.nan)
        health.judge(1.5 * k + 1.4, 0.0)
    silent = [time_s for time_s, _, state in health.changes if state == 'silent']
    assert all(time_s < 10.0 for time_s in silent)
    assert health.states['radar'] == 'ok'
    health.judge(1.5 * 59 + 4.4, 0.0)
    assert health.states['radar'] == 'ok'
    health.judge(1.5 * 59 + 4.6, 0.0)
    assert health.states['radar'] == 'silent'


def test_balises_are_seldom_and_never_silent():
    health = SensorHealth()
    health.heard('balise', 10.0, False, math.nan)
    health.judge(500.0, 0.0)
    assert health.states['balise'] == 'ok'


def test_a_sensor_whose_readings_are_refused_is_isolated_and_believed_again():
    """Refused for a second: 1 - 1/e of its memory; good for so long that a tenth is left."""
    health = running(3.0)
    running(0.65, True, health=health, begin=3.0)
    assert health.states['radar'] == 'ok'
    running(0.1, True, health=health, begin=3.65)
    assert health.states['radar'] == 'isolated'
    running(1.5, False, health=health, begin=3.75)
    assert health.states['radar'] == 'isolated'
    running(0.3, False, health=health, begin=5.25)
    assert health.states['radar'] == 'ok'
    assert [time_s for time_s, *_ in health.changes] == pytest.approx([0.05, 3.70, 5.40], abs=0.11)


def test_single_refusals_are_borne():
    """One in four, over a minute."""
    health = SensorHealth()
    for k in range(1, 1201):
        health.heard('radar', 0.05 * k, k % 4 == 0, math.nan)
        health.judge(0.05 * k, 0.0)
    assert [state for _, _, state in health.changes] == ['ok']


def test_a_count_that_stands_under_way_is_isolated():
    health = running(sensor='loop')
    health.judge(3.05, 4.9)
    assert health.states['loop'] == 'ok'
    health.judge(3.1, 5.1)
    assert health.states['loop'] == 'isolated'
    health.judge(3.15, 0.0)
    assert health.states['loop'] == 'ok'


def test_late_readings_do_not_turn_time_back():
    health = running()
    health.heard('radar', 1.0, True, math.nan)
    health.judge(3.5, 0.0)
    assert health.states['radar'] == 'ok'


def test_nis_is_a_mean_over_some_twenty_readings():
    """From the first on; what was not used has none."""
    health = SensorHealth()
    assert math.isnan(health.nis['loop'])
    health.heard('loop', 1.0, False, 3.0)
    assert health.nis['loop'] == 3.0
    for k in range(200):
        health.heard('loop', 1.0 + k, False, math.nan if k % 2 else 1.0)
    assert health.nis['loop'] == pytest.approx(1.0 + 2.0 * 0.95**100, rel=1e-9)

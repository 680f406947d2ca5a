"""Stamps in order of arrival: repeated, late, ahead alone, gaps, a recording that starts over."""

from __future__ import annotations

import math

import pytest

from track_localization.estimation.stamps import Stamps


def judged(stamps, given, sensor='loop'):
    """Return what becomes of each stamp of one sensor."""
    return [stamps.refuse(sensor, time_s) for time_s in given]


def running(**settings):
    """Return stamps after a second of loop and radar from 1000 s on."""
    stamps = Stamps(1.5, **settings)
    for k in range(101):
        for sensor in ('loop', 'radar'):
            assert stamps.refuse(sensor, 1000.0 + 0.01 * k) is None
    return stamps


def test_good_stamps_of_several_sensors_are_taken():
    """In order or not, within the horizon."""
    stamps = Stamps(1.5)
    assert judged(stamps, [10.0, 10.5, 10.2, 11.9]) == [None] * 4
    assert judged(stamps, [10.5, 10.4, 11.0], 'radar') == [None] * 3
    assert stamps.gap_s == 0.0


def test_repeated_stamps_are_refused_also_late_ones():
    stamps = Stamps(1.5)
    given = [10.0, 10.0, 10.2, 10.1, 10.2, 10.1, 10.0]
    refused = [None, 'repeated_time', None, None, *['repeated_time'] * 3]
    assert judged(stamps, given) == refused


def test_stamps_that_repeat_those_of_another_sensor_are_taken():
    stamps = Stamps(1.5)
    assert judged(stamps, [10.0]) + judged(stamps, [10.0], 'radar') == [None, None]


@pytest.mark.parametrize(('behind_s', 'reason'), [(1.4, None), (1.6, 'too_late')])
def test_the_horizon_is_that_behind_the_newest_of_all(behind_s, reason):
    stamps = running()
    assert stamps.refuse('balise', 1001.0 - behind_s) == reason


def test_an_ordered_sensor_may_not_go_back():
    stamps = Stamps(1.5, ordered=('imu',))
    assert judged(stamps, [10.0, 10.1, 10.05], 'imu') == [None, None, 'backward_time']
    assert judged(stamps, [10.0, 9.9]) == [None, None]


@pytest.mark.parametrize(('jump_s', 'ahead_s'), [(30.0, 40.0), (5.0, 5.5), (5.0, 29.0), (5.0, 1e9)])
def test_one_stamp_far_ahead_is_refused_and_the_rest_goes_on(jump_s, ahead_s):
    stamps = running(jump_s=jump_s)
    assert stamps.refuse('loop', 1001.0 + ahead_s) == 'time_jump'
    assert judged(stamps, [1001.01, 1001.02], 'radar') == [None, None]


def test_a_jump_within_the_bound_is_taken():
    assert running(jump_s=5.0).refuse('loop', 1005.9) is None


@pytest.mark.parametrize('sensor', ['loop', 'radar'])
@pytest.mark.parametrize(('ahead_s', 'told_s'), [(10.0, 0.0), (100.0, 100.02)])
def test_a_gap_is_believed_when_the_next_stamp_confirms_it(sensor, ahead_s, told_s):
    """The filter is told of long ones: from the newest stamp to the one that is taken."""
    stamps = running(jump_s=5.0)
    assert stamps.refuse('loop', 1001.0 + ahead_s) == 'time_jump'
    assert stamps.refuse(sensor, 1001.0 + ahead_s + 0.02) is None
    assert stamps.gap_s == pytest.approx(told_s, abs=1e-9)
    assert stamps.refuse(sensor, 1001.0 + ahead_s + 0.04) is None
    assert stamps.gap_s == 0.0


def test_sensors_of_one_hertz_confirm_a_gap_too():
    stamps = running(jump_s=5.0)
    assert judged(stamps, [1100.0, 1101.0, 1102.0]) == ['time_jump', None, None]


def test_two_stray_stamps_do_not_confirm_each_other():
    stamps = running(jump_s=5.0)
    assert judged(stamps, [1500.0, 9000.0, 1500.0 + 60.0]) == ['time_jump'] * 3


def replayed(stamps, begin_s, seconds):
    """Push loop and radar at 50 Hz; return what became of them."""
    return [
        stamps.refuse(sensor, begin_s + 0.02 * k)
        for k in range(round(seconds / 0.02))
        for sensor in ('loop', 'radar')
    ]


@pytest.mark.parametrize('ahead_s', [0.0, 1e9])
def test_a_recording_that_starts_over_is_taken_after_a_while(ahead_s):
    """Also where it never went back: the first stamp of all was wrong."""
    stamps = Stamps(1.5, jump_s=5.0, restart_s=5.0)
    if ahead_s:
        stamps.refuse('loop', 1000.0 + ahead_s)
    else:
        replayed(stamps, 1000.0, 60.0)
    result = replayed(stamps, 1000.0, 10.0)
    late = [reason for reason in result if reason is not None]
    assert set(late) <= {'too_late', 'repeated_time'}
    assert len(late) == pytest.approx(2 * 50 * 5, abs=3)
    assert result[-400:] == [None] * 400


def test_the_restart_is_told_once():
    stamps = running(restart_s=5.0)
    told = 0
    for k in range(1000):
        stamps.refuse(('loop', 'radar')[k % 2], 900.0 + 0.01 * k)
        told += stamps.restarted
    assert told == 1


def test_one_sensor_held_back_is_no_restart():
    """A radar whose messages are stuck for 20 s and then come at once, all too late."""
    stamps = Stamps(1.5, restart_s=5.0)
    judged(stamps, [1000.0 + 0.02 * k for k in range(1000)])
    held = judged(stamps, [1000.0 + 0.05 * k for k in range(360)], 'radar')
    assert held == ['too_late'] * 360
    assert stamps.refuse('loop', 1020.0) is None


def test_late_messages_among_good_ones_are_no_restart():
    stamps = running(restart_s=5.0)
    for k in range(1000):
        assert stamps.refuse('loop', 1001.01 + 0.02 * k) is None
        assert stamps.refuse('radar', 990.005 + 0.02 * k) == 'too_late'
        assert stamps.refuse('balise', 990.005 + 0.02 * k) == 'too_late'


def test_without_leave_there_is_no_restart():
    stamps = running()
    assert replayed(stamps, 900.0, 60.0) == ['too_late'] * 6000


def test_its_memory_is_bounded():
    """A quarter of an hour at 100 Hz; the stamps of the last horizon are kept, no more."""
    stamps = Stamps(1.5)
    for k in range(90_000):
        stamps.refuse('loop', 0.01 * k)
    assert len(stamps._recent['loop']) <= 152
    assert math.isnan(stamps._ahead_s)

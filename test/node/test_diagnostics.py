"""Health figures: gaps from stamps, rates, levels, remedies."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from track_localization.ros.diagnostics import StampGaps, StreamHealth

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def gaps_of(stamps) -> StampGaps:
    gaps = StampGaps()
    for t in stamps:
        gaps.add(float(t))
    return gaps


def test_lost_messages_are_counted_from_stamps():
    """100 Hz with 3, then 10 samples missing."""
    t = np.arange(1000) / 100.0
    kept = np.delete(t, [*range(200, 203), *range(600, 610)])
    gaps = gaps_of(kept)
    assert (gaps.gaps, gaps.lost) == (2, 13)


def test_jitter_is_not_a_gap(rng):
    """0.5 ms of jitter, the simulator's, at 100 Hz."""
    assert gaps_of(np.arange(5000) / 100.0 + rng.normal(0.0, 5e-4, 5000)).gaps == 0


def test_a_gap_at_the_very_start_does_not_teach_a_wrong_interval():
    gaps = gaps_of([0.0, *(5.0 + np.arange(500) / 100.0), 10.5])
    assert gaps.lost == pytest.approx(50, abs=1)


@pytest.mark.parametrize('rates', [(100.0, 50.0), (50.0, 100.0)])
def test_a_new_rate_is_taken_over(rates):
    """Twenty odd intervals at most are taken for gaps, not the rest of the day."""
    first = np.arange(1000) / rates[0]
    second = first[-1] + np.arange(1, 1000) / rates[1]
    assert gaps_of([*first, *second]).gaps <= 20


def test_repeated_and_backward_stamps_are_no_gaps():
    assert (
        gaps_of([*np.arange(100) / 100.0, 0.5, 0.5, 0.99, *np.arange(100, 200) / 100.0]).gaps <= 1
    )


def stream(count, rate_hz=100.0, start=0.0) -> StreamHealth:
    health = StreamHealth()
    for i in range(count):
        health.arrived(start + i / rate_hz)
    return health


def test_a_good_stream_is_ok_and_its_rate_is_of_the_stamps():
    """Replayed ten times as fast: 100 Hz by the stamps, 1000 arrivals a second."""
    level, text, figures = stream(1000).report('imu', 1.0, {})
    assert (level, text) == (OK, 'imu: ok')
    assert figures['rate_hz'] == pytest.approx(100.0)
    assert figures['arrivals_hz'] == 1000.0
    assert figures['accepted'] == 1000


def test_the_second_report_covers_the_second_period_only():
    health = stream(100)
    health.refused('not_finite')
    assert health.report('imu', 1.0, {})[0] == WARN
    for i in range(50):
        health.arrived(1.0 + i / 50.0)
    level, _, figures = health.report('imu', 2.0, {})
    assert level == WARN  # the rate has changed: gaps
    assert figures['arrivals_hz'] == 25.0
    assert figures['rate_hz'] == pytest.approx(50.0, rel=0.03)
    assert health.report('imu', 1.0, {})[:2] == (WARN, 'imu: no messages')


def test_rejections_of_core_and_shell_are_added_up():
    health = stream(10)
    health.refused('wrong_frame')
    level, text, figures = health.report('imu', 1.0, {'backward_time': 2})
    assert (level, text) == (WARN, 'imu: 3 of 11 rejected')
    assert (figures['accepted'], figures['rejected']) == (8, 3)
    assert figures['rejected.wrong_frame'] == 1
    assert figures['rejected.backward_time'] == 2


def test_nothing_usable_is_an_error_with_a_remedy():
    health = StreamHealth()
    for _ in range(5):
        health.refused('empty_frame')
    level, text, _ = health.report('imu', 1.0, {})
    assert level == ERROR
    assert text == 'imu: all rejected (empty_frame): the sender must set header.frame_id'


def test_silence_is_a_warning_only_where_it_was_not_expected():
    assert StreamHealth().report('imu', 1.0, {})[0] == WARN
    assert StreamHealth(expected=False).report('match', 1.0, {})[0] == OK


def test_latency_is_measured_against_the_clock_given():
    health = StreamHealth(lambda: 12.5)
    health.arrived(12.0)
    assert health.report('imu', 1.0, {})[2]['latency_s'] == 0.5


def test_a_reset_core_does_not_give_negative_counts():
    health = stream(10)
    health.report('imu', 1.0, {'backward_time': 5})
    assert health.report('imu', 1.0, {})[1] == 'imu: no messages'

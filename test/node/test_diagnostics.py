"""Health figures: gaps from stamps, rates, levels, remedies."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from track_localization.ros.diagnostics import Diagnostics, StampGaps, StreamHealth

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


def test_a_message_that_comes_late_was_not_lost():
    """50 Hz, three messages half a second late, one lost: one gap for each, one loss."""
    t = np.arange(500) / 50.0
    order = sorted(
        (i for i in range(500) if i != 300), key=lambda i: i + 25.5 * (i in (50, 90, 91))
    )
    gaps = gaps_of(t[order])
    assert gaps.lost == 1
    assert gaps.gaps == 3  # 90 and 91 are one gap


def test_a_recording_started_over_is_followed():
    """Back by its whole length, then 10 samples lost."""
    t = np.arange(1000) / 100.0
    assert gaps_of([*t, *np.delete(t, range(500, 510))]).lost == 10


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


def test_the_latency_of_stamps_by_another_clock_is_not_told():
    """A recording of years ago, replayed by the wall's clock."""
    health = StreamHealth(now=lambda: 1.8e9)
    health.arrived(100.0)
    assert np.isnan(health.report('imu', 1.0, {})[2]['latency_s'])


def test_a_reset_core_does_not_give_negative_counts():
    health = stream(10)
    health.report('imu', 1.0, {'backward_time': 5})
    assert health.report('imu', 1.0, {})[1] == 'imu: no messages'


def test_late_messages_do_not_change_the_rate():
    """The last message before the report is half a second late."""
    health = stream(100, 50.0)
    health.report('loop', 2.0, {})
    for i in range(100, 150):
        health.arrived(i / 50.0)
    health.arrived(125.5 / 50.0)
    assert health.report('loop', 1.0, {})[2]['rate_hz'] == pytest.approx(51.0)
    for i in range(150, 200):
        health.arrived(i / 50.0)
    assert health.report('loop', 1.0, {})[2]['rate_hz'] == pytest.approx(50.0)


def test_a_stream_of_events_has_no_gaps():
    health = StreamHealth(expected=False, regular=False)
    for t in (0.0, 30.0, 31.0, 300.0):
        health.arrived(t)
    level, text, figures = health.report('balise', 1.0, {})
    assert (level, text, figures['gaps'], figures['lost']) == (OK, 'balise: ok', 0, 0)


def test_one_event_refused_is_a_warning_and_all_of_them_an_error():
    health = StreamHealth(expected=False, regular=False)
    health.refused('wrong_frame')
    assert health.report('balise', 1.0, {})[0] == ERROR
    health.arrived(10.0)
    assert health.report('balise', 1.0, {})[0] == OK
    health.refused('wrong_frame')
    assert health.report('balise', 1.0, {})[0] == WARN


def test_why_a_stream_is_silent_is_told_until_it_speaks():
    health = StreamHealth(expected=False)
    health.why_silent = lambda: 'teller publishes it as text'
    told = (ERROR, 'balise: teller publishes it as text')
    assert health.report('balise', 1.0, {})[:2] == told
    health.arrived(1.0)
    assert health.report('balise', 1.0, {})[0] == OK


def statuses(node, streams, figures) -> dict[str, tuple[bytes, str, dict[str, str]]]:
    """Return what is published of each part: level, message, figures."""
    diagnostics = Diagnostics(node, streams, dict, lambda: figures)
    sent = []
    diagnostics._publisher.publish = sent.append
    diagnostics.publish()
    return {
        status.name: (status.level, status.message, {v.key: v.value for v in status.values})
        for status in sent[0].status
    }


def test_figures_of_a_sensor_stand_with_the_sensor(ros):
    figures = {'n_eff': 7.0, 'nis.loop': 1.1, 'health.loop': 'ok', 'events.loop.jumps': 3}
    told = statuses(ros.node('core'), {'loop': stream(9), 'radar': stream(9)}, figures)
    loop, radar, core = told['core: loop'], told['core: radar'], told['core']
    assert (loop[2]['nis'], loop[2]['health']) == ('1.1', 'ok')
    assert 'nis' not in radar[2]
    assert (core[2]['n_eff'], core[2]['events.loop.jumps']) == ('7.0', '3')
    assert 'nis.loop' not in core[2]
    assert [part[0] for part in (loop, radar, core)] == [OK, OK, OK]


def test_a_sensor_that_the_core_does_not_trust_is_a_warning(ros):
    told = statuses(ros.node('core'), {'radar': stream(9)}, {'health.radar': 'isolated'})
    assert told['core: radar'][:2] == (WARN, 'radar: isolated')
    assert told['core'][:2] == (WARN, 'radar: isolated')

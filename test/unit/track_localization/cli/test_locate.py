"""Event times to places, on a trajectory made by hand."""

import dataclasses

import numpy as np
import pytest

from track_localization.cli.locate import as_table, locate, main
from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.clock import ClockOffset
from track_localization.io.tables import Events, Markers


@pytest.fixture
def ride() -> Trajectory:
    """10 m/s along x from t = 100 s, with a gap from 105 to 108 s."""
    t = np.concatenate([np.arange(100.0, 105.0, 0.1), np.arange(108.0, 112.0, 0.1)])
    x = 10.0 * (t - 100.0)
    position = np.stack([x, np.full_like(x, 2.0), np.zeros_like(x)], axis=1)
    return Trajectory(t, position, chainage=x + 7.0, sigma_along=np.full(len(t), 0.5))


MARKERS = Markers(
    np.array([101.0, 109.0]), ('loop', 'brake'), np.array([[10.0, 2.0, 0.0], [90.0, 2.0, 0.0]])
)


def test_events_become_places_with_an_interval(ride):
    events = Events(np.array([101.33, 110.0]), ('bang', 'squeal'))
    bang, squeal = locate(ride, events, MARKERS)
    assert bang.position == pytest.approx((13.3, 2.0, 0.0))
    assert bang.chainage == pytest.approx(20.3)
    assert bang.half_width == pytest.approx(1.96 * 0.5)
    assert (bang.marker, bang.marker_distance) == ('loop', pytest.approx(3.3))
    assert (squeal.marker, squeal.marker_distance) == ('brake', pytest.approx(10.0))
    assert bang.remark == ''
    assert '20.30 +- 0.98' in as_table([bang]).text()
    assert '3.3 m from loop' in as_table([bang]).text()


def test_events_outside_are_said_and_the_others_answered(ride):
    events = Events(np.array([99.0, 106.0, 102.0, 500.0]), ('early', 'gap', 'good', 'late'))
    early, gap, good, late = locate(ride, events)
    assert 'outside the recording (100.00 to 111.90 s)' in early.remark
    assert 'outside' in late.remark
    assert 'gap' in gap.remark
    assert good.remark == ''
    assert good.marker == ''
    assert np.isnan(early.position).all()
    lines = as_table([early, good]).text().splitlines()
    assert lines[-2].endswith('s)')
    assert '27.00' in lines[-1]


def test_events_of_another_clock_are_moved_and_their_interval_grows(ride):
    """The ground's clock is 98.67 s behind, known to 40 ms: 0.4 m at 10 m/s beside 0.5 m."""
    clock = ClockOffset(98.67, 0.04, np.empty(0))
    moving = dataclasses.replace(ride, speed=np.full(len(ride), 10.0))
    bang, late = locate(moving, Events(np.array([2.66, 50.0]), ('bang', 'late')), None, clock)
    assert bang.time_s == 2.66
    assert bang.chainage == pytest.approx(20.3)
    assert bang.half_width == pytest.approx(1.96 * np.hypot(0.5, 0.4))
    assert 'outside the recording (1.33 to 13.23 s)' in late.remark


def test_two_ways_to_the_clock_exit_with_2(capsys):
    arguments = ['somewhere', '--events', 'e.csv', '--clock-from-markers', '--clock-event', '1,2']
    with pytest.raises(SystemExit) as error:
        main(arguments)
    assert error.value.code == 2
    assert 'not both' in capsys.readouterr().err


@pytest.mark.parametrize('text', ['1', '1,2,3', 'a,b', 'nan,3'])
def test_a_clock_event_that_is_none_exits_with_2(text, capsys):
    with pytest.raises(SystemExit) as error:
        main(['somewhere', '--events', 'e.csv', '--clock-event', text])
    assert error.value.code == 2
    assert '--clock-event' in capsys.readouterr().err


def test_wrong_usage_exits_with_2(capsys):
    with pytest.raises(SystemExit) as error:
        main(['somewhere'])
    assert error.value.code == 2
    assert '--events' in capsys.readouterr().err


def test_an_events_file_without_the_columns_exits_with_1(tmp_path, capsys):
    events = tmp_path / 'events.csv'
    events.write_text('when,name\n1.0,a\n')
    assert main([str(tmp_path), '--events', str(events)]) == 1
    assert 'time_s' in capsys.readouterr().err

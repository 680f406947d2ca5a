"""The track filter's exam: which rides it runs, its tables and goals on rides that are given."""

import dataclasses
import json

import numpy as np
import pytest

from coaster_localization.methods import TRACK_METHODS
from coaster_localization.track_config import TrackFilterConfig
from track_localization.cli.coaster import reproduce, reproduce_midride, reproduce_track
from track_localization.cli.coaster.reproduce_midride import Answers
from track_localization.cli.coaster.reproduce_rides import (
    MID_RIDE,
    START_OFF,
    START_OFF_M,
    Ride,
    Task,
    run_task,
    simulation,
    write_ride,
)
from track_localization.cli.coaster.reproduce_track_goals import LIVE, SMOOTHED, Exam, track_goals
from track_localization.cli.goals import Goal
from track_localization.estimation.imu import ImuSeries
from track_localization.sim.coaster import scenario, simulate_coaster

GOOD = {
    LIVE: {'markers_m.mean': 0.08, 'position_m.mean': 0.3, 'markers_after_element_m.mean': 0.1},
    'track_filter_lag': {'markers_m.mean': 0.06, 'position_m.mean': 0.15},
    SMOOTHED: {'markers_m.mean': 0.05, 'position_m.mean': 0.12},
}
ALIKE = {
    'markers_truth_m.mean': 0.04,
    'inside_2_sigma': 0.95,
    'nees_position_over_3': 1.0,
    'real_time_factor': 0.0025,
    'covered': 1.0,
}
START = {
    'told': 1.0,
    'near': 1.0,
    'error_m': 0.2,
    'wrong_after': 0.0,
    'wrong_ever': 0.0,
    'wrong_s': 0.0,
    'answered_s': 50.0,
    'cpu_s': 1.0,
    'ride_s': 53.0,
}


def ride(track: str, seed: int, name: str = 'nominal') -> Ride:
    """Return a ride that meets every goal."""
    about = {'mount_deg': 3.0, 'duration_s': 100.0, 'floor.markers_m.mean': 0.05}
    return Ride(track, name, seed, about, {m: entry | ALIKE for m, entry in GOOD.items()})


def met_late(track: str, seed: int, starts: int) -> Ride:
    about = {'mount_deg': 3.0, 'duration_s': 100.0}
    return Ride(
        track, MID_RIDE, seed, about, {n: dict(START) for n in reproduce_midride.names(starts)}
    )


def changed(original: Ride, method: str, **figures: float | str) -> Ride:
    entry = original.methods[method] | {k.replace('__', '.'): v for k, v in figures.items()}
    return dataclasses.replace(original, methods={**original.methods, method: entry})


@pytest.fixture
def exam() -> Exam:
    return Exam(
        [ride(track, seed) for track in ('looping', 'mine') for seed in range(2)],
        {name: [ride('mine', 0, name)] for name in reproduce_track.SCENARIO_ROWS},
        [met_late('mine', 0, 3)],
    )


def goal(exam: Exam, words: str) -> Goal:
    (found,) = [g for g in track_goals(exam) if words in g.what]
    return found


def test_good_rides_meet_every_goal(exam):
    assert [g.what for g in track_goals(exam) if g.met is not True] == []


def test_what_was_not_run_is_neither_met_nor_missed():
    assert {g.met for g in track_goals(Exam([], {}, []))} == {None}


@pytest.mark.parametrize(
    ('words', 'method', 'figures'),
    [
        ('markers, live, mean', LIVE, {'markers_m__mean': 0.13}),
        ('markers, smoothed, mean', SMOOTHED, {'markers_m__mean': 0.10}),
        ('moving ride, live', LIVE, {'position_m__mean': 0.6}),
        ('moving ride, smoothed', SMOOTHED, {'position_m__mean': 0.17}),
        ('worst ride', LIVE, {'position_m__mean': 1.31}),
        ('inside 2 sigma, live', LIVE, {'inside_2_sigma': 0.5}),
        ('inside 2 sigma, smoothed', SMOOTHED, {'inside_2_sigma': 0.5}),
        ('/ 3, live', LIVE, {'nees_position_over_3': 4.0}),
        ('/ 3, smoothed', SMOOTHED, {'nees_position_over_3': 4.0}),
    ],
)
def test_one_bad_ride_of_four_is_in_the_mean(exam, words, method, figures):
    worse = [changed(exam.nominal[0], method, **figures), *exam.nominal[1:]]
    assert goal(dataclasses.replace(exam, nominal=worse), words).met is False


def test_goals_can_be_missed_from_both_sides(exam):
    for figure, words in (('inside_2_sigma', 'inside 2 sigma, live'), ('nees', '/ 3, live')):
        value = {'inside_2_sigma': 1.0, 'nees': 0.3}[figure]
        name = {'nees': 'nees_position_over_3'}.get(figure, figure)
        wide = [changed(r, LIVE, **{name: value}) for r in exam.nominal]
        assert goal(dataclasses.replace(exam, nominal=wide), words).met is False
    slow = [changed(r, SMOOTHED, real_time_factor=1.0 / 290.0) for r in exam.nominal]
    found = goal(dataclasses.replace(exam, nominal=slow), 'offline')
    assert found.ours.startswith('290 ')
    assert found.met is False


def test_a_ride_without_a_result_is_the_worst_and_is_lost(exam):
    unfound = dataclasses.replace(
        exam.nominal[0], about={'mount_deg': 1.0, 'failed': 'not found'}, methods={}
    )
    worst = goal(dataclasses.replace(exam, nominal=[unfound, *exam.nominal]), 'worst ride')
    assert worst.met is False
    assert '1 without a result' in worst.ours
    never_ran = dataclasses.replace(unfound, about={'failed': 'rolled back'})
    far = changed(exam.nominal[0], LIVE, position_m__mean=5.1)
    assert Exam.lost([unfound, never_ran, far, exam.nominal[1]]) == 2
    lost = dataclasses.replace(exam, scenarios=exam.scenarios | {'vib3': [far, unfound]})
    assert goal(lost, 'rides lost').met is False
    assert goal(lost, 'rides lost').ours.endswith(': vib3 2')


def test_starts_that_saw_too_little_are_counted_apart(exam):
    unseen = {k: v for k, v in START.items() if k not in ('near', 'error_m', 'wrong_after')}
    unseen |= {'told': 0.0, 'wrong_ever': 1.0, 'wrong_s': 5.0}
    one = changed(exam.mid_ride[0], 'start_0')
    late = dataclasses.replace(exam, mid_ride=[one, Ride('wooden', MID_RIDE, 0, {}, {'a': unseen})])
    assert goal(late, 'within 1 m').met is True
    assert goal(late, 'within 1 m').ours == '100.0 % of 3 starts that saw two elements, 4 in all'
    assert goal(late, 'then or later').met is True
    assert goal(late, 'at any time').met is False
    last = reproduce_track.midride_table(late).rows[-1]
    assert last[:3] == ('all', 4, 3)
    assert last[7] == pytest.approx(100.0 * 5.0 / 200.0)
    far = dataclasses.replace(exam, mid_ride=[changed(exam.mid_ride[0], 'start_0', near=0.0)])
    assert goal(far, 'within 1 m').met is False


def test_answers_are_judged_after_two_elements_and_by_their_sigma():
    time_s = np.arange(0.0, 20.0, 0.1)
    error = np.full(len(time_s), 0.5)
    error[time_s < 4.95] = 30.0
    error[100:105] = 2.0
    sigma = np.where(time_s < 2.95, 100.0, 0.3)
    answers = Answers(time_s, error, sigma, 1.0, 20.0)
    out = reproduce_midride.figures(answers, 6.0, 20.0)
    assert (out['told'], out['near'], out['error_m']) == (1.0, 1.0, 0.5)
    # 2 m at 0.3 m sigma is wrong and sure; 30 m is while sigma is 0.3, from 3 to 5 s.
    assert (out['wrong_after'], out['wrong_ever']) == (1.0, 1.0)
    assert out['wrong_s'] == pytest.approx(2.5)
    assert reproduce_midride.figures(answers, 11.0, 20.0)['wrong_after'] == 0.0
    far = reproduce_midride.figures(answers, 1.0, 20.0)
    assert (far['near'], far['error_m']) == (0.0, 30.0)
    late = reproduce_midride.figures(answers, 15.5, 20.0)
    assert late['told'] == 0.0
    assert 'near' not in late
    nothing = Answers(np.empty(0), np.empty(0), np.empty(0), 1.0, 20.0)
    silent = reproduce_midride.figures(nothing, 6.0, 20.0)
    assert (silent['near'], silent['wrong_ever'], 'error_m' in silent) == (0.0, 0.0, False)
    broken = dataclasses.replace(answers, broken='ZeroDivisionError: division by zero')
    assert reproduce_midride.figures(broken, 6.0, 20.0)['near'] == 0.0


def test_slow_turning_is_not_an_element():
    """0.1 rad/s for 50 s is none; 0.5 rad/s from then on gives 3 rad after 6 s."""
    time_s = np.arange(0.0, 100.0, 0.01)
    rate = np.zeros((len(time_s), 3))
    rate[:, 1] = np.where(time_s < 50.0, 0.1, 0.5)
    imu = ImuSeries(time_s, np.zeros_like(rate), rate)
    assert reproduce_midride.time_turned(imu, 3.0) == pytest.approx(56.0, abs=0.02)
    assert reproduce_midride.time_turned(imu, 30.0) == np.inf


def test_start_times_are_under_way_and_more_starts_keep_the_first():
    truth = simulate_coaster('launch', scenario('nominal'), 1).truth
    times = reproduce_midride.start_times(truth, 'launch', 1, 5)
    speed = np.interp(times, truth.time_s, np.linalg.norm(truth.velocity, axis=1))
    assert (speed > 0.4).all()
    assert np.array_equal(times[:2], reproduce_midride.start_times(truth, 'launch', 1, 2))
    assert not np.array_equal(times, reproduce_midride.start_times(truth, 'launch', 2, 5))


def test_a_filter_that_comes_late_says_nothing_at_first_and_finds_the_place():
    simulated = simulate_coaster('launch', scenario('nominal'), 1)
    config = TrackFilterConfig()
    out = reproduce_midride.run_starts(simulated, 'launch', 1, ('start_0',), config)['start_0']
    left_s = float(simulated.imu.time_s[-1]) - float(out['begin_s'])
    assert out['ride_s'] == pytest.approx(left_s, abs=0.02)
    assert out['answered_s'] <= left_s - config.seek_after_s + 0.1
    assert float(out['cpu_s']) > 0.0
    if out['told']:
        assert float(out['told_s']) >= float(out['begin_s']) + config.seek_after_s


def test_a_filter_that_breaks_down_is_counted_and_the_exam_goes_on(monkeypatch):
    pushed = reproduce_midride.CoasterTrackFilter.push

    def push(self, sample):
        if self.accepted['imu'] > 600:
            raise ZeroDivisionError('division by zero')
        return pushed(self, sample)

    monkeypatch.setattr(reproduce_midride.CoasterTrackFilter, 'push', push)
    late = run_task(Task('launch', MID_RIDE, 1, ('start_0',)))
    assert late.methods['start_0']['broken'] == 'ZeroDivisionError: division by zero'
    assert 0.0 < float(late.methods['start_0']['answered_s']) < 4.0
    whole = run_task(Task('launch', 'nominal', 1, TRACK_METHODS))
    assert whole.about['failed'] == 'ZeroDivisionError: division by zero'
    assert Exam.lost([whole]) == 1


def test_a_start_that_is_off_is_told_to_the_filter():
    task = Task('launch', START_OFF, 1, TRACK_METHODS)
    found = run_task(task)
    assert set(found.methods) == set(TRACK_METHODS)
    assert simulation(START_OFF) == simulation('nominal')
    # At the station the filter has nothing but what it was told.
    assert found.methods[LIVE]['position_m.max'] > 0.5 * START_OFF_M
    assert found.methods[SMOOTHED]['markers_after_element_m.mean'] < 1.0


def test_the_exam_runs_every_row_on_seeds_of_its_own():
    args = reproduce.parse(['--track-filter'])
    tasks = reproduce_track.make_tasks(args)
    count = {name: len([t for t in tasks if t.scenario == name]) for name in {'nominal', MID_RIDE}}
    assert count == {'nominal': 100, MID_RIDE: 100}
    assert sum(len(t.methods) for t in tasks if t.scenario == MID_RIDE) == 200
    for name in reproduce_track.SCENARIO_ROWS:
        rows = [t for t in tasks if t.scenario == name]
        assert len(rows) == 20
        assert 'shuttle' not in {t.track for t in rows}
        simulation(name)
    assert not {t.seed for t in tasks} & set(reproduce.EXAM_SEEDS)
    assert len({t.file for t in tasks}) == len(tasks)
    few = reproduce.parse(['--track-filter', '--seeds', '1:2', '--starts', '8'])
    late = [t for t in reproduce_track.make_tasks(few) if t.scenario == MID_RIDE]
    assert [len(t.methods) for t in late] == [2, 2, 2, 1, 1]


@pytest.mark.parametrize(
    'arguments',
    [
        ['--track-filter', '--scenario', 'vib3'],
        ['--track-filter', '--methods', 'imu'],
        ['--track-filter', '--no-sweeps'],
        ['--starts', '8'],
        ['--scenario-seeds', '2'],
        ['--track-filter', '--starts', 'many'],
    ],
)
def test_options_of_the_other_exam_are_wrong_usage(arguments):
    with pytest.raises(SystemExit) as error:
        reproduce.main([*arguments])
    assert error.value.code == 2


def test_kept_rides_are_printed_again(tmp_path, exam, capsys):
    folder = tmp_path / 'rides'
    folder.mkdir()
    late = changed(met_late('mine', 0, 5), 'start_1', broken='LinAlgError: singular', begin_s=9.0)
    for kept in [*exam.nominal, *(r for rows in exam.scenarios.values() for r in rows), late]:
        write_ride(folder / f'{kept.scenario}_{kept.track}_{kept.seed}.csv', kept, 'old code')
    options = ['--seeds', '0:2', '--tracks', 'looping,mine', '--starts', '8']
    arguments = ['--track-filter', '--reprint', *options]
    assert reproduce.main([*arguments, '--output', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert 'NOT met' not in printed
    assert 'broken down: mine seed 0, begun at 9.00 s: LinAlgError: singular' in printed
    rows = {line.split()[0]: line.split() for line in printed.splitlines() if line.strip()}
    assert rows['mountany'][1:4] == ['1', '0', '0.300']
    # Five starts were kept and eight over four rides are asked for: two of this one.
    assert rows['all'][1:3] == ['2', '2']
    content = json.loads((tmp_path / 'reproduce.json').read_text())
    assert [row[0] for row in content['methods']['rows'][:3]] == list(TRACK_METHODS)
    assert (tmp_path / 'goals.csv').exists()
    assert (
        '| markers, live, mean over rides | <= 0.09 m | 0.080 m'
        in (tmp_path / 'reproduce.md').read_text()
    )

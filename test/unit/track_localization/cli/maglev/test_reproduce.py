"""The maglev's acceptance table on runs whose figures are given, and what the exam runs."""

import dataclasses

import pytest

from track_localization.cli.exam_runs import Run, Task, read_run, write_run
from track_localization.cli.goals import Goal
from track_localization.cli.maglev import reproduce, reproduce_tables
from track_localization.cli.maglev.reproduce_goals import goals
from track_localization.cli.maglev.reproduce_runs import (
    CASES,
    DEAD,
    FAULTS,
    LINE,
    MISSED,
    PAPER,
)
from track_localization.evaluation.tabulate import Table

RMSE = {'robust': 0.2, 'kalman': 0.3, 'paper': 3.0, 'optimal': 0.07, 'linear': 0.2}
"""Of the place [m]; the paper's own filter is as good as the optimum where nothing is missed."""


def figures(case: str, entry: str) -> dict[str, float]:
    """Return figures that meet every goal."""
    rmse = RMSE[CASES[case].entries[entry].method]
    most = 3.0 * rmse
    if case == PAPER:
        rmse, most = 0.07, 0.25
    out = {'cpu_s': 2.0, 'estimates': 9000.0, 'speed_mps.rmse': 0.05, 'speed_mps.max': 0.3}
    for part in ('', 'since.'):
        out |= {f'{part}inside_2_sigma': 0.95, f'{part}nees_mean': 1.0}
        out |= {f'{part}position_m.rmse': rmse, f'{part}position_m.max': most}
    if entry == 'paper_alone':
        out['position_m.max'] = 9.7
    if case in DEAD:
        out |= {'outage.most_sigmas': 2.5, 'outage.share_inside': 1.0, 'outage.most_m': 1.0}
        out |= {'outage.after_m': 0.1, 'outage.after_sigma_m': 0.1}
    return out


def made(case: str, seed: int) -> Run:
    entries = {name: figures(case, name) for name in CASES[case].entries}
    return Run(case, seed, {'duration_s': 470.0}, entries)


def changed(run: Run, entry: str, **other: float) -> Run:
    new = run.entries[entry] | {name.replace('__', '.'): value for name, value in other.items()}
    return dataclasses.replace(run, entries={**run.entries, entry: new})


@pytest.fixture
def good() -> list[Run]:
    return [made(case, seed) for case in CASES for seed in range(3)]


def judged(runs: list[Run]) -> list[Goal]:
    return goals(reproduce_tables.exam_of(runs))


def goal(runs: list[Run], words: str) -> Goal:
    (found,) = [g for g in judged(runs) if words in g.what]
    return found


def with_one(runs: list[Run], case: str, entry: str, **other: float) -> list[Run]:
    """Return the runs with the last one of a case changed."""
    last = max(k for k, run in enumerate(runs) if run.case == case)
    return [*runs[:last], changed(runs[last], entry, **other), *runs[last + 1 :]]


def with_all(runs: list[Run], case: str, entry: str, **other: float) -> list[Run]:
    return [changed(run, entry, **other) if run.case == case else run for run in runs]


def test_good_runs_meet_every_goal(good):
    assert [g.what for g in judged(good) if g.met is not True] == []


def test_what_was_not_run_is_neither_met_nor_missed():
    assert {g.met for g in judged([])} == {None}


@pytest.mark.parametrize(
    ('case', 'entry', 'other', 'words'),
    [
        (PAPER, 'paper_1000', {'position_m__max': 1.01}, 'runs lost'),
        (MISSED, 'robust', {'since__position_m__max': 1.01}, 'every run'),
        (LINE, 'robust', {'position_m__rmse': 0.61}, 'worst run'),
        ('loopdead', 'robust', {'outage__most_sigmas': 3.1}, 'loopdead: inside 3 sigma'),
        ('balisedead', 'robust', {'outage__after_m': 0.6}, 'balisedead: found again'),
    ],
)
def test_one_bad_run_fails_what_every_run_must_reach(good, case, entry, other, words):
    assert goal(with_one(good, case, entry, **other), words).met is False


@pytest.mark.parametrize(
    ('case', 'entry', 'other', 'words'),
    [
        (PAPER, 'paper_1000', {'position_m__rmse': 0.0722}, 'N = 1000:'),
        (PAPER, 'paper_10000', {'position_m__rmse': 0.0704}, 'N = 10000:'),
        (MISSED, 'paper_alone', {'position_m__max': 4.0}, 'greatest error of paper'),
        (MISSED, 'paper_alone', {'position_m__max': 21.0}, 'greatest error of paper'),
        (LINE, 'robust', {'position_m__rmse': 0.26}, 'RMSE of robust, median'),
        (LINE, 'robust', {'inside_2_sigma': 0.91}, 'inside 2 sigma'),
        (LINE, 'robust', {'inside_2_sigma': 0.99}, 'inside 2 sigma'),
        (LINE, 'robust', {'cpu_s': 4.8}, 'times real time'),
        ('radardead', 'kalman', {'position_m__rmse': 0.19}, 'robust over kalman'),
        ('wrongid20', 'kalman', {'position_m__rmse': 0.199}, 'several modes'),
    ],
)
def test_medians_can_be_missed(good, case, entry, other, words):
    assert goal(with_all(good, case, entry, **other), words).met is False


def test_a_large_error_that_was_said_to_be_large_is_found_again(good):
    told = with_one(good, 'loopdead', 'robust', outage__after_m=0.6, outage__after_sigma_m=0.31)
    assert goal(told, 'loopdead: found again').met is True


def test_an_unknown_start_is_judged_from_the_first_balise_on(good):
    """Before it no method can know where the train is."""
    far = with_all(good, 'startunknown', 'robust', position_m__rmse=900.0)
    assert goal(far, 'several modes').met is True
    late = with_all(good, 'startunknown', 'robust', since__position_m__rmse=0.31)
    assert goal(late, 'several modes').met is False
    assert goal(late, 'robust over kalman').ours == '1.03 at worst (startunknown)'


def test_a_run_without_estimates_is_worse_than_any(good):
    nothing = {'cpu_s': 1.0, 'estimates': 0.0}
    last = max(k for k, run in enumerate(good) if run.case == LINE)
    entries = {**good[last].entries, 'robust': nothing}
    runs = list(good)
    runs[last] = dataclasses.replace(good[last], entries=entries)
    assert goal(runs, 'worst run').ours == 'inf m'
    assert goal(runs, 'worst run').met is False
    assert goal(runs, 'RMSE of robust, median').met is True


def test_failed_runs_are_told_and_not_counted(good, tmp_path, capsys):
    failed = Run(LINE, 9, {'failed': 'DataError: no such line'}, {})
    args = reproduce.make_parser().parse_args(['--output', str(tmp_path)])
    reproduce.publish(args, {}, [*good, failed], 'abc')
    printed = capsys.readouterr().out
    assert f'{len(good) + 1} runs, 1 failed' in printed
    assert 'line seed 9: DataError: no such line' in printed
    assert 'Scenario line, 3 runs' in printed


def test_tables_hold_what_was_measured(good):
    runs = with_one(good, 'jumpbalise', 'kalman', position_m__rmse=0.9)
    exam = reproduce_tables.exam_of(runs)
    rows = {row[0]: row for row in reproduce_tables.faults_table(exam).rows}
    assert list(rows) == [LINE, *FAULTS]
    assert rows['jumpbalise'][1:6] == (3, 0.2, 0.2, 0.3, 0.9)
    assert rows['jumpbalise'][6:8] == pytest.approx((2.0 / 3.0, 2.0 / 9.0))
    (first, *_) = reproduce_tables.line_table(exam).rows
    assert first[0] == 'paper'
    assert first[-1] == pytest.approx(470.0 / 2.0)
    optimum = reproduce_tables.optimum_table(exam).rows
    assert [row[2] for row in optimum] == pytest.approx([1.0, 1.0, 1.0])


def test_squares_are_pooled_over_runs(good):
    """Errors of 0.07, 0.07 and 0.14 m: the root of the mean square, not the mean."""
    runs = with_one(good, PAPER, 'paper_1000', position_m__rmse=0.14)
    exam = reproduce_tables.exam_of(runs)
    assert exam[PAPER].pooled('paper_1000', 'position_m.rmse') == pytest.approx(0.07 * 2.0**0.5)


def test_a_kept_run_is_read_back_unless_the_code_changed(tmp_path, good):
    run = good[0]
    task = Task(run.case, run.seed, tuple(run.entries))
    write_run(tmp_path / task.file, run, 'abc')
    assert read_run(tmp_path / task.file, task, 'abc') == run
    assert read_run(tmp_path / task.file, task, 'other') is None
    assert read_run(tmp_path / task.file, task, None) is not None
    fewer = dataclasses.replace(task, entries=('robust',))
    kept = read_run(tmp_path / task.file, fewer, 'abc')
    assert kept is not None
    assert set(kept.entries) == {'robust'}
    more = dataclasses.replace(task, entries=('robust', 'newcomer'))
    assert read_run(tmp_path / task.file, more, 'abc') is None


def test_the_exam_runs_on_seeds_of_its_own():
    tasks = reproduce.make_tasks(reproduce.make_parser().parse_args([]))
    count = {case: sum(task.case == case for task in tasks) for case in CASES}
    assert count[LINE] == 50
    assert {count[case] for case in FAULTS} == {20}
    assert count[PAPER] == count[MISSED] == 200
    assert min(task.seed for task in tasks) == 1000
    assert len({task.file for task in tasks}) == len(tasks)


def test_scenarios_and_methods_can_be_chosen():
    arguments = ['--scenarios', 'line,paper,jumpbalise', '--methods', 'paper', '--seeds', '5:7']
    tasks = reproduce.make_tasks(reproduce.make_parser().parse_args(arguments))
    assert {task.case for task in tasks} == {LINE, PAPER}
    assert {task.entries for task in tasks if task.case == LINE} == {('paper',)}
    assert 'optimal' in next(task.entries for task in tasks if task.case == PAPER)
    assert [task.seed for task in tasks if task.case == LINE] == [5, 6]


@pytest.mark.parametrize(
    'arguments',
    [['--seeds', '5:5'], ['--paper-seeds', 'x'], ['--scenarios', 'moon'], ['--methods', 'eskf']],
)
def test_wrong_usage_exits_with_2(arguments):
    with pytest.raises(SystemExit) as error:
        reproduce.main(arguments)
    assert error.value.code == 2


def test_reprint_without_runs_exits_with_1(tmp_path, capsys):
    assert reproduce.main(['--reprint', '--output', str(tmp_path / 'none')]) == 1
    assert 'no runs' in capsys.readouterr().err


def test_kept_runs_are_printed_again(tmp_path, good, capsys, monkeypatch):
    (tmp_path / 'runs').mkdir()
    for run in good:
        write_run(tmp_path / 'runs' / f'{run.case}_{run.seed}.csv', run, 'old code')
    arguments = ['--reprint', '--seeds', '0:3', '--paper-seeds', '0:3', '--output', str(tmp_path)]
    papers = Table('what the paper says', ('a',), [('b',)])
    monkeypatch.setattr(reproduce.reproduce_paper, 'paper_tables', lambda *_: [papers, papers])
    assert reproduce.main(arguments) == 0
    printed = capsys.readouterr().out
    assert 'NOT met' not in printed
    assert 'not run' not in printed
    assert printed.startswith('what the paper says')
    markdown = (tmp_path / 'reproduce.md').read_text()
    assert '| line: RMSE of robust, median | <= 0.25 m | 0.200 m | met |' in markdown
    assert (tmp_path / 'faults.csv').exists()

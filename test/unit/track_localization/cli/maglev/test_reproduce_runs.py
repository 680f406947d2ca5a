"""One simulated run and what is measured on it, against what the simulator knows."""

import numpy as np
import pytest

from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from track_localization.cli.exam_runs import Task
from track_localization.cli.maglev.reproduce_runs import (
    CASES,
    MISSED,
    figures,
    measurements,
    run_task,
)
from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.settings import override
from track_localization.sim.maglev import scenario, simulate_maglev


@pytest.fixture(scope='module')
def run():
    config = override(scenario('line'), {'line.length_m': 2500.0, 'line.stops_m': '0 2500'})
    return simulate_maglev(config, 3)


def off(run, error):
    """Return an estimate that is off by given metres (N,) and claims 0.5 m."""
    s = run.chainage + error
    zero = np.zeros_like(s)
    covariance = np.zeros((len(s), 3, 3))
    covariance[:, 0, 0] = 0.25
    return Trajectory(
        time_s=run.time_s,
        position=np.stack([s, zero, zero], axis=1),
        velocity=np.stack([run.speed, zero, zero], axis=1),
        chainage=s,
        speed=run.speed,
        covariance=covariance,
        sigma_along=np.full(len(s), 0.5),
    )


def test_measurements_come_as_they_arrive(run):
    found = list(measurements(run))
    kinds = [
        sum(isinstance(m, k) for m in found) for k in (LoopPosition, RadarSpeed, BalisePassing)
    ]
    assert kinds == [len(run.loop), len(run.radar), len(run.balise)]
    arrival = {
        **{(LoopPosition, t): a for t, a in zip(run.loop.time_s, run.loop.arrival_s, strict=True)},
        **{(RadarSpeed, t): a for t, a in zip(run.radar.time_s, run.radar.arrival_s, strict=True)},
    }
    times = [arrival[type(m), m.time_s] for m in found if not isinstance(m, BalisePassing)]
    assert (np.diff(times) >= 0.0).all()
    assert (np.diff([m.time_s for m in found]) < 0.0).any()
    assert not any(isinstance(m, BalisePassing) for m in measurements(run, balises=False))


def test_errors_count_from_the_arrival_of_the_first_balise(run):
    """3 m off until a balise comes, 0.1 m after: the standing train counts for neither."""
    arrived = float(run.balise.arrival_s.min())
    found = figures(off(run, np.where(run.time_s < arrived, 3.0, 0.1)), run, None)
    assert found['since']['position_m']['max'] == pytest.approx(0.1)
    moving = run.speed > 0.5
    before = np.mean(run.time_s[moving] < arrived)
    rmse = np.sqrt(9.0 * before + 0.01 * (1.0 - before))
    assert found['position_m']['rmse'] == pytest.approx(rmse, rel=1e-3)
    assert 'outage' not in found


def test_an_outage_counts_standing_trains_too_and_what_the_next_balise_mends(run):
    last = float(run.balise.time_s[-1])
    begin, end = run.time_s[0] + 1.0, last - 20.0
    during = (run.time_s >= begin) & (run.time_s < end)
    assert (run.speed[during] < 0.5).any()
    error = np.where(during, 1.6, np.where(run.time_s < last, 5.0, 0.2))
    error[np.flatnonzero(during)[:100]] = 1.4
    found = figures(off(run, error), run, (begin, end))['outage']
    assert found['most_m'] == pytest.approx(1.6)
    assert found['most_sigmas'] == pytest.approx(3.2)
    assert found['share_inside'] == pytest.approx(100.0 / during.sum())
    assert (found['after_m'], found['after_sigma_m']) == pytest.approx((0.2, 0.5))
    never = figures(off(run, error), run, (begin, float(run.time_s[-1])))['outage']
    assert 'after_m' not in never


def test_the_papers_scenario_is_run_by_all_that_take_part():
    found = run_task(Task(MISSED, 1, tuple(CASES[MISSED].entries)))
    assert found.about == {'duration_s': 100.0}
    most = {n: entry['since.position_m.max'] for n, entry in found.entries.items()}
    # 1.4 m are missed on each km; balises take that away, and the share that is known too.
    assert most['paper_alone'] > 5.0
    assert most['paper'] < 4.0
    assert max(most['robust'], most['robust_told'], most['linear']) < 2.0


def test_a_case_tells_its_settings():
    assert CASES['startunknown'].settings == {'motion.start_known': False}
    assert CASES['starttold'].scenario == 'startunknown'
    assert not CASES['starttold'].settings


def test_a_failure_is_told(monkeypatch):
    def fail(*_):
        raise DataError('no such line')

    monkeypatch.setattr('track_localization.cli.maglev.reproduce_runs.simulate_maglev', fail)
    assert run_task(Task(MISSED, 1, ('linear',))).about == {'failed': 'DataError: no such line'}

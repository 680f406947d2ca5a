"""Every method behind its one door: sensors that are absent, late to wake, or fail under way."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers.maglev_pipeline import METHODS, NO_BALISES, inside, make, only, run

from maglev_localization.config import MotionConfig
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed

UNKNOWN = MotionConfig(start_known=False)


@pytest.mark.parametrize('method', METHODS)
def test_without_radar(train, method):
    """
    The loop carries both, five to twenty estimates a second; the paper's has them at balises only.

    Sigmas hold before the first balise (1 m) and behind it.
    """
    stream = only(train.measurements(), LoopPosition, BalisePassing)
    pipeline = make(train, method)
    estimates = run(pipeline, stream)
    time_s, along, *_ = train.errors(estimates)
    assert pipeline.health()['radar'] == 'waiting'
    if method == 'paper':
        assert len(estimates) <= 4
        return
    assert np.diff(time_s).max() < 0.2
    assert inside(train, estimates, 3.5)
    assert np.abs(along[time_s > train.passing_s(300.0)]).max() < 0.6


@pytest.mark.parametrize('method', ['robust', 'kalman'])
def test_without_loop(train, method):
    """
    It starts anywhere on the line; between balises the radar's scale is all that is not known.

    After two balises a few metres in 600 m are left, and sigma says so.
    """
    stream = only(train.measurements(), RadarSpeed, BalisePassing)
    pipeline = make(train, method)
    estimates = run(pipeline, stream)
    time_s, along, *_ = train.errors(estimates)
    assert pipeline.health()['loop'] == 'waiting'
    assert inside(train, estimates, 3.5)
    assert np.abs(along[time_s > train.passing_s(900.0)]).max() < 10.0


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('table', [NO_BALISES, None])
def test_without_balises(train, method, table):
    """The start is all that is known, 1 m; an empty table is as good as balises not heard."""
    stream = train.measurements()
    stream = stream if table is NO_BALISES else only(stream, LoopPosition, RadarSpeed)
    pipeline = make(train, method, table=table)
    estimates = run(pipeline, stream)
    _, along, sigma, *_ = train.errors(estimates)
    assert np.abs(along).max() < (1.0 if method != 'paper' else 10.0)
    if method != 'paper':
        assert 0.9 < sigma.min() < sigma.max() < 1.5
    if table is NO_BALISES:
        assert pipeline.rejected['balise']['unknown_id'] == 3


@pytest.mark.parametrize('method', METHODS)
def test_one_balise(train, method):
    train = dataclasses.replace(train, balises=(900.0,))
    estimates = run(make(train, method), train.measurements())
    time_s, along, *_ = train.errors(estimates)
    assert np.abs(along[time_s > train.passing_s(900.0)]).max() < (
        0.4 if method != 'paper' else 1.0
    )


@pytest.mark.parametrize('method', ['robust', 'kalman'])
def test_a_start_anywhere_is_resolved_by_a_balise(train, method):
    """The counter began at 700 m less, the clock runs, the train may be anywhere on 3 km."""
    shifted = dataclasses.replace(train, zero_m=700.0)
    pipeline = make(shifted, method, motion=UNKNOWN)
    estimates = run(pipeline, shifted.measurements())
    time_s, along, sigma, *_ = shifted.errors(estimates)
    assert sigma[time_s < train.passing_s(300.0)].min() > 1000.0
    assert np.abs(along[time_s >= train.passing_s(300.0)]).max() < 0.6
    assert sigma[time_s > train.passing_s(900.0)].max() < 0.3
    assert inside(shifted, estimates, 3.5)


@pytest.mark.parametrize('method', ['robust', 'kalman'])
def test_a_loop_that_wakes_up_late_tells_nothing_of_the_way_so_far(make_train, method):
    """
    Its first reading says where it counts from now on, not that all was right so far.

    A train that runs at 35 m/s is told where it is; four seconds later the radar is heard, and
    meanwhile it may have gone by 120 m. Two seconds later the loop comes, which knows no better.
    """
    train = make_train(rest_s=-50.0, top=35.0, balises=(), seconds=20.0)
    begin = {RadarSpeed: 1004.0, LoopPosition: 1006.0}
    stream = [z for z in train.measurements() if z.time_s > begin[type(z)]]
    pipeline = make(train, method, table=NO_BALISES, length=10_000.0)
    pipeline.set_start(float(train.at(1000.0)[0]), 1.0)
    estimates = run(pipeline, [BalisePassing(1000.0, 'x', 0.0, 0.01), *stream])
    time_s, _, sigma, *_ = train.errors(estimates)
    before, after = (sigma[np.searchsorted(time_s, t)] for t in (1005.9, 1007.0))
    assert inside(train, estimates, 3.5)
    assert 0.8 * before < after


@pytest.mark.parametrize('method', ['robust', 'kalman'])
@pytest.mark.parametrize('share', [0.02, 1.0])
def test_a_radar_that_reads_nought_under_way(train, method, share):
    """It loses the ground now and then, often, or for 30 s: the train does not stand for that."""
    rng = np.random.default_rng(11)
    stream = [
        z._replace(speed=0.0)
        if isinstance(z, RadarSpeed) and 1045.0 < z.time_s < 1075.0 and rng.random() < share
        else z
        for z in train.measurements()
    ]
    pipeline = make(train, method)
    estimates = run(pipeline, stream)
    time_s, along, _, speed, _ = train.errors(estimates)
    assert np.abs(along[time_s > train.passing_s(300.0)]).max() < 0.4
    assert np.abs(speed[time_s > 1045.0]).max() < 0.5
    assert pipeline.rejected['radar']['gate'] == pytest.approx(600 * share, abs=4.0 + 40.0 * share)
    told = [state for _, sensor, state in pipeline.health_changes() if sensor == 'radar']
    assert ('isolated' in told) == (share == 1.0)
    assert pipeline.health()['radar'] == 'ok'


def failing(train, kind, change):
    """Return the run with one sensor changed from 1050 to 1060 s; None drops a message."""
    out, held = [], {}
    for z in train.measurements():
        if isinstance(z, kind) and 1050.0 < z.time_s < 1060.0:
            z = change(z, held.setdefault(kind, z))
        if z is not None:
            out.append(z)
    return out


FAULTS = [
    (LoopPosition, 'loop', 'silent', lambda z, first: None),
    (LoopPosition, 'loop', 'isolated', lambda z, first: z._replace(reading=first.reading)),
    (RadarSpeed, 'radar', 'silent', lambda z, first: None),
    (RadarSpeed, 'radar', 'isolated', lambda z, first: z._replace(speed=first.speed)),
    (RadarSpeed, 'radar', 'isolated', lambda z, first: z._replace(speed=-40.0 + z.time_s % 1.0)),
]


@pytest.mark.parametrize('method', ['robust', 'kalman'])
@pytest.mark.parametrize(('kind', 'sensor', 'state', 'change'), FAULTS)
def test_a_sensor_that_fails_for_ten_seconds_is_named_and_borne(
    train, method, kind, sensor, state, change
):
    pipeline = make(train, method)
    estimates = run(pipeline, failing(train, kind, change))
    told = [(time_s, new) for time_s, name, new in pipeline.health_changes() if name == sensor]
    assert [new for _, new in told] == ['ok', state, 'ok']
    assert 1050.0 < told[1][0] < 1051.6
    assert 1060.0 < told[2][0] < 1063.0
    time_s, along, sigma, *_ = train.errors(estimates)
    assert inside(train, estimates, 3.5, train.passing_s(300.0))
    late = time_s > train.passing_s(1500.0) + 1.0
    assert np.abs(along[late]).max() < 0.5
    assert sigma[late].max() < 0.3


def test_a_message_lost_is_no_fault(train):
    """Half a second without the loop is neither silence nor a count that stands."""
    stream = [
        z
        for z in train.measurements()
        if not (isinstance(z, LoopPosition) and 1050.0 < z.time_s < 1050.5)
    ]
    pipeline = make(train)
    run(pipeline, stream)
    assert [new for _, name, new in pipeline.health_changes() if name == 'loop'] == ['ok']

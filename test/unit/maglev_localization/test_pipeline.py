"""Every method behind its one door: bad data counted, any order, gaps, restarts, absent sensors."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from maglev_localization.config import MaglevConfig, MotionConfig
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from maglev_localization.pipeline import MaglevPipeline
from track_localization.track.balise_table import BaliseTable

METHODS = ('robust', 'kalman', 'paper')
NO_BALISES = BaliseTable((), np.zeros(0), np.zeros(0))
UNKNOWN = MotionConfig(start_known=False)


def make(train, method='robust', table=None, length=3000.0, **settings):
    config = MaglevConfig(method=method, **settings)
    return MaglevPipeline(config, train.table if table is None else table, length)


def run(pipeline, measurements):
    return [estimate for z in measurements for estimate in pipeline.push(z)]


def inside(train, estimates, sigmas, begin_s=0.0):
    """Whether every estimate from ``begin_s`` on keeps within so many of its sigmas."""
    time_s, along, sigma, *_ = train.errors(estimates)
    after = time_s >= begin_s
    assert after.any()
    return bool((np.abs(along) <= sigmas * sigma)[after].all())


def only(measurements, *kinds):
    return [z for z in measurements if isinstance(z, kinds)]


@pytest.mark.parametrize('method', METHODS)
def test_a_plain_run(train, method):
    """
    Estimates at the radar's rate and one at each balise.

    The paper's model has no room for the pitch nor for 0.4 % of scale; a balise is 5 cm. The train
    sets out with a jerk that no train has: before it is seen it goes at 0.5 m/s.
    """
    pipeline = make(train, method)
    estimates = run(pipeline, train.measurements())
    time_s, along, sigma, speed, _ = train.errors(estimates)
    after = time_s > train.passing_s(300.0) + 1.0
    assert len(estimates) == pytest.approx(100 * 20 + 3, abs=3)
    assert (np.diff(time_s) >= 0.0).all()
    assert np.abs(along[after]).max() < (0.35 if method != 'paper' else 1.0)
    assert np.abs(speed).max() < (0.7 if method != 'paper' else 1.0)
    assert (sigma > 0.0).all()
    assert set(pipeline.health().values()) == {'ok'}
    assert pipeline.rejected.get('loop', {}) == {}


@pytest.mark.parametrize('late_s', [0.03, 0.07, 0.3])
@pytest.mark.parametrize('method', ['robust', 'kalman'])
def test_a_radar_that_always_comes_late_does_not_stall_the_estimates(train, method, late_s):
    """By a processing time of its own, or by its clock: whoever comes first, 10 Hz at least."""
    stream = sorted(
        train.measurements(), key=lambda z: z.time_s + late_s * isinstance(z, RadarSpeed)
    )
    estimates = run(make(train, method), stream)
    time_s = train.errors(estimates)[0]
    assert (np.diff(time_s) >= 0.0).all()
    assert np.diff(time_s).max() < 0.16
    assert inside(train, estimates, 5.0)


@pytest.mark.parametrize('method', ['robust', 'kalman'])
def test_nothing_is_said_before_the_speed_is_known(train, method):
    """A loop's first reading tells no speed: under way, nought would be 20 m/s off."""
    stream = [z for z in train.measurements() if z.time_s > 1060.0]
    for heard in (stream, only(stream, LoopPosition)):
        first = run(make(train, method), heard)[0]
        assert first.speed == pytest.approx(25.0, abs=3.0 * first.sigma_speed)
        assert first.sigma_speed <= 10.0


UNUSABLE = [
    ('loop', 'not_finite', LoopPosition(1050.011, math.nan, 0.01)),
    ('loop', 'not_finite', LoopPosition(math.inf, 3.0, 0.01)),
    ('loop', 'not_finite', LoopPosition(math.nan, 3.0, 0.01)),
    ('radar', 'not_finite', RadarSpeed(1050.011, -math.inf, 0.01)),
    ('balise', 'not_finite', BalisePassing(1050.011, 'b0', math.nan, 0.01)),
    ('loop', 'bad_variance', LoopPosition(1050.011, 3.0, 0.0)),
    ('loop', 'bad_variance', LoopPosition(1050.011, 3.0, math.nan)),
    ('radar', 'bad_variance', RadarSpeed(1050.011, 3.0, -1.0)),
    ('balise', 'bad_variance', BalisePassing(1050.011, 'b0', 0.1, math.inf)),
    ('loop', 'implausible', LoopPosition(1050.011, -2e7, 0.01)),
    ('radar', 'implausible', RadarSpeed(1050.011, 301.0, 0.01)),
    ('balise', 'implausible', BalisePassing(1050.011, 'b0', 1e9, 0.01)),
    ('loop', 'time_jump', LoopPosition(1060.0, 3.0, 0.01)),
    ('radar', 'time_jump', RadarSpeed(3e9, 3.0, 0.01)),
    ('balise', 'time_jump', BalisePassing(1055.5, 'b0', 0.1, 0.01)),
    ('loop', 'too_late', LoopPosition(1048.0, 3.0, 0.01)),
    ('radar', 'too_late', RadarSpeed(-5.0, 3.0, 0.01)),
    ('balise', 'too_late', BalisePassing(1000.0, 'b0', 0.1, 0.01)),
]


@pytest.mark.parametrize('method', METHODS)
def test_what_cannot_be_used_is_counted_and_changes_nothing(train, method):
    """It comes 50 s after the start; two seconds on, the estimates are those without it."""
    stream = [z for z in train.measurements() if z.time_s < 1052.0]
    i = next(i for i, z in enumerate(stream) if z.time_s > 1050.0)
    clean, pipeline = make(train, method), make(train, method)
    expected, estimates = run(clean, stream), run(pipeline, stream[:i])
    for sensor, reason, wrong in UNUSABLE:
        before = pipeline.rejected.get(sensor, {}).get(reason, 0)
        assert pipeline.push(wrong) == []
        assert pipeline.rejected[sensor][reason] == before + 1
    estimates += run(pipeline, stream[i:])
    counts = [sum(sum(r.values()) for r in p.rejected.values()) for p in (pipeline, clean)]
    assert counts[0] - counts[1] == len(UNUSABLE)
    assert [e.time_s for e in estimates] == [e.time_s for e in expected]
    assert all(np.array_equal(a.mean, b.mean) for a, b in zip(estimates, expected, strict=True))


@pytest.mark.parametrize('method', METHODS)
def test_repeated_messages_are_counted_and_change_nothing(train, method):
    """Every message twice; the second comes at once, or after four others."""
    stream = train.measurements()[:2000]
    expected = run(make(train, method), stream)[-1]
    pipeline = make(train, method)
    twice = sorted(
        [(i, z) for i, z in enumerate(stream)]
        + [(i + (0.5 if i % 2 else 4.5), z) for i, z in enumerate(stream)],
        key=lambda entry: entry[0],
    )
    last = run(pipeline, [z for _, z in twice])[-1]
    repeated = sum(reasons.get('repeated_time', 0) for reasons in pipeline.rejected.values())
    assert repeated == len(stream)
    assert np.array_equal(last.mean, expected.mean)


def test_the_papers_filter_takes_nothing_backward(train):
    stream = [z for z in train.measurements() if z.time_s < 1020.0]
    pipeline = make(train, 'paper')
    run(pipeline, stream)
    assert pipeline.push(LoopPosition(1019.511, 100.0, 0.01)) == []
    assert pipeline.push(RadarSpeed(1019.512, 10.0, 0.01)) == []
    assert pipeline.rejected['loop'] == {'backward_time': 1}
    assert pipeline.rejected['radar'] == {'backward_time': 1}


@pytest.mark.parametrize('method', ['robust', 'kalman'])
def test_outliers_and_strange_balises_are_counted(train, method):
    """Each at a time of its own, on a train that knows where it is."""
    stream = train.measurements()
    rows = [i for i, z in enumerate(stream) if isinstance(z, RadarSpeed) and z.speed > 20.0]
    for i in rows[100:110]:
        stream[i] = stream[i]._replace(speed=stream[i].speed + 6.0)
    at = {z.balise: i for i, z in enumerate(stream) if isinstance(z, BalisePassing)}
    stream[at['b1']] = stream[at['b1']]._replace(balise='b3')
    stream[at['b2']] = stream[at['b2']]._replace(balise='x17')
    stream += [BalisePassing(stream[-1].time_s + 0.001, 'x18', 0.0, 0.01)]
    clean, pipeline = make(train, method), make(train, method)
    run(clean, train.measurements())
    estimates = run(pipeline, stream)
    assert pipeline.rejected['radar']['gate'] == clean.rejected['radar'].get('gate', 0) + 10
    assert pipeline.rejected['balise'] == {'wrong_id': 1, 'unknown_id': 2}
    assert inside(train, estimates, 3.5, train.passing_s(300.0))


def test_a_known_id_where_it_cannot_be_is_refused_by_the_gate(train):
    """The baseline has one place only; the better method asks what else may be."""
    pipeline = make(train, 'kalman')
    stream = [z for z in train.measurements() if z.time_s < 1050.0]
    run(pipeline, stream)
    pipeline.push(BalisePassing(1050.0, 'b3', 0.0, 0.01))
    assert pipeline.rejected['balise'] == {'gate': 1}


@pytest.mark.parametrize('method', ['robust', 'kalman'])
@pytest.mark.parametrize('seed', [1, 2])
def test_order_of_arrival_does_not_matter(train, method, seed):
    """
    Messages up to a second late end in the state of the right order, to 1e-9.

    With room for all hypotheses nothing is resampled, so no draw differs.
    """
    rng = np.random.default_rng(seed)
    stream = train.measurements()
    arrival = [z.time_s + (rng.uniform(0.0, 1.0) if rng.random() < 0.3 else 0.0) for z in stream]
    arrival[:80] = [z.time_s for z in stream[:80]]
    shuffled = [stream[i] for i in np.argsort(arrival, kind='stable')]
    end = [LoopPosition(1101.0, 2180.0, 0.004), RadarSpeed(1101.5, 25.0, 0.01)]
    ordered, mixed = (make(train, method, particles=100_000) for _ in range(2))
    expected, estimate = run(ordered, stream + end)[-1], run(mixed, shuffled + end)[-1]
    assert mixed.diagnostics()['events.loop.late'] > 100
    assert estimate.time_s == expected.time_s
    assert estimate.mean == pytest.approx(expected.mean, rel=1e-9, abs=1e-9)
    assert estimate.covariance == pytest.approx(expected.covariance, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize('method', ['robust', 'kalman'])
def test_what_late_messages_meet_is_counted_too(train, method):
    """All balises and the loop come 0.2 s after the radar: their wrong ids, their health."""
    stream = train.measurements()
    stream = [z._replace(balise='b3') if getattr(z, 'balise', '') == 'b1' else z for z in stream]
    stream.sort(key=lambda z: z.time_s + (0.0 if isinstance(z, RadarSpeed) else 0.2))
    pipeline = make(train, method)
    estimates = run(pipeline, stream)
    assert pipeline.rejected['balise'] == {'wrong_id': 1}
    assert set(pipeline.health().values()) == {'ok'}
    assert inside(train, estimates, 3.5, train.passing_s(300.0) + 1.0)
    assert {state for _, _, state in pipeline.health_changes()} == {'ok'}


@pytest.mark.parametrize('method', ['robust', 'kalman'])
@pytest.mark.parametrize('gap_s', [10.0, 100.0])
@pytest.mark.parametrize('counting', [True, False])
def test_after_a_gap(make_train, method, gap_s, counting):
    """
    The train runs on unheard at 20 m/s; the counter counts on or starts again at nought.

    Within its own sigmas throughout, at its place from the next balise on, and sure of it from
    the second on: of one id alone one in twenty is wrong.
    """
    train = make_train(
        top=20.0, seconds=240.0, balises=(200.0, 700.0, 1300.0, 2600.0, 3900.0, 4300.0)
    )
    begin = 1060.0
    stream = [z for z in train.measurements() if not begin < z.time_s < begin + gap_s]
    if not counting:
        lost = next(z.reading for z in only(stream, LoopPosition) if z.time_s > begin)
        stream = [
            z._replace(reading=z.reading - lost)
            if isinstance(z, LoopPosition) and z.time_s > begin
            else z
            for z in stream
        ]
    pipeline = make(train, method, length=6000.0)
    estimates = run(pipeline, stream)
    heard = [z.time_s for z in only(stream, BalisePassing) if z.time_s > begin + gap_s]
    time_s, along, sigma, *_ = train.errors(estimates)
    assert inside(train, estimates, 3.5, train.passing_s(200.0))
    assert np.abs(along[time_s > heard[0] + 1.0]).max() < 0.5
    assert sigma[time_s > heard[1] + 1.0].max() < 0.2
    assert sum(r.get('time_jump', 0) for r in pipeline.rejected.values()) == 1


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(
    ('kind', 'ahead_s'),
    [
        (LoopPosition, 6.0),
        (RadarSpeed, 20.0),
        (BalisePassing, 6.0),
        (BalisePassing, 29.0),
        (LoopPosition, 1000.0),
    ],
)
def test_a_single_stamp_in_the_future_does_no_harm(train, method, kind, ahead_s):
    """It is not believed: nothing is carried there, nothing else is too late."""
    stream = train.measurements()
    i = next(i for i, z in enumerate(stream) if isinstance(z, kind) and z.time_s > 1035.0)
    stream[i] = stream[i]._replace(time_s=stream[i].time_s + ahead_s)
    pipeline = make(train, method)
    estimates = run(pipeline, stream)
    time_s, along, *_ = train.errors(estimates)
    assert np.diff(time_s).max() < 0.11
    assert sum(r.get('time_jump', 0) for r in pipeline.rejected.values()) == 1
    assert sum(r.get('too_late', 0) for r in pipeline.rejected.values()) == 0
    assert np.abs(along[time_s > train.passing_s(300.0) + 1.0]).max() < 1.0


@pytest.mark.parametrize('kind', [LoopPosition, RadarSpeed])
def test_a_stamp_a_little_ahead_costs_seconds(train, kind):
    """4 s ahead is believed: data is too late until time has come up to it, less the horizon."""
    stream = train.measurements()
    i = next(i for i, z in enumerate(stream) if isinstance(z, kind) and z.time_s > 1035.0)
    stream[i] = stream[i]._replace(time_s=stream[i].time_s + 4.0)
    estimates = run(make(train), stream)
    time_s, along, *_ = train.errors(estimates)
    assert np.diff(time_s).max() < 4.1
    assert inside(train, estimates, 3.5, train.passing_s(300.0))
    assert np.abs(along[time_s > 1042.0]).max() < 0.5


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('wrong_s', [0.0, 1e5])
def test_a_first_stamp_of_another_clock_does_no_harm(train, method, wrong_s):
    """Zero, or a day ahead: after five seconds what all others tell is the time."""
    pipeline = make(train, method)
    estimates = run(pipeline, [RadarSpeed(wrong_s, 0.0, 0.01), *train.measurements()])
    time_s, along, *_ = train.errors(estimates)
    after = time_s > train.passing_s(300.0) + 1.0
    assert after.sum() > 1000
    assert np.abs(along[after]).max() < 1.0


@pytest.mark.parametrize('method', METHODS)
def test_a_recording_that_starts_over(train, method):
    """Counts go on, the filter begins anew: at the second time round it is as good."""
    pipeline = make(train, method)
    run(pipeline, train.measurements())
    before = pipeline.rejected
    estimates = run(pipeline, train.measurements())
    late = {s: r.get('too_late', 0) for s, r in pipeline.rejected.items()}
    time_s, along, *_ = train.errors(estimates)
    assert late['loop'] == pytest.approx(250, abs=2)
    assert late['radar'] == pytest.approx(100, abs=2)
    assert time_s[0] == pytest.approx(1005.0, abs=0.1)
    assert np.abs(along[time_s > train.passing_s(300.0) + 1.0]).max() < 1.0
    for sensor, reasons in before.items():
        for reason, count in reasons.items():
            assert pipeline.rejected[sensor][reason] >= count


@pytest.mark.parametrize('method', METHODS)
def test_reset_forgets_everything(train, method):
    stream = train.measurements()
    pipeline = make(train, method)
    first = run(pipeline, stream)
    pipeline.reset()
    assert pipeline.rejected == {}
    assert pipeline.diagnostics()['status'] == 'waiting for a start'
    assert set(pipeline.health().values()) == {'waiting'}
    second = run(pipeline, stream)
    assert all(np.array_equal(a.mean, b.mean) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize('method', METHODS)
def test_a_start_that_is_told_in_the_middle_of_a_run(train, method):
    """The counter began at 700 m less; who is told where the train is knows it from then on."""
    shifted = dataclasses.replace(train, zero_m=700.0, balises=())
    pipeline = make(shifted, method, table=NO_BALISES)
    stream = shifted.measurements()
    middle = next(i for i, z in enumerate(stream) if z.time_s > 1050.0)
    _, before, *_ = shifted.errors(run(pipeline, stream[:middle]))
    assert np.abs(before + 700.0).max() < 5.0
    assert pipeline.set_start(float(train.at(stream[middle].time_s)[0]), 0.25) is None
    _, after, sigma, speed, _ = shifted.errors(run(pipeline, stream[middle:]))
    assert len(after) == pytest.approx(1000, abs=5)
    assert np.abs(after[20:]).max() < (1.0 if method != 'paper' else 6.0)
    assert np.abs(speed[20:]).max() < 0.5
    if method != 'paper':
        assert 0.4 < sigma[-1] < 0.7


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(
    ('chainage', 'variance', 'why'),
    [
        (math.nan, 1.0, 'not_finite'),
        (10.0, math.inf, 'not_finite'),
        (10.0, 0.0, 'bad_variance'),
        (10.0, -1.0, 'bad_variance'),
        (4001.0, 1.0, 'off_the_line'),
        (-1001.0, 1.0, 'off_the_line'),
        (-999.0, 1.0, None),
        (10.0, 1e300, None),
        (10.0, 1e-300, None),
    ],
)
def test_starts_that_cannot_be(train, method, chainage, variance, why):
    """What is no start is told and changes nothing; what is one leads to finite estimates."""
    pipeline = make(train, method)
    assert pipeline.set_start(chainage, variance) == why
    estimates = run(pipeline, train.measurements()[:2000])
    _, along, sigma, *_ = train.errors(estimates)
    assert np.isfinite(along).all()
    assert np.isfinite(sigma).all()
    if why is not None:
        assert np.abs(along).max() < 5.0


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


def test_status_and_figures(train):
    pipeline = make(train)
    assert pipeline.diagnostics() == {
        'method': 'robust',
        'status': 'waiting for a start',
        'health.loop': 'waiting',
        'health.radar': 'waiting',
        'health.balise': 'waiting',
    }
    estimate = run(pipeline, train.measurements())[-1]
    told = pipeline.diagnostics()
    assert told['status'] == ''
    assert told['chainage_m'] == pytest.approx(estimate.chainage, abs=1e-3)
    assert told['sigma_along_m'] == pytest.approx(estimate.sigma_along, abs=1e-4)
    assert told['speed_mps'] == pytest.approx(estimate.speed, abs=1e-3)
    assert 1.0 <= told['n_eff'] <= told['hypotheses'] <= 1000
    assert 0.0 < told['nis.loop'] < 3.0
    assert 0.2 < told['nis.radar'] < 2.0


def test_status_names_what_is_wrong(train):
    pipeline = make(train)
    run(pipeline, [z for z in failing(train, LoopPosition, FAULTS[0][3]) if z.time_s < 1055.0])
    assert pipeline.diagnostics()['status'] == 'loop silent'


@pytest.mark.parametrize('method', METHODS)
def test_same_seed_same_bits(train, method):
    first, second = (run(make(train, method, particles=60), train.measurements()) for _ in range(2))
    assert all(np.array_equal(a.mean, b.mean) for a, b in zip(first, second, strict=True))
    assert all(
        np.array_equal(a.covariance, b.covariance) for a, b in zip(first, second, strict=True)
    )


@pytest.mark.parametrize('horizon_s', [0.0, 1.5])
def test_memory_is_flat(train, horizon_s):
    """What is kept is the horizon's worth of messages, however long it runs."""
    pipeline = make(train, horizon_s=horizon_s)
    most = 0
    for z in train.measurements():
        pipeline.push(z)
        most = max(most, len(pipeline._core._history))
    assert most < 5 + 1.3 * horizon_s * 70


@pytest.mark.parametrize('method', METHODS)
def test_a_sensor_that_claims_to_be_surer_than_any_does_not_break_the_covariance(method):
    """A variance of 1e-300 would leave rounding errors as what is not known."""
    balises = BaliseTable(('b0',), np.array([100.0]), np.array([0.02]))
    pipeline = MaglevPipeline(dataclasses.replace(MaglevConfig(), method=method), balises, 3000.0)
    told = []
    for k in range(40):
        told += pipeline.push(LoopPosition(10.0 + 0.02 * k, 0.0, 1e-300))
        told += pipeline.push(RadarSpeed(10.01 + 0.02 * k, -1.0, 1e-300))
    assert told
    assert all(np.diag(estimate.covariance).min() > 0.0 for estimate in told)

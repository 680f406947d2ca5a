"""Every method behind its one door: bad data counted, starts, what is told of the state."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helpers.maglev_pipeline import METHODS, NO_BALISES, inside, make, only, run

from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from maglev_localization.pipeline import MaglevPipeline
from track_localization.track.balise_table import BaliseTable


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

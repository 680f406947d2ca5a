"""Every method behind its one door: order of arrival, gaps, restarts, stamps of other clocks."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.maglev_pipeline import METHODS, inside, make, only, run

from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed


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
def test_ten_years_after_the_first_message_it_starts_anew(train, method):
    """Nothing was given out before: predicted over ten years, a state is rounding errors."""
    pipeline = make(train, method)
    stream = train.measurements()[:400]
    pipeline.push(next(z for z in stream if isinstance(z, LoopPosition)))
    later = [z._replace(time_s=z.time_s + 3.2e8) for z in stream]
    estimates = run(pipeline, later)
    assert len(estimates) > 40
    for estimate in estimates:
        assert np.diag(estimate.covariance)[:2].min() > 0.0
    assert abs(estimates[-1].chainage - run(make(train, method), stream)[-1].chainage) < 1.0


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

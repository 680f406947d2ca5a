"""The train's pipeline on a simulated run, and on what spoils one; truth is the simulator's."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from track_localization.estimation.imu import ImuSample
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.track.centreline import Centreline
from train_localization.config import TrainConfig
from train_localization.measurements import GnssFix, GnssQuality, WheelSpeed
from train_localization.pipeline import TrainPipeline

SEED = 31
OUTAGE_S = (100.0, 150.0)


@pytest.fixture(scope='module')
def run():
    return simulate_train(scenario('paper'), SEED)


@pytest.fixture(scope='module')
def stream(run):
    """All measurements in order of arrival."""
    timed = [
        (t, ImuSample(float(t), f, w))
        for t, f, w in zip(
            run.imu.time_s, run.imu.specific_force, run.imu.angular_rate, strict=True
        )
    ]
    g = run.gnss
    for i, t in enumerate(g.time_s.tolist()):
        quality = GnssQuality(t, int(g.satellites[i]), float(g.hdop[i]))
        place = (float(g.latitude[i]), float(g.longitude[i]), float(g.height[i]))
        fix = GnssFix(t, *place, g.covariance[i], bool(g.status[i]))
        timed += [(float(g.arrival_s[i]), quality), (float(g.arrival_s[i]) + 1e-6, fix)]
    w = run.wheel
    timed += [
        (a, WheelSpeed(t, v, r))
        for a, t, v, r in zip(
            w.arrival_s.tolist(),
            w.time_s.tolist(),
            w.speed.tolist(),
            w.variance.tolist(),
            strict=True,
        )
    ]
    return [measurement for _, measurement in sorted(timed, key=lambda pair: pair[0])]


class Outcome:
    """A pipeline after a stream, and its errors."""

    def __init__(self, run, measurements, track=None, told=True, **settings):
        config = override(TrainConfig(), {k.replace('__', '.'): v for k, v in settings.items()})
        self.pipeline = TrainPipeline(config, track, run.datum)
        if told:
            start = run.start
            assert (
                self.pipeline.set_start(
                    start.time_s, start.position, start.quaternion, start.covariance
                )
                is None
            )
        self.estimates, self.modes = [], []
        for measurement in measurements:
            for estimate in self.pipeline.push(measurement):
                self.estimates.append(estimate)
                self.modes.append((estimate.time_s - run.time_s[0], estimate.mode))
        self.time_s = np.array([e.time_s for e in self.estimates]) - run.time_s[0]
        there = np.array([e.position for e in self.estimates])
        true = [
            np.interp(self.time_s, run.time_s - run.time_s[0], run.position[:, k]) for k in range(3)
        ]
        self.error = there - np.stack(true, axis=1)
        self.sigma = np.sqrt([np.diag(e.covariance)[:3] for e in self.estimates])

    @property
    def horizontal(self):
        return np.hypot(self.error[:, 0], self.error[:, 1])

    def worst(self, begin_s, end_s):
        inside = (self.time_s >= begin_s) & (self.time_s <= end_s)
        return self.horizontal[inside].max()


@pytest.fixture(scope='module')
def plain(run, stream):
    return Outcome(run, stream)


def test_position_stays_within_what_fixes_and_outage_allow(plain):
    """About 1 m by fixes; 50 s at 55 m/s add 2 to 4 m with an industrial IMU."""
    assert plain.worst(20.0, 100.0) < 3.0
    assert plain.worst(*OUTAGE_S) < 6.0
    assert plain.worst(155.0, 200.0) < 3.0


def test_errors_are_what_sigma_says(plain):
    """One run's errors are correlated: four fifths inside 2 sigma, none beyond 4."""
    ratio = np.abs(plain.error[:, :2]) / plain.sigma[:, :2]
    assert np.mean(ratio < 2.0) > 0.8
    assert ratio.max() < 4.0


def test_estimates_come_ten_times_a_second(plain):
    assert np.median(np.diff(plain.time_s)) == pytest.approx(0.1, abs=0.011)
    assert np.diff(plain.time_s).max() < 0.25


def test_mode_follows_the_satellites_within_an_epoch_of_their_stamps(plain):
    """A fix is good for 2.5 s; where satellites are told to be gone the mode changes at once."""
    modes = dict(plain.modes)
    times = np.array(list(modes))

    def at(time_s):
        return modes[times[np.searchsorted(times, time_s)]]

    assert at(99.0) == 'BDS/SINS'
    assert at(104.0) == at(149.0) == 'SINS/DR'
    assert at(152.0) == 'BDS/SINS'


def test_no_jump_where_the_outage_begins(plain):
    """The estimate moves as the train does: no more than the filter's own correction, 0.3 m."""
    k = np.searchsorted(plain.time_s, 100.0)
    steps = np.diff(plain.error[k - 2 : k + 40], axis=0)
    assert np.abs(steps).max() < 0.3


def test_a_map_keeps_the_train_on_its_line(run, stream):
    with_map = Outcome(run, stream, Centreline.from_track(run.track), method='robust_map')
    assert with_map.worst(*OUTAGE_S) < 3.0
    assert with_map.estimates[-1].chainage == pytest.approx(run.chainage[-1], abs=5.0)
    assert with_map.pipeline.diagnostics()['map_right'] > 0.8


def test_a_map_that_is_off_is_found_out_by_the_fixes(run, stream):
    beside = dataclasses.replace(run.track, position=run.track.position + 5.0 * run.track.left)
    misled = Outcome(run, stream, Centreline.from_track(beside), method='robust_map')
    assert misled.pipeline.diagnostics()['map_right'] < 0.1
    after = misled.time_s > 20.0
    assert (misled.horizontal / np.hypot(*misled.sigma[:, :2].T))[after].max() < 3.0


def test_fixes_alone_drift_through_the_outage(run, stream, plain):
    alone = Outcome(run, stream, method='ins')
    assert alone.worst(*OUTAGE_S) > 1.5 * plain.worst(*OUTAGE_S)


def test_it_aligns_itself_under_way(run, stream):
    """The course of three fixes is good to a degree; level to another: enough to start from."""
    own = Outcome(run, stream, told=False)
    assert own.time_s[0] < 10.0
    assert own.worst(60.0, 100.0) < 3.0


def without(stream, kind):
    return [m for m in stream if not isinstance(m, kind)]


def test_without_odometer_it_runs_and_says_so(run, stream):
    lame = Outcome(run, without(stream, WheelSpeed), told=False)
    assert lame.worst(60.0, 100.0) < 4.0
    assert dict(lame.modes)[lame.modes[len(lame.modes) * 5 // 8][0]] == 'SINS'


def test_without_quality_every_valid_fix_counts(run, stream):
    assert Outcome(run, without(stream, GnssQuality)).worst(*OUTAGE_S) < 6.0


def test_hdop_may_be_missing(run, stream):
    blind = [m._replace(hdop=np.nan) if isinstance(m, GnssQuality) else m for m in stream]
    assert Outcome(run, blind).worst(20.0, 100.0) < 3.0


def test_fixes_without_covariance_are_used_with_an_assumed_one(run, stream):
    bare = [
        m._replace(covariance=np.zeros((3, 3))) if isinstance(m, GnssFix) else m for m in stream
    ]
    assert Outcome(run, bare).worst(20.0, 100.0) < 4.0


def test_an_odometer_without_a_variance_is_used_with_that_of_the_settings(run, stream, plain):
    bare = [m._replace(variance=0.0) if isinstance(m, WheelSpeed) else m for m in stream]
    np.testing.assert_allclose(Outcome(run, bare).error, plain.error, atol=0.2)


def test_stale_coordinates_of_a_receiver_without_a_fix_are_refused(run, stream):
    """In the outage the receiver repeats its last place, status no fix, quality not told."""
    last = [m for m in stream if isinstance(m, GnssFix) and m.valid and m.time_s < 1100.0][-1]
    stale = [
        m._replace(latitude=last.latitude, longitude=last.longitude, height=last.height)
        if isinstance(m, GnssFix) and not m.valid
        else m
        for m in without(stream, GnssQuality)
    ]
    out = Outcome(run, stale)
    assert out.worst(*OUTAGE_S) < 6.0
    assert out.pipeline.rejected['gnss']['no_fix'] == 50


def test_an_outlier_of_80_m_is_refused_and_counted(run, stream, plain):
    k = next(i for i, m in enumerate(stream) if isinstance(m, GnssFix) and m.time_s > 1063.0)
    far = stream[k]._replace(latitude=stream[k].latitude + 80.0 / 6.37e6)
    out = Outcome(run, [*stream[:k], far, *stream[k + 1 :]])
    assert out.worst(62.0, 68.0) < 3.0
    refused = out.pipeline.rejected['gnss']['gate']
    assert refused == plain.pipeline.rejected['gnss'].get('gate', 0) + 1


def test_wheels_that_slip_at_the_start_are_found_out(run, stream):
    """A fifth too fast for 3 s from the start on: fixes tell, and nothing is left of it later."""
    slipping = [
        m._replace(speed=1.2 * m.speed) if isinstance(m, WheelSpeed) and m.time_s < 1003.0 else m
        for m in stream
    ]
    out = Outcome(run, slipping)
    assert out.worst(20.0, 100.0) < 3.0
    assert out.worst(*OUTAGE_S) < 6.0


def test_a_stuck_odometer_does_not_carry_the_train_away(run, stream):
    """Stuck at zero in the outage: the gate takes it for slip, and the IMU coasts."""
    stuck = [
        m._replace(speed=0.0) if isinstance(m, WheelSpeed) and 1110.0 < m.time_s < 1116.0 else m
        for m in stream
    ]
    assert Outcome(run, stuck).worst(*OUTAGE_S) < 8.0


def test_a_gap_of_the_imu_opens_sigma_and_closes_again(run, stream):
    """1.5 s without IMU, with fixes: metres of doubt, gone after ten seconds."""
    gap = [m for m in stream if not (isinstance(m, ImuSample) and 1060.0 < m.time_s < 1061.5)]
    out = Outcome(run, gap)
    assert out.worst(20.0, 100.0) < 5.0
    assert out.worst(75.0, 100.0) < 3.0


def test_numbers_that_mean_nothing_are_counted(run, stream):
    nan = np.full(3, np.nan)
    bad = [
        ImuSample(1050.0055, nan, nan),
        ImuSample(1050.0056, np.array([1e4, 0.0, 0.0]), np.zeros(3)),
        WheelSpeed(1050.0057, np.nan, 0.01),
        WheelSpeed(1050.0058, 50.0, -1.0),
        WheelSpeed(1050.0059, 1e4, 0.01),
        GnssFix(1050.006, np.nan, 2.0, 0.0, np.eye(3)),
        GnssFix(1050.0061, 3.0, 2.0, 0.0, np.eye(3)),
        GnssFix(1050.0062, 0.7, 2.0, 0.0, -np.eye(3)),
    ]
    k = next(i for i, m in enumerate(stream) if isinstance(m, ImuSample) and m.time_s > 1050.006)
    out = Outcome(run, [*stream[:k], *bad, *stream[k:]])
    assert out.pipeline.rejected['imu'] == {'not_finite': 1, 'implausible': 1}
    assert out.pipeline.rejected['wheel']['bad_variance'] == 1
    assert out.pipeline.rejected['gnss']['bad_variance'] == 1
    assert out.worst(20.0, 100.0) < 3.0


def test_stamps_that_repeat_or_go_back_are_counted(run, stream):
    k = next(i for i, m in enumerate(stream) if isinstance(m, ImuSample) and m.time_s > 1050.0)
    sample = stream[k]
    odd = [sample, sample._replace(time_s=sample.time_s - 0.1005), sample._replace(time_s=900.0)]
    out = Outcome(run, [*stream[: k + 1], *odd, *stream[k + 1 :]])
    counted = out.pipeline.rejected['imu']
    assert counted['repeated_time'] == counted['backward_time'] == counted['too_late'] == 1
    assert out.worst(20.0, 100.0) < 3.0


def test_late_fixes_give_the_same_end_as_fixes_in_time(run, stream, plain):
    """One second late is within the horizon: what came after them is done again."""
    waiting, late = [], []
    for m in stream:
        if isinstance(m, GnssFix | GnssQuality):
            waiting.append(m)
            continue
        while waiting and m.time_s > waiting[0].time_s + 1.0:
            late.append(waiting.pop(0))
        late.append(m)
    out = Outcome(run, late)
    k = np.searchsorted(out.time_s, 199.0)
    assert np.abs(out.error[k] - plain.error[np.searchsorted(plain.time_s, 199.0)]).max() < 0.3


def test_reset_forgets_everything(run, stream):
    pipeline = Outcome(run, stream[:5000]).pipeline
    pipeline.reset()
    assert pipeline.mode == 'aligning'
    assert pipeline.rejected == {}
    assert not [e for m in stream[5000:5100] for e in pipeline.push(m)]


def test_reset_leaves_the_map_where_it_is(run, stream):
    """Without a datum ``map`` is at the first fix, and what others placed in it stays there."""
    pipeline = TrainPipeline(TrainConfig())
    for measurement in stream[:3000]:
        pipeline.push(measurement)
    before = pipeline.datum
    pipeline.reset()
    for measurement in stream[3000:4000]:
        pipeline.push(measurement)
    assert before is not None
    assert pipeline.datum == before


def test_without_an_odometer_a_told_start_gives_way_to_an_own_one(run, stream):
    """Nothing tells how far the train has come since; fixes do, a few seconds later."""
    lame = Outcome(run, without(stream, WheelSpeed))
    assert 2.0 < lame.time_s[0] < 10.0
    assert lame.horizontal[0] < 5.0
    assert lame.worst(60.0, 100.0) < 4.0


def test_a_start_needs_a_datum_and_numbers(run):
    pipeline = TrainPipeline(TrainConfig())
    start = run.start
    told = (start.time_s, start.position, start.quaternion, start.covariance)
    assert pipeline.set_start(*told) == 'no_datum'
    pipeline = TrainPipeline(TrainConfig(), None, run.datum)
    assert pipeline.set_start(told[0], told[1] * np.nan, *told[2:]) == 'not_finite'


def test_a_filter_that_diverges_starts_anew_and_is_counted(run, stream):
    """The covariance is spoilt from outside; what comes out stays finite, and it goes on."""
    pipeline = Outcome(run, stream[:9000]).pipeline
    entries = list(pipeline.entries())
    entries[-1][2].P[:] = np.nan
    told = [e for m in stream[9000:16000] for e in pipeline.push(m)]
    assert pipeline.rejected['filter'] == {'diverged': 1}
    assert told
    assert all(np.isfinite(e.covariance).all() for e in told)

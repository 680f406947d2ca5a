"""Cleaning and watching an IMU stream."""

import numpy as np
import pytest

from track_localization.estimation.gating import Rejections, chi2_gate, nis
from track_localization.estimation.imu import ImuSample, ImuSeries, clean
from track_localization.estimation.imu_monitor import ClockGuard, ImuMonitor


def test_clean_counts_each_reason():
    time_s = np.concatenate([[0.0, 1.0, 1.0, 0.5, 2.0, np.nan, 3.0, 4.0], np.arange(5.0, 30.0)])
    force = np.ones((33, 3))
    force[4, 1] = np.inf
    rate = np.zeros((33, 3))
    rate[6, 0] = np.nan
    series, counts = clean(ImuSeries(time_s, force, rate))
    np.testing.assert_array_equal(series.time_s[:4], [0.0, 1.0, 4.0, 5.0])
    assert counts == {'not_finite': 3, 'repeated_time': 1, 'backward_time': 1}


def test_one_stamp_years_ahead_does_not_cost_the_recording():
    time_s = np.arange(100.0)
    time_s[3] = 1.7e9
    series, counts = clean(ImuSeries(time_s, np.ones((100, 3)), np.zeros((100, 3))))
    assert counts == {'time_jump': 1}
    assert len(series) == 99
    assert series.time_s[-1] == 99.0


def test_clean_keeps_a_recording_without_gyro():
    series, counts = clean(ImuSeries(np.arange(3.0), np.ones((3, 3)), np.full((3, 3), np.nan)))
    assert len(series) == 3
    assert not series.has_gyro
    assert counts == {}


def test_monitor_measures_vibration_above_four_hertz_only():
    dt = 0.005
    time_s = np.arange(0.0, 20.0, dt)

    def rms_of(frequency):
        monitor = ImuMonitor()
        force = np.outer(np.sqrt(2) * np.sin(2 * np.pi * frequency * time_s), np.ones(3))
        for t, f in zip(time_s, force, strict=True):
            step = monitor.push(ImuSample(t, f, np.zeros(3)))
        return step.vibration

    assert rms_of(0.5) < 0.15
    assert rms_of(20.0) == pytest.approx(0.95, abs=0.1)


def test_monitor_step_holds_the_trapezoid_mean():
    monitor = ImuMonitor()
    first = monitor.push(ImuSample(1.0, np.array([1.0, 0, 9.0]), np.zeros(3)))
    assert first.dt == 0.0
    step = monitor.push(ImuSample(1.1, np.array([3.0, 0, 10.0]), np.array([0.0, 0.2, 0.0])))
    assert step.dt == pytest.approx(0.1)
    np.testing.assert_allclose(step.f, [2.0, 0, 9.5])
    np.testing.assert_allclose(step.w, [0.0, 0.1, 0.0])


def test_clock_guard_refuses_single_leaps_and_follows_a_clock_that_stays():
    guard = ClockGuard(max_gap_s=5.0, patience=4)
    assert [guard.check(t) for t in (1.0, 1.1)] == [None, None]
    assert guard.check(1.1) == 'repeated_time'
    assert guard.check(0.9) == 'backward_time'
    assert guard.check(1e9) == 'time_jump'
    assert guard.check(float('nan')) == 'not_finite'
    assert guard.check(1.2) is None
    verdicts = [guard.check(0.01 * k) for k in range(1, 5)]
    assert verdicts == ['backward_time'] * 3 + ['restart']
    assert guard.check(0.05) is None


def test_chi2_gate_and_nis():
    assert chi2_gate(0.95, 1) == pytest.approx(3.841, abs=1e-3)
    assert nis(np.array([2.0, 1.0]), np.diag([4.0, 0.25])) == pytest.approx(5.0)


def test_rejections_are_counted_by_sensor_and_reason():
    rejections = Rejections()
    rejections.add('imu', 'not_finite')
    rejections.add('imu', 'not_finite', 2)
    rejections.add('match', 'gate')
    assert rejections.as_dict() == {'imu': {'not_finite': 3}, 'match': {'gate': 1}}
    assert rejections.total('imu') == 3
    assert rejections.total('gnss') == 0

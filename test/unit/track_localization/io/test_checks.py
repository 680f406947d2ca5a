"""Each fault of a recording is found and named, with its remedy; a good one passes in silence."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.so3 import matrix_from_rpy
from track_localization.io.checks import inspect_imu, to_si

G = 9.80665


def ride(rate_hz=100.0, seconds=40.0, mount_rpy_deg=(0.0, 0.0, 0.0)):
    """Return a made-up ride: 5 s rest, waves of force and turns, 5 s rest, in sensor axes."""
    rng = np.random.default_rng(1)
    t = 7.0 + np.arange(round(seconds * rate_hz)) / rate_hz
    moving = ((t > 12.0) & (t < 2.0 + seconds)).astype(float)
    force = np.stack([0.8 * np.sin(t), 1.5 * np.sin(1.7 * t), 8.0 * np.sin(0.9 * t)], axis=1)
    rate = np.stack([0.4 * np.sin(t), 0.9 * np.cos(t), 0.6 * np.sin(2.0 * t)], axis=1)
    force = moving[:, None] * (force + rng.normal(scale=0.5, size=force.shape))
    force += np.array([0.0, 0.0, G]) + rng.normal(scale=0.02, size=force.shape)
    rate = moving[:, None] * rate + rng.normal(scale=0.002, size=rate.shape)
    R_bm = matrix_from_rpy(*np.radians(mount_rpy_deg))  # v_b = R_bm v_m
    return ImuSeries(t, force @ R_bm, rate @ R_bm)


def said(findings):
    return '\n'.join(str(finding) for finding in findings)


def test_a_good_ride_passes_in_silence():
    assert inspect_imu(ride()) == []


def test_no_gyro_says_what_still_works():
    imu = ride()
    imu.angular_rate[:] = np.nan
    (finding,) = inspect_imu(imu)
    assert finding.severity == 'warning'
    assert finding.what == 'no gyroscope'
    assert 'srdtw_z' in finding.remedy
    imu.angular_rate[:] = 0.0
    (finding,) = inspect_imu(imu)
    assert finding.severity == 'error'
    assert 'zeros' in finding.what


def test_20_hz_is_a_warning_and_2_hz_an_error():
    (finding,) = inspect_imu(ride(rate_hz=20.0))
    assert (finding.severity, finding.what) == ('warning', '20 Hz is slow')
    assert 'z still works' in finding.remedy
    assert inspect_imu(ride(rate_hz=2.0))[0].severity == 'error'


def test_gaps_are_listed_with_place_and_length():
    imu = ride()
    imu = imu[~((imu.time_s > 20.0) & (imu.time_s < 21.5)) & (np.abs(imu.time_s - 30.0) > 0.2)]
    (finding,) = inspect_imu(imu)
    assert '2 gaps' in finding.what
    assert '1.5 s at 20.000 s' in finding.what
    assert '0.42 s at 29.790 s' in finding.what


@pytest.mark.parametrize(('factor', 'unit'), [(1e3, 'ms'), (1e6, 'us'), (1e9, 'ns')])
def test_stamps_in_other_units(factor, unit):
    imu = ride()
    findings = inspect_imu(ImuSeries(imu.time_s * factor, imu.specific_force, imu.angular_rate))
    assert findings[0].severity == 'error'
    assert f'look like {unit} ' in findings[0].what


def test_rejections_are_passed_on():
    findings = inspect_imu(ride(), {'repeated_time': 12, 'backward_time': 3, 'odd_reason': 1})
    text = said(findings)
    assert '12 samples repeat a stamp' in text
    assert '3 samples are stamped earlier' in text
    assert 'odd_reason' in text
    assert all(finding.severity == 'warning' for finding in findings)
    (finding,) = inspect_imu(ride(), {'backward_time': 5000})
    assert finding.severity == 'error'


def test_force_in_g_is_told_and_converted():
    imu = ride()
    in_g = ImuSeries(imu.time_s, imu.specific_force / G, imu.angular_rate)
    assert 'Set units to g' in inspect_imu(in_g)[0].remedy
    converted, notes = to_si(in_g)
    np.testing.assert_allclose(converted.specific_force, imu.specific_force)
    assert [note.severity for note in notes] == ['info']
    assert inspect_imu(converted) == []
    same, notes = to_si(in_g, 'si')
    assert same is in_g
    assert notes == []


def test_rates_in_degrees_are_told_but_converted_only_when_asked():
    imu = ride()
    degrees = ImuSeries(imu.time_s, imu.specific_force / G, np.degrees(imu.angular_rate))
    auto, _ = to_si(degrees)
    np.testing.assert_array_equal(auto.angular_rate, degrees.angular_rate)
    (finding,) = inspect_imu(auto)
    assert finding.severity == 'error'
    assert 'deg/s' in finding.what
    converted, _ = to_si(degrees, 'g_deg')
    np.testing.assert_allclose(converted.angular_rate, imu.angular_rate)
    np.testing.assert_allclose(converted.specific_force, imu.specific_force)
    with pytest.raises(DataError, match='units'):
        to_si(imu, 'furlongs')


@pytest.mark.parametrize(
    ('rpy', 'axis'),
    [((90, 0, 0), 'y'), ((-90, 0, 0), '-y'), ((0, -90, 0), 'x'), ((180, 0, 0), '-z')],
)
def test_gravity_on_another_axis_gives_a_mount_that_levels(rpy, axis):
    imu = ride(mount_rpy_deg=rpy)
    (finding,) = inspect_imu(imu)
    assert finding.severity == 'warning'
    assert f'felt on {axis},' in finding.what
    roll, pitch = (float(v) for v in finding.remedy.split('[')[1].split(',')[:2])
    up = matrix_from_rpy(np.radians(roll), np.radians(pitch), 0.0) @ imu.specific_force[:400].mean(
        axis=0
    )
    np.testing.assert_allclose(up, [0.0, 0.0, G], atol=0.2)


def test_a_small_tilt_is_only_mentioned():
    (finding,) = inspect_imu(ride(mount_rpy_deg=(8.0, 0.0, 0.0)))
    assert finding.severity == 'info'
    assert '[8, 0, YAW]' in finding.remedy
    assert inspect_imu(ride(mount_rpy_deg=(3.0, 0.0, 0.0))) == []


def test_removed_gravity_and_unknown_scale():
    imu = ride()
    (finding,) = inspect_imu(
        ImuSeries(imu.time_s, imu.specific_force - [0.0, 0.0, G], imu.angular_rate)
    )
    assert finding.severity == 'error'
    assert 'gravity was removed' in finding.what
    (finding,) = inspect_imu(ImuSeries(imu.time_s, imu.specific_force * 1.2, imu.angular_rate))
    assert 'instead of 9.807' in finding.what


def test_dead_channels_and_clipping():
    imu = ride()
    imu.specific_force[:, 1] = 0.25
    (finding,) = inspect_imu(imu)
    assert finding.what == 'force y never changes from 0.25'
    imu = ride()
    imu.specific_force[:, 2] = np.minimum(imu.specific_force[:, 2], 16.0)
    (finding,) = inspect_imu(imu)
    assert finding.severity == 'warning'
    assert 'force z stays at 16' in finding.what


def test_no_rest_and_hardly_any_samples():
    imu = ride()
    middle = imu[(imu.time_s > 14.0) & (imu.time_s < 34.0)]
    assert 'no second at rest' in said(inspect_imu(middle))
    assert inspect_imu(imu[:1])[0].severity == 'error'
    assert 'shorter than 10 s' in said(inspect_imu(imu[:300]))
    assert inspect_imu(imu[:0])[0].severity == 'error'
    assert to_si(imu[:0])[1] == []

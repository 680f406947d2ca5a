"""The train's node: messages in, odometry out; the filter itself is tested elsewhere."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from helpers.train_messages import (
    DATUM,
    QUATERNION,
    FakeFilter,
    estimate,
    fix,
    imu,
    quality,
    start,
    wheel,
)
from nav_msgs.msg import Odometry
from sensor_msgs.msg import NavSatFix
from std_srvs.srv import Trigger

from track_localization.errors import DataError
from track_localization.estimation import so3
from track_localization.estimation.imu import ImuSample
from train_localization.measurements import GnssFix, GnssQuality, WheelSpeed
from train_localization.nodes.train_kf import TrainKfNode

PLACE = [45.0, 9.0, 120.0]


@pytest.fixture
def fake(ros):
    def make(**parameters):
        return ros.make(TrainKfNode, FakeFilter, **parameters)

    return make


def test_measurements_reach_the_filter_with_their_own_stamps(ros, fake, talk):
    node = fake()
    talk('imu/data_raw', imu(12.25))
    talk('gnss/fix', fix(12.0))
    talk('gnss/quality', quality(12.0, satellites_used='7', hdop='1.25'))
    talk('wheel/twist', wheel(11.5, -3.0))
    assert ros.spin_until(lambda: len(node.filter.pushed) == 4)
    sample, place, told, speed = node.filter.pushed
    assert isinstance(sample, ImuSample)
    assert sample.time_s == 12.25
    np.testing.assert_array_equal(sample.specific_force, [0.1, 0.2, 9.8])
    np.testing.assert_array_equal(sample.angular_rate, [0.01, 0.02, 0.03])
    assert isinstance(place, GnssFix)
    numbers = (12.0, math.radians(45.0), math.radians(9.0), 150.0)
    assert place[:4] == pytest.approx(numbers, rel=1e-15)
    np.testing.assert_array_equal(place.covariance, np.diag([1.0, 2.0, 3.0]))
    assert place.valid
    assert (told, speed) == (GnssQuality(12.0, 7, 1.25), WheelSpeed(11.5, -3.0, 0.04))


@pytest.mark.parametrize('msg', [fix(kind=0), fix(spread=(0.0, 0.0, 0.0))])
def test_a_fix_of_unknown_covariance_is_used(fake, msg):
    node = fake()
    node.on_fix(msg)
    assert np.isnan(node.filter.pushed[0].covariance).all()
    assert node.filter.pushed[0].valid


@pytest.mark.parametrize('latitude', [45.0, math.nan, 1e300])
def test_a_receiver_without_a_fix_says_nothing_else(fake, latitude):
    node = fake()
    node.on_fix(fix(latitude=latitude, status=-1, spread=(math.inf, 1.0, 1.0)))
    assert not node.filter.pushed[0].valid


@pytest.mark.parametrize('hdop', [{}, {'hdop': 'good'}])
def test_a_quality_without_a_readable_hdop_tells_the_satellites(fake, hdop):
    node = fake()
    node.on_quality(quality(satellites_used='4', **hdop))
    assert node.filter.pushed[0].satellites == 4
    assert math.isnan(node.filter.pushed[0].hdop)


def skewed() -> NavSatFix:
    msg = fix()
    msg.position_covariance[1] = 0.5
    return msg


@pytest.mark.parametrize(
    ('sensor', 'msg', 'reason'),
    [
        ('imu', imu(force=(math.nan, 0.0, 9.8)), 'not_finite'),
        ('imu', imu(frame='base_link'), 'wrong_frame'),
        ('fix', fix(frame=''), 'empty_frame'),
        ('fix', fix(frame='map'), 'wrong_frame'),
        ('fix', fix(latitude=math.nan), 'not_finite'),
        ('fix', fix(latitude=91.0), 'implausible'),
        ('fix', fix(spread=(math.nan, 1.0, 1.0)), 'covariance_not_finite'),
        ('fix', fix(spread=(-1.0, 1.0, 1.0)), 'covariance_not_positive'),
        ('fix', skewed(), 'covariance_asymmetric'),
        ('quality', quality(hdop='1.0'), 'no_satellites'),
        ('quality', quality(satellites_used='-3'), 'no_satellites'),
        ('wheel', wheel(frame='wheel'), 'wrong_frame'),
        ('wheel', wheel(v=math.inf), 'not_finite'),
        ('wheel', wheel(variance=-1.0), 'covariance_not_positive'),
    ],
)
def test_a_bad_message_is_counted_and_goes_no_further(fake, sensor, msg, reason):
    node = fake()
    getattr(node, f'on_{sensor}')(msg)
    assert node.filter.pushed == []
    stream = node.gnss if sensor == 'fix' else getattr(node, sensor)
    assert (dict(stream.rejected), stream.received) == ({reason: 1}, 1)


def test_a_speed_whose_variance_is_not_told_is_used(fake):
    node = fake()
    node.on_wheel(wheel(v=3.0, variance=0.0))
    assert [(m.speed, m.variance) for m in node.filter.pushed] == [(3.0, 0.0)]
    assert not node.wheel.rejected


def test_an_estimate_is_published_as_odometry_and_fix(ros, fake):
    node = fake(frame_map='site', frame_base='train', frame_gnss='antenna', datum__place=PLACE)
    assert node.filter.datum == pytest.approx(DATUM)
    listener = ros.node('listener')
    odometries = ros.listen(listener, Odometry, 'odometry')
    fixes = ros.listen(listener, NavSatFix, 'gnss/filtered')
    chainages = ros.listen(listener, PoseWithCovarianceStamped, 'track/pose')
    ros.wait_matched(node._odometry_pub)
    ros.wait_matched(node._fix_pub)
    node.on_wheel(wheel(12.25, frame='train'))
    assert ros.spin_until(lambda: odometries and fixes)
    msg, place = odometries[0], fixes[0]
    assert (msg.header.frame_id, msg.child_frame_id) == ('site', 'train')
    assert msg.header.stamp == Time(sec=12, nanosec=250_000_000) == place.header.stamp
    linear = msg.twist.twist.linear
    np.testing.assert_allclose([linear.x, linear.y, linear.z], [50.0, 0.0, 0.0], atol=1e-12)
    assert msg.twist.twist.angular.z == 0.01
    assert (place.latitude, place.longitude, place.altitude) == pytest.approx(tuple(PLACE))
    assert (place.header.frame_id, place.position_covariance_type) == ('antenna', 3)
    P = np.array(place.position_covariance).reshape(3, 3)
    np.testing.assert_allclose(P, np.diag([4.0, 1.0, 9.0]), atol=1e-12)
    assert not chainages


def test_covariances_are_those_of_errors_drawn(fake, rng):
    """
    True poses and velocities drawn about the estimate, seen as ROS sees them: rotation about map.

    200 000 draws tell a variance to 0.3 %; second order of 0.03 rad is as little.
    """
    node = fake()
    node.on_wheel(wheel())
    given = estimate(1.0)
    R = so3.matrix_from_quat(QUATERNION)
    d = rng.multivariate_normal(np.zeros(9), given.covariance, 200_000)
    rotation = d[:, 6:] @ R.T
    seen = np.cov(np.hstack([d[:, :3], rotation]).T)
    P = np.array(node._odometry.pose.covariance).reshape(6, 6)
    np.testing.assert_allclose(P, seen, atol=0.015 * np.sqrt(np.outer(*[np.diag(seen)] * 2)).max())
    np.testing.assert_allclose(np.diag(P), np.diag(seen), rtol=0.02)
    # R_true = R exp(theta), and the true velocity in true axes.
    turned = np.array([so3.exp(theta).T for theta in d[:20_000, 6:]])
    velocity = np.einsum('nij,nj->ni', turned, (given.velocity + d[:20_000, 3:6]) @ R)
    seen = np.cov(velocity.T)
    P = np.array(node._odometry.twist.covariance).reshape(6, 6)[:3, :3]
    np.testing.assert_allclose(np.diag(P), np.diag(seen), rtol=0.05)


def test_with_a_track_its_chainage_is_told(ros, fake, maglev_files):
    node = fake(track=maglev_files['track'], datum__place=PLACE)
    chainages = ros.listen(ros.node('listener'), PoseWithCovarianceStamped, 'track/pose')
    ros.wait_matched(node._chainage_pub)
    assert node.filter.line.length == pytest.approx(3000.0, abs=1e-3)
    node.on_wheel(wheel(12.25))
    assert ros.spin_until(lambda: chainages)
    along = chainages[0]
    assert along.header.frame_id == 'track'
    assert (along.pose.pose.position.x, along.pose.covariance[0]) == (321.5, 2.25)


def test_the_datum_may_be_a_file_and_only_one_is_given(fake, tmp_path, maglev_files):
    path = tmp_path / 'datum.yaml'
    path.write_text('latitude_deg: 45\nlongitude_deg: 9.0\nheight_m: 120.0\n', encoding='utf-8')
    assert fake(datum__file=str(path)).filter.datum == pytest.approx(DATUM)
    with pytest.raises(DataError, match=r'datum\.file: datum\.place is given too'):
        fake(datum__file=str(path), datum__place=PLACE)
    with pytest.raises(DataError, match='track: a line means nothing without the origin'):
        fake(track=maglev_files['track'])
    path.write_text('latitude_deg: north\n', encoding='utf-8')
    with pytest.raises(DataError, match=r"datum\.yaml: latitude_deg is 'north'"):
        fake(datum__file=str(path))


def test_initialpose_says_where_the_train_is_and_how_it_is_turned(ros, fake, talk):
    node = fake()
    talk('initialpose', start())
    assert ros.spin_until(lambda: node.filter.starts)
    time_s, position, quaternion, covariance = node.filter.starts[0]
    assert time_s == 7.5
    np.testing.assert_array_equal(position, [10.0, 0.0, 0.0])
    np.testing.assert_allclose(quaternion, QUATERNION, atol=1e-15)
    np.testing.assert_array_equal(covariance, np.diag([4.0, 4.0, 4.0, 0.01, 0.02, 0.03]))


def test_a_bad_initialpose_changes_nothing_and_is_counted(fake):
    node = fake()
    for msg in (
        start(spread=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)),
        start(spread=(1.0, 1.0, 1.0, 0.0, 0.0, 0.07)),
        start(spread=(1.0, 1.0, 1.0, 1e8, 0.01, 0.01)),
        start(frame='track'),
        start(q=(0.0, 0.0, 0.0, 0.0)),
        start(math.nan),
        start(2e5),
    ):
        node.on_initialpose(msg)
    assert node.filter.starts == []
    assert dict(node.start.rejected) == {
        'no_attitude_covariance': 1,
        'attitude_unknown': 1,
        'covariance_not_positive': 1,
        'wrong_frame': 1,
        'bad_quaternion': 1,
        'not_finite': 1,
        'no_datum': 1,
    }


def test_a_start_is_taken_in_its_order_among_the_sensors(ros, fake, talk):
    """A start forgets the samples before it: one that overtakes them would forget too few."""
    node = fake()
    talk('imu/data_raw', imu(1.0))
    talk('initialpose', start())
    assert ros.spin_until(lambda: node.filter.starts and node.filter.pushed)
    order = []
    node.filter.push = lambda measurement: order.append(measurement.time_s) or []
    node.filter.set_start = lambda *pose: order.append('start')
    for k in range(50):
        talk('imu/data_raw', imu(10.0 + k))
        if k == 24:
            talk('initialpose', start())
    assert ros.spin_until(lambda: len(order) == 51)
    assert order == [10.0 + k for k in range(25)] + ['start'] + [10.0 + k for k in range(25, 50)]


def test_reset_starts_anew(ros, fake):
    node, caller = fake(), ros.node('caller')
    node.on_wheel(wheel())
    client = caller.create_client(Trigger, 'train_kf/reset')
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().success
    assert (node.filter.resets, len(node._path)) == (1, 0)


def test_diagnostics_tell_mode_sensors_and_map(ros, fake):
    node = fake()
    arrays = ros.listen(ros.node('listener'), DiagnosticArray, '/diagnostics')
    for k in range(5):
        node.on_imu(imu(10.0 + 0.01 * k))
        node.on_fix(fix(10.0 + k))
    node.on_fix(fix(15.0, frame=''))
    assert ros.spin_until(lambda: arrays, 5.0)
    status = {s.name.removeprefix('train_kf'): s for s in arrays[0].status}
    assert set(status) == {'', ': imu', ': gnss', ': quality', ': wheel', ': initialpose'}
    values = {name: {v.key: v.value for v in s.values} for name, s in status.items()}
    assert (values['']['mode'], values['']['method']) == ('SINS/DR', 'robust')
    assert values['']['map.off_the_map'] == '3'
    told = values[': gnss']
    assert (told['received'], told['accepted'], told['nis']) == ('6', '3', '0.9')
    assert (told['rejected.gate'], told['rejected.empty_frame']) == ('2', '1')
    assert status[': wheel'].message == 'wheel: no messages'
    assert status[': quality'].level == DiagnosticStatus.OK


@pytest.mark.parametrize('broken', ['nan', 'negative', 'raised'])
def test_a_filter_whose_numbers_are_none_begins_anew(fake, broken):
    node = fake()

    def push(measurement):
        if broken == 'raised':
            raise np.linalg.LinAlgError('singular matrix')
        given = estimate(measurement.time_s)
        if broken == 'nan':
            return [dataclasses.replace(given, position=np.array([0.0, math.nan, 0.0]))]
        return [dataclasses.replace(given, covariance=-given.covariance)]

    node.filter.push = push
    node.on_wheel(wheel(10.0))
    assert (node.filter.resets, len(node._path)) == (1, 0)
    assert node._figures()['diverged'] == 1
    del node.filter.push
    node.on_wheel(wheel(11.0))
    assert len(node._path) == 1

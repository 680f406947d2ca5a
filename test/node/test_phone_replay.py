"""A phone's Sensor Logger export, replayed as imu/data_raw."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_msgs.msg import Imu

from coaster_localization.nodes.imu_publisher import ImuPublisherNode
from track_localization.errors import DataError
from track_localization.ros.convert import seconds
from track_localization.ros.fast import subscribe
from track_localization.ros.qos import MEASUREMENT_QOS

EPOCH_NS = 1_700_000_000_000_000_000
COUNT = 600


def write_export(folder, values, names=('TotalAcceleration', 'Gyroscope'), count=COUNT):
    """Write files of (N, 3) values at 100 Hz in the app's columns: time, elapsed, z, y, x."""
    folder.mkdir()
    for name, table in zip(names, values, strict=True):
        rows = [
            f'{EPOCH_NS + 10_000_000 * i},{0.01 * i:.3f},{z!r},{y!r},{x!r}'
            for i, (x, y, z) in enumerate(table[:count].tolist())
        ]
        text = '\n'.join(['time,seconds_elapsed,z,y,x', *rows, ''])
        (folder / f'{name}.csv').write_text(text, encoding='utf-8')
    return str(folder)


@pytest.fixture
def motion(rng):
    """Rest with noise: force (N, 3) and rate (N, 3)."""
    force = rng.normal([0.1, 0.2, 9.81], 0.02, (COUNT, 3))
    return force, rng.normal(0.0, 0.005, (COUNT, 3))


def replay(ros, source, **parameters):
    received: list[Imu] = []
    subscribe(ros.node('listener'), Imu, 'imu/data_raw', received.append, MEASUREMENT_QOS)
    node = ros.make_apart(ImuPublisherNode, source=source, rate=20.0, **parameters)
    ros.run_replay(node)
    ros.settle(lambda: len(received) == node.replayer.sent['imu/data_raw'], 5.0)
    return node, received


def test_an_android_export_goes_out_as_it_was_measured(ros, tmp_path, motion):
    _, received = replay(ros, write_export(tmp_path / 'ride', motion), frame_imu='phone')
    assert len(received) == COUNT
    force = np.array([[a.x, a.y, a.z] for a in (m.linear_acceleration for m in received)])
    rate = np.array([[w.x, w.y, w.z] for w in (m.angular_velocity for m in received)])
    np.testing.assert_allclose(force, motion[0], atol=1e-12)
    np.testing.assert_allclose(rate, motion[1], atol=1e-9)
    assert seconds(received[0].header.stamp) == pytest.approx(EPOCH_NS / 1e9, abs=1e-6)
    assert {m.header.frame_id for m in received} == {'phone'}
    assert all(m.orientation_covariance[0] == -1.0 for m in received)


def test_an_export_in_g_is_converted(ros, tmp_path, motion):
    export = write_export(tmp_path / 'ride', (motion[0] / 9.80665, motion[1]))
    node, received = replay(ros, export)
    assert np.mean([m.linear_acceleration.z for m in received]) == pytest.approx(9.81, abs=0.01)
    assert any('in g' in finding.what for finding in node.findings)


def test_an_export_without_gyro_says_so_in_words_and_in_every_message(ros, tmp_path, motion):
    export = write_export(tmp_path / 'ride', motion[:1], ('TotalAcceleration',))
    node, received = replay(ros, export)
    assert any('no gyro' in finding.what for finding in node.findings)
    assert len(received) == COUNT
    assert all(m.angular_velocity_covariance[0] == -1.0 for m in received)


def test_a_slow_recording_with_a_gap_is_sent_and_one_is_told(ros, tmp_path, motion):
    """20 Hz, one second missing."""
    folder = tmp_path / 'ride'
    folder.mkdir()
    for name, table in zip(('TotalAcceleration', 'Gyroscope'), motion, strict=True):
        rows = [
            f'{EPOCH_NS + 50_000_000 * i},{0.05 * i:.3f},{z!r},{y!r},{x!r}'
            for i, (x, y, z) in enumerate(table[:400].tolist())
            if not 200 <= i < 220
        ]
        text = '\n'.join(['time,seconds_elapsed,z,y,x', *rows, ''])
        (folder / f'{name}.csv').write_text(text, encoding='utf-8')
    node, received = replay(ros, str(folder))
    said = ' '.join(finding.what for finding in node.findings)
    assert '20 Hz is slow' in said
    assert '1 gaps' in said
    assert len(received) >= 378


def test_what_is_no_recording_is_refused(ros, tmp_path):
    (tmp_path / 'notes.txt').write_text('hello')
    with pytest.raises(DataError, match=r'parameter source: .*neither a ROS 2 bag'):
        ros.make(ImuPublisherNode, source=str(tmp_path))
    for name in ('none', 'none.mcap'):
        with pytest.raises(DataError, match=r'parameter source: .*no such.*Sensor Logger export'):
            ros.make(ImuPublisherNode, source=str(tmp_path / name))

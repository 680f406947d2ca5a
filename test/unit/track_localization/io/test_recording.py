"""One reader for bags and phone exports."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.estimation.trajectory import Trajectory
from track_localization.io.bags import BagWriter
from track_localization.io.recording import read_recording

G = 9.80665
N = 2000


def still(scale=1.0):
    noise = np.random.default_rng(1).normal(scale=0.01, size=(2, N, 3))
    return ImuSeries(np.arange(N) / 100.0, scale * (noise[0] + [0, 0, G]), noise[1])


def exported(folder, imu):
    folder.mkdir()
    for name, values in (
        ('TotalAcceleration', imu.specific_force),
        ('Gyroscope', imu.angular_rate),
    ):
        rows = [
            f'{round(t * 1e9)},{t},{z},{y},{x}\n'
            for t, (x, y, z) in zip(imu.time_s, values, strict=True)
        ]
        (folder / f'{name}.csv').write_text('time,seconds_elapsed,z,y,x\n' + ''.join(rows))
    return folder


def test_a_bag_with_truth_and_a_phone_without(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_imu('imu/data_raw', still())
        writer.write_odometry('ground_truth/odometry', Trajectory(np.arange(5.0), np.ones((5, 3))))
    found = read_recording(tmp_path / 'bag')
    assert (found.kind, len(found.imu), len(found.truth)) == ('bag', N, 5)
    assert found.findings == []
    assert found.rejected == {}
    imu = still()
    found = read_recording(exported(tmp_path / 'phone', imu))
    assert (found.kind, found.truth) == ('phone', None)
    np.testing.assert_allclose(found.imu.specific_force, imu.specific_force)
    np.testing.assert_allclose(found.imu.angular_rate, imu.angular_rate)
    assert found.findings == []


def test_a_bag_in_g_is_converted_with_a_note(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_imu('imu/data_raw', still(1.0 / G))
    found = read_recording(tmp_path / 'bag')
    np.testing.assert_allclose(found.imu.specific_force, still().specific_force)
    assert [finding.severity for finding in found.findings] == ['info']
    assert 'error' in [f.severity for f in read_recording(tmp_path / 'bag', units='si').findings]


@pytest.mark.parametrize('units', ['auto', 'g'])
def test_a_phone_in_g_is_told_as_a_bag_is(tmp_path, units):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_imu('imu/data_raw', still(1.0 / G))
    phone = exported(tmp_path / 'phone', still(1.0 / G))
    bag, found = (read_recording(p, units=units) for p in (tmp_path / 'bag', phone))
    np.testing.assert_allclose(found.imu.specific_force, still().specific_force)
    assert found.findings == bag.findings
    (finding,) = found.findings
    assert (finding.severity, finding.what) == ('info', 'specific force is in g')


def test_neither_of_the_two(tmp_path):
    with pytest.raises(DataError, match='neither a ROS 2 bag'):
        read_recording(tmp_path)
    for name in ('nothing', 'nothing.mcap'):
        with pytest.raises(DataError, match=r'no such file.*\.mcap.*Sensor Logger export'):
            read_recording(tmp_path / name)
    (tmp_path / 'notes.txt').write_text('hello')
    with pytest.raises(DataError, match=r'notes\.txt'):
        read_recording(tmp_path / 'notes.txt')

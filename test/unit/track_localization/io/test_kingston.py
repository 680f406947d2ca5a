"""Reading the Kingston drive: what it gives, and what it says of files that cannot be used."""

from __future__ import annotations

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.io.kingston import default_folder, read_drive

FILES = {
    'imu.csv': [
        'time_s,fx_mps2,fy_mps2,fz_mps2,wx_radps,wy_radps,wz_radps',
        '0,0.1,0.2,9.8,0.01,0.02,0.03',
        '0.1,0.4,0.5,9.9,0.04,0.05,0.06',
    ],
    'gnss.csv': [
        'time_s,latitude_deg,longitude_deg,altitude_m,sigma_north_m,sigma_east_m,sigma_up_m',
        '-0.5,45,-90,70,1.5,1.0,3.5',
        '0.5,45.1,-90.1,71,1.6,1.1,3.6',
    ],
    'odometer.csv': ['time_s,speed_mps', '-0.5,0', '0.5,2.5'],
    'reference.csv': [
        'time_s,latitude_deg,longitude_deg,altitude_m,v_east_mps,v_north_mps,v_up_mps,'
        'roll_deg,pitch_deg,azimuth_deg',
        '0,45,-90,36,1,2,3,0,0,350',
        '1,45,-90,36,1,2,3,0,0,10',
    ],
}


def write(folder, **changed):
    for name, lines in FILES.items():
        lines = changed.get(name.split('.')[0], lines)
        if lines is not None:
            (folder / name).write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return folder


def test_columns_units_and_axes(tmp_path):
    drive = read_drive(write(tmp_path))
    np.testing.assert_allclose(drive.imu.specific_force[1], [0.4, 0.5, 9.9])
    np.testing.assert_allclose(drive.imu.angular_rate[0], [0.01, 0.02, 0.03])
    np.testing.assert_allclose(drive.fixes.geodetic[0], [np.pi / 4.0, -np.pi / 2.0, 70.0])
    np.testing.assert_allclose(drive.fixes.sigma[0], [1.0, 1.5, 3.5])
    np.testing.assert_allclose(drive.speeds.speed, [0.0, 2.5])
    np.testing.assert_allclose(drive.reference.velocity[0], [1.0, 2.0, 3.0])


def test_a_sample_is_stamped_in_the_middle_of_its_mean(tmp_path):
    np.testing.assert_allclose(read_drive(write(tmp_path)).imu.time_s, [-0.05, 0.05])


def test_yaw_is_from_east_anticlockwise_and_passes_north_without_a_jump(tmp_path):
    """350 deg of azimuth is 100 deg from east; 20 deg to the right of it is 80."""
    yaw = np.degrees(read_drive(write(tmp_path)).reference.yaw)
    assert np.sin(np.radians(yaw[0])) == pytest.approx(np.sin(np.radians(100.0)))
    assert yaw[1] - yaw[0] == pytest.approx(-20.0)


def test_a_missing_folder_is_named_with_the_remedy(tmp_path):
    with pytest.raises(DataError, match='no such folder; set TRACK_LOCALIZATION_DATA'):
        read_drive(tmp_path / 'away')


@pytest.mark.parametrize('name', ['imu', 'gnss', 'odometer', 'reference'])
def test_a_missing_file_is_named(tmp_path, name):
    with pytest.raises(DataError, match=rf'{name}\.csv: cannot be read'):
        read_drive(write(tmp_path, **{name: None}))


@pytest.mark.parametrize(
    ('name', 'line', 'message'),
    [
        ('imu', '0.1,0.4,0.5,,0.04,0.05,0.06', r'imu\.csv.*fz_mps2'),
        ('imu', '0,0.4,0.5,9.9,0.04,0.05,0.06', r'imu\.csv: time_s does not increase at 0 s'),
        ('gnss', '0.5,45.1,-90.1,71,1.6,0,3.6', r'gnss\.csv: sigma_\*_m must be positive'),
        ('gnss', '0.5,4510,-90.1,71,1.6,1,3.6', r'gnss\.csv: latitude_deg is beyond 90'),
        ('odometer', '0.5,fast', r'odometer\.csv.*speed_mps'),
        ('reference', '1,45,-9000,36,1,2,3,0,0,10', r'reference\.csv: longitude_deg is beyond 360'),
    ],
)
def test_a_bad_cell_is_named_with_its_file(tmp_path, name, line, message):
    lines = [*FILES[f'{name}.csv'][:-1], line]
    with pytest.raises(DataError, match=message):
        read_drive(write(tmp_path, **{name: lines}))


def test_the_environment_says_where_it_is(monkeypatch, tmp_path):
    monkeypatch.setenv('TRACK_LOCALIZATION_DATA', str(tmp_path))
    assert default_folder() == tmp_path / 'kingston'
    monkeypatch.delenv('TRACK_LOCALIZATION_DATA')
    assert default_folder().parts[-3:] == ('shared', 'data', 'kingston')

"""Sensor Logger exports: each platform's signs and units, lying face up gives +9.81 on z."""

import zipfile

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.io.phone import is_phone_export, read_phone

G = 9.80665
EPOCH = 1_718_030_736_000_000_000
METADATA = (
    'version,device name,recording epoch time,recording time,recording timezone,platform,'
    'appVersion,device id,sensors,sampleRateMs,standardisation,platform version\n'
    '3,Phone,1718030736000,2024-06-10_14-45-36,Europe/London,{},1.30,abc,Accelerometer|Gravity,'
    '10|10,{},17\n'
)


def sensor_csv(time_s, values):
    """Return a sensor file as the app writes it: columns time, seconds_elapsed, z, y, x."""
    lines = ['time,seconds_elapsed,z,y,x']
    for t, (x, y, z) in zip(time_s, values, strict=True):
        lines.append(f'{EPOCH + round(t * 1e9)},{t},{z},{y},{x}')
    return '\n'.join(lines) + '\n'


def export(folder, platform=None, standardise='false', **sensors):
    """Write an export; each sensor is (stamps, values)."""
    folder.mkdir(exist_ok=True)
    for name, (time_s, values) in sensors.items():
        (folder / f'{name}.csv').write_text(sensor_csv(time_s, values))
    if platform is not None:
        (folder / 'Metadata.csv').write_text(METADATA.format(platform, standardise))
    return folder


TIME = np.arange(300) / 100.0
# The truth: face up at rest, pushed to its right with 1 m/s^2 from second 1 to 2, turning left.
PUSH = np.where((TIME >= 1.0) & (TIME < 2.0), 1.0, 0.0)
ZERO = np.zeros_like(TIME)
FORCE = np.stack([PUSH, ZERO, ZERO + G], axis=1)
LINEAR = np.stack([PUSH, ZERO, ZERO], axis=1)
UP = np.stack([ZERO, ZERO, ZERO + G], axis=1)
TURN = np.stack([ZERO, ZERO, ZERO + 0.5], axis=1)


def conventions():
    """Yield (name, platform in the metadata, standardisation, files) of each convention."""
    gyro = {'Gyroscope': (TIME, TURN)}
    yield 'android', 'false', {'TotalAcceleration': (TIME, FORCE), **gyro}
    yield 'android', 'true', {'TotalAcceleration': (TIME, FORCE), **gyro}
    both = {'Accelerometer': (TIME, LINEAR), 'Gravity': (TIME, UP), **gyro}
    yield 'android', 'false', both
    yield 'android', 'false', {**both, 'TotalAcceleration': (TIME, FORCE)}
    yield 'ios', 'true', both
    negative = {'Accelerometer': (TIME, -LINEAR), 'Gravity': (TIME, -UP), **gyro}
    yield 'ios', 'false', negative
    yield 'iOS', 'false', negative
    in_g = {'Accelerometer': (TIME, -LINEAR / G), 'Gravity': (TIME, -UP / G), **gyro}
    yield 'ios', 'false', in_g
    raw = {'GyroscopeUncalibrated': (TIME, TURN)}
    yield 'ios', 'false', {'AccelerometerUncalibrated': (TIME, -FORCE / G), **raw}
    yield 'ios', 'true', {'AccelerometerUncalibrated': (TIME, FORCE), **raw}
    yield 'android', 'false', {'AccelerometerUncalibrated': (TIME, FORCE), **raw}


@pytest.mark.parametrize(('platform', 'standardise', 'sensors'), list(conventions()))
def test_every_convention_gives_the_same_specific_force(tmp_path, platform, standardise, sensors):
    series, rejected, _ = read_phone(export(tmp_path / 'e', platform, standardise, **sensors))
    assert rejected == {}
    np.testing.assert_allclose(series.specific_force, FORCE, atol=1e-9)
    np.testing.assert_allclose(series.angular_rate, TURN, atol=1e-12)
    np.testing.assert_allclose(series.time_s - EPOCH / 1e9, TIME, atol=1e-6)


def test_the_platform_parameter_settles_what_metadata_does_not(tmp_path):
    folder = export(tmp_path / 'e', Accelerometer=(TIME, -LINEAR), Gravity=(TIME, -UP))
    with pytest.raises(DataError, match='set platform to ios or android'):
        read_phone(folder)
    series, *_ = read_phone(folder, platform='ios')
    np.testing.assert_allclose(series.specific_force, FORCE, atol=1e-9)
    assert not series.has_gyro
    (folder / 'Metadata.csv').write_text(METADATA.format('harmony', 'false'))
    with pytest.raises(DataError, match=r"'harmony'.*set platform"):
        read_phone(folder)
    with pytest.raises(DataError, match='platform'):
        read_phone(folder, platform='windows')


def test_total_acceleration_without_metadata_is_android(tmp_path):
    series, *_ = read_phone(export(tmp_path / 'e', TotalAcceleration=(TIME, FORCE)))
    np.testing.assert_allclose(series.specific_force, FORCE, atol=1e-9)


def test_the_units_parameter_settles_odd_lengths(tmp_path):
    folder = export(tmp_path / 'e', TotalAcceleration=(TIME, FORCE * 0.3))
    with pytest.raises(DataError, match='set units to si or g'):
        read_phone(folder)
    series, *_ = read_phone(folder, units='si')
    np.testing.assert_allclose(series.specific_force, FORCE * 0.3, atol=1e-9)


@pytest.mark.parametrize('inside', ['', '2024-06-10_14-45-36/'])
def test_zip(tmp_path, inside):
    folder = export(
        tmp_path / 'e', 'android', TotalAcceleration=(TIME, FORCE), Gyroscope=(TIME, TURN)
    )
    path = tmp_path / 'ride.zip'
    with zipfile.ZipFile(path, 'w') as archive:
        for file in folder.iterdir():
            archive.write(file, inside + file.name)
        archive.writestr('__MACOSX/._TotalAcceleration.csv', b'\x00\x05')
    series, *_ = read_phone(path)
    np.testing.assert_allclose(series.specific_force, FORCE, atol=1e-9)
    assert is_phone_export(path)
    with zipfile.ZipFile(path, 'a') as archive:
        archive.writestr('other/TotalAcceleration.csv', 'x')
    with pytest.raises(DataError, match='several recordings'):
        read_phone(path)


@pytest.mark.parametrize('gyro_hz', [60.0, 100.0, 470.0])
def test_gyro_on_other_stamps_keeps_the_angle(tmp_path, gyro_hz):
    """A turn of 2 Hz keeps its angle to 0.5 % whether the gyro is slower or much faster."""
    gyro_time = 0.0031 + np.arange(round(3.2 * gyro_hz)) / gyro_hz - 0.05
    rate = np.stack([np.sin(4 * np.pi * gyro_time)] * 3, axis=1)
    folder = export(
        tmp_path / 'e', 'android', TotalAcceleration=(TIME, FORCE), Gyroscope=(gyro_time, rate)
    )
    series, rejected, _ = read_phone(folder)
    assert rejected == {}
    t = series.time_s - EPOCH / 1e9
    quarter = t <= 0.25  # half a period of the sine: the angle is 1 / (2 pi)
    angle = np.trapezoid(series.angular_rate[quarter, 1], t[quarter])
    assert angle == pytest.approx(1 / (2 * np.pi), rel=0.012 if gyro_hz == 60 else 0.005)


def test_a_fast_gyro_is_averaged_not_aliased(tmp_path):
    """Vibration at the accelerometer's rate would alias to a constant; the mean removes it."""
    gyro_time = np.arange(-50, 1600) / 500.0
    rate = np.stack([0.3 + np.cos(200 * np.pi * gyro_time)] * 3, axis=1)
    folder = export(
        tmp_path / 'e', 'android', TotalAcceleration=(TIME, FORCE), Gyroscope=(gyro_time, rate)
    )
    series, *_ = read_phone(folder)
    np.testing.assert_allclose(series.angular_rate, 0.3, atol=0.02)


def test_nothing_is_extrapolated_or_drawn_across_holes(tmp_path):
    inside = (TIME > 0.5) & (TIME < 2.5) & ~((TIME > 1.2) & (TIME < 1.5))
    folder = export(
        tmp_path / 'e',
        'android',
        TotalAcceleration=(TIME, FORCE),
        Gyroscope=(TIME[inside], TURN[inside]),
    )
    series, rejected, _ = read_phone(folder)
    np.testing.assert_allclose(series.time_s - EPOCH / 1e9, TIME[inside], atol=1e-6)
    assert rejected == {'gyro_missing': 300 - inside.sum()}


def test_bad_rows_are_counted_and_column_order_does_not_matter(tmp_path):
    folder = export(tmp_path / 'e', 'android', TotalAcceleration=(TIME, FORCE))
    file = folder / 'TotalAcceleration.csv'
    lines = file.read_text().splitlines()
    lines[10] = lines[10].rsplit(',', 3)[0] + ',,0.0,0.0'
    lines[20] = lines[19]
    file.write_text('\n'.join(lines))
    series, rejected, _ = read_phone(folder)
    assert rejected == {'not_finite': 1, 'repeated_time': 1}
    assert len(series) == 298
    file.write_text('x,y,z,time\n' + ''.join(f'1,2,9.5,{EPOCH + k * 10**7}\n' for k in range(5)))
    series, *_ = read_phone(folder)
    np.testing.assert_array_equal(series.specific_force[0], [1.0, 2.0, 9.5])


def test_what_is_no_export(tmp_path):
    with pytest.raises(DataError, match='no such file'):
        read_phone(tmp_path / 'none.zip')
    with pytest.raises(DataError, match='no acceleration file'):
        read_phone(tmp_path)
    (tmp_path / 'x.zip').write_bytes(b'PK rubbish')
    with pytest.raises(DataError, match='zipped CSV'):
        read_phone(tmp_path / 'x.zip')
    assert not is_phone_export(tmp_path / 'x.zip')
    assert not is_phone_export(tmp_path)
    folder = export(tmp_path / 'e', 'ios', Accelerometer=(TIME, LINEAR))
    with pytest.raises(DataError, match=r'Gravity\.csv is missing'):
        read_phone(folder)
    (folder / 'Gravity.csv').write_text('time,seconds_elapsed,z,y\n1,2,3,4\n')
    with pytest.raises(DataError, match='no column x'):
        read_phone(folder)
    later = (TIME + 100.0, TURN)
    folder = export(tmp_path / 'f', 'android', TotalAcceleration=(TIME, FORCE), Gyroscope=later)
    with pytest.raises(DataError, match='shares no time'):
        read_phone(folder)

"""The nodes' parameter file as configuration."""

import argparse

import numpy as np
import pytest

from coaster_localization.config import CoasterConfig
from track_localization.cli.coaster.inputs import read_config, read_with_options
from track_localization.cli.parameters import config_text
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.io.bags import BagWriter

GOOD = """
/**:
  ros__parameters:
    use_sim_time: true
    design_ride: files/design_ride.csv
    mount_rpy_deg: [0.0, 0.0, 90.0]
/car1/srdtw_matcher:
  ros__parameters:
    matcher.channel: z
coaster_eskf:
  ros__parameters:
    publish_tf: false
    eskf: {n: 100.0, preset: paper}
imu_publisher:
  ros__parameters:
    source: somewhere.mcap
"""


def written(tmp_path, text):
    path = tmp_path / 'coaster.yaml'
    path.write_text(text)
    return path


def test_a_parameter_file_of_the_nodes_configures_evaluate(tmp_path):
    config, files = read_config(written(tmp_path, GOOD))
    assert config.matcher.channel == 'z'
    assert config.eskf.n == 100.0
    assert config.eskf.preset == 'paper'
    assert config.mount_rpy_deg == (0.0, 0.0, 90.0)
    assert config.eskf.lambda_x == CoasterConfig().eskf.lambda_x
    assert {role: str(path) for role, path in files.items()} == {
        'design_ride': 'files/design_ride.csv'
    }
    text = config_text(config)
    assert 'matcher.channel: z   (default multi)' in text
    assert 'eskf.lambda_x: 10.0 m^2\n' in text


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('coaster_eskf:\n  ros__parameters:\n    eskf.lambda: 3.0\n', ['eskf.lambda', 'yaml']),
        ('coaster_eskf:\n  ros__parameters:\n    eskf.n: -1.0\n', ['eskf.n', 'below']),
        ('srdtw_matcher:\n  channel: z\n', ['srdtw_matcher', 'ros__parameters']),
        (
            'srdtw_matcher:\n  ros__parameters: {mount_rpy_deg: [0, 0, 0]}\n'
            'coaster_eskf:\n  ros__parameters: {mount_rpy_deg: [0, 0, 9]}\n',
            ['mount_rpy_deg', 'same'],
        ),
        ('- a\n- b\n', ['yaml']),
    ],
)
def test_a_wrong_parameter_file_is_told(tmp_path, text, words):
    with pytest.raises(DataError) as error:
        read_config(written(tmp_path, text))
    assert all(word in str(error.value) for word in words)


def test_remedies_name_the_options_of_the_command_line(tmp_path, rng):
    """A bag in g is converted unless --units says otherwise; a phone's platform is --platform."""
    args = argparse.Namespace(platform='auto', units='auto')
    noise = rng.normal(scale=0.001, size=(2, 2000, 3))
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_imu(
            'imu/data_raw', ImuSeries(np.arange(2000) / 100.0, noise[0] + [0, 0, 1], noise[1])
        )
    (finding,) = read_with_options(tmp_path / 'bag', 'imu/data_raw', args).findings
    assert 'set --units to si' in finding.remedy
    args.units = 'si'
    found = read_with_options(tmp_path / 'bag', 'imu/data_raw', args).findings
    assert 'Set --units to g' in [finding.remedy for finding in found]
    phone = tmp_path / 'phone'
    phone.mkdir()
    for name in ('Accelerometer', 'Gravity'):
        (phone / f'{name}.csv').write_text('time,z,y,x\n1000000000,9.8,0,0\n1010000000,9.8,0,0\n')
    with pytest.raises(DataError, match='set --platform to ios or android'):
        read_with_options(phone, 'imu/data_raw', args)

"""The nodes' parameter file as configuration."""

import pytest

from coaster_localization.config import CoasterConfig
from track_localization.cli.coaster.inputs import read_config
from track_localization.cli.parameters import config_text
from track_localization.errors import DataError

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

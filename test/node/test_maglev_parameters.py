"""The maglev's node: its parameters and files, and what is said of those that cannot be used."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from rclpy.parameter import Parameter

from maglev_localization.config import MaglevConfig
from maglev_localization.nodes.federated_pf import MaglevFederatedPfNode
from track_localization.errors import DataError
from track_localization.settings import walk


class FakeFilter:
    """Keeps what it was made with."""

    def __init__(self, config, balises, line_length_m) -> None:
        self.config, self.balises, self.line_length_m = config, balises, line_length_m


@pytest.fixture
def fake(ros, maglev_files):
    def make(**parameters):
        given = {'balises': maglev_files['balises']} | parameters
        return ros.make(MaglevFederatedPfNode, FakeFilter, **given)

    return make


def test_every_setting_of_the_filter_is_a_parameter(fake):
    node = fake()
    for name, field, default in walk(MaglevConfig()):
        assert node.get_parameter(name).value == default
        assert field.metadata['doc'] in node.describe_parameter(name).description
    assert not node.has_parameter('frame_imu')


def test_settings_reach_the_filter(fake):
    node = fake(method='kalman', particles=250, loop__pitch_m=0.1, motion__start_known=False)
    config = node.filter.config
    assert isinstance(config, MaglevConfig)
    assert (config.method, config.particles) == ('kalman', 250)
    assert (config.loop.pitch_m, config.motion.start_known) == (0.1, False)
    assert node.filter.balises.id == ('a', 'b', 'c')
    assert node.filter.line_length_m == 0.0
    result = node.set_parameters([Parameter('particles', value=10)])[0]
    assert not result.successful
    assert 'read at start' in result.reason


@pytest.fixture
def broken(tmp_path, maglev_files) -> dict[str, str]:
    """Return paths of files that cannot be used."""
    text = Path(maglev_files['balises']).read_text(encoding='utf-8')
    (tmp_path / 'twice.csv').write_text(text + 'b,2700.0,0.05\n', encoding='utf-8')
    (tmp_path / 'far.csv').write_text(text + 'd,4700.0,0.05\n', encoding='utf-8')
    (tmp_path / 'empty.csv').write_text('', encoding='utf-8')
    return maglev_files | {
        name: str(tmp_path / f'{name}.csv') for name in ('twice', 'far', 'empty')
    }


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({}, r'parameter balises: not given; .*simulate maglev.* \(-p balises:=PATH\)'),
        ({'balises': '/none.csv'}, r'parameter balises: /none\.csv'),
        ({'balises': 'twice'}, r'parameter balises: .*twice\.csv: line 5: id b .*line 3'),
        ({'balises': 'empty'}, r'parameter balises: .*empty\.csv'),
        ({'balises': 'balises', 'track': '/none.csv'}, r'parameter track: /none\.csv'),
        ({'balises': 'balises', 'track': 'balises'}, r'parameter track: .*no header line'),
        ({'balises': 'far', 'track': 'track'}, r'parameter track: .*3000 m long, but balise d'),
        ({'particles': 0}, r'parameter particles: 0 is below'),
        ({'method': 'guess'}, "parameter method: 'guess' is not one of"),
        ({'loop__pitch_m': -1.0}, r'parameter loop\.pitch_m: -1\.0 m is below'),
        ({'predict_at_most_s': math.nan}, 'parameter predict_at_most_s: nan is not a finite'),
        ({'placing__across_sigma_m': 0}, r'parameter placing\.across_sigma_m: 0\.0 m is below'),
    ],
)
def test_bad_parameters_are_refused_in_one_line(ros, broken, parameters, said):
    parameters = {k: broken.get(v, v) for k, v in parameters.items()}
    with pytest.raises(DataError, match=said) as caught:
        ros.make(MaglevFederatedPfNode, FakeFilter, **parameters)
    assert '\n' not in str(caught.value)

"""Parameters declared from a dataclass: taken, converted, described, refused."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import pytest
import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from coaster_localization.nodes import inputs as coaster
from maglev_localization.nodes import inputs as maglev
from track_localization.errors import DataError
from track_localization.ros.params import declare_config, read_file, warn_unknown
from track_localization.settings import override, setting
from train_localization.nodes import inputs as train


@dataclasses.dataclass(frozen=True)
class Gate:
    nis: float = setting(9.0, 'm', 'gate of the innovation', 0.0, 100.0)
    kind: str = setting('soft', '', 'what it does', choices=('soft', 'hard'))


@dataclasses.dataclass(frozen=True)
class Config:
    gate: Gate = Gate()
    count: int = setting(3, '', 'how many', 1, 10)
    on: bool = setting(False, '', 'switch')
    mount: tuple[float, float, float] = setting((0.0, 0.0, 0.0), 'deg', 'mount', -180.0, 180.0)
    path: str = setting('', '', 'a file')


class ConfiguredNode(Node):
    def __init__(self, only=('',), **options):
        super().__init__(
            'configured', automatically_declare_parameters_from_overrides=True, **options
        )
        self.config = declare_config(self, Config(), only)


def test_defaults_are_the_dataclass_s(ros):
    node = ros.make(ConfiguredNode)
    assert node.config == Config()
    assert node.get_parameter('gate.nis').value == 9.0
    assert list(node.get_parameter('mount').value) == [0.0, 0.0, 0.0]


def test_values_given_are_taken_and_integers_stand_for_floats(ros):
    node = ros.make(ConfiguredNode, gate__nis=4, gate__kind='hard', mount=[1, 2, 3], on=True)
    assert node.config == Config(Gate(4.0, 'hard'), 3, True, (1.0, 2.0, 3.0))
    assert type(node.config.gate.nis) is float
    assert node.get_parameter('gate.nis').type_ == Parameter.Type.DOUBLE


def test_descriptors_tell_meaning_unit_and_range(ros):
    node = ros.make(ConfiguredNode)
    nis = node.describe_parameter('gate.nis')
    assert nis.description == 'gate of the innovation [m]'
    assert nis.type == ParameterType.PARAMETER_DOUBLE
    assert (nis.floating_point_range[0].from_value, nis.floating_point_range[0].to_value) == (
        0.0,
        100.0,
    )
    count = node.describe_parameter('count').integer_range[0]
    assert (count.from_value, count.to_value) == (1, 10)
    assert 'soft, hard' in node.describe_parameter('gate.kind').additional_constraints
    assert '-180.0 to 180.0 [deg]' in node.describe_parameter('mount').additional_constraints


@pytest.mark.parametrize(
    ('name', 'value', 'said'),
    [
        ('gate__nis', 101.0, r'parameter gate\.nis: 101\.0 m is above the most allowed, 100\.0 m'),
        ('gate__nis', -1, r'-1\.0 m is below the least allowed, 0\.0 m'),
        ('gate__nis', 'wide', r"parameter gate\.nis: 'wide' cannot stand for 9\.0"),
        ('gate__nis', float('nan'), 'not a finite number'),
        ('gate__kind', 'loud', "'loud' is not one of soft, hard"),
        ('count', 0, 'below the least allowed, 1'),
        ('count', 2.5, '2.5 cannot stand for 3'),
        ('on', 1, '1 cannot stand for False'),
        ('mount', [1.0, 2.0], 'cannot stand for'),
        ('mount', [0.0, 0.0, 200.0], r'200\.0 deg is above'),
        ('path', 12, 'cannot stand for'),
    ],
)
def test_bad_values_are_refused_in_one_line(ros, name, value, said):
    with pytest.raises(DataError, match=said) as caught:
        ros.make(ConfiguredNode, **{name: value})
    assert '\n' not in str(caught.value)


def test_changes_at_run_time_are_refused_with_a_reason(ros):
    node = ros.make(ConfiguredNode)
    result = node.set_parameters([Parameter('gate.nis', value=3.0)])[0]
    assert not result.successful
    assert 'gate.nis: read at start only' in result.reason
    assert node.get_parameter('gate.nis').value == 9.0
    others = node.set_parameters([Parameter('use_sim_time', value=True)])[0]
    assert others.successful


def test_only_some_settings_can_be_declared(ros):
    node = ros.make(ConfiguredNode, ('gate.', 'count'), count=5)
    assert node.config.count == 5
    assert node.has_parameter('gate.kind')
    assert not node.has_parameter('on')


def test_unknown_parameters_are_named(ros):
    node = ros.make(ConfiguredNode, ('gate.',), gate__nsi=3.0, on=True)
    assert warn_unknown(node, Config()) == ['gate.nsi']


def test_a_file_parameter_says_what_is_wrong(tmp_path):
    with pytest.raises(DataError, match='parameter track: not given; a track is needed'):
        read_file('', 'track', os.listdir, 'a track is needed')
    with pytest.raises(DataError, match=r'parameter track: .*none\.csv: No such file'):
        read_file(str(tmp_path / 'none.csv'), 'track', os.listdir, '')
    with pytest.raises(DataError, match=r'parameter track: .*Not a directory'):
        read_file(__file__, 'track', os.listdir, '')

    def refuse(path):
        raise DataError(f'{path}: column x missing')

    with pytest.raises(DataError, match=r'parameter track: a\.csv: column x missing'):
        read_file('a.csv', 'track', refuse, '')
    assert read_file('a.csv', 'track', str.upper, '') == 'A.CSV'


CONFIG = Path(__file__).parents[2] / 'config'
NODES = {
    'coaster': coaster.NodeConfig,
    'maglev': maglev.NodeConfig,
    'train': train.NodeConfig,
    'kingston': train.NodeConfig,
}
"""Whose parameters a shipped file holds, by its name."""


def from_file(ros, path):
    arguments = ['--ros-args', '--params-file', str(path)]
    node = ConfiguredNode(context=ros.context, cli_args=arguments)
    ros.keep(node)
    return node


def test_a_parameter_file_is_taken_with_nested_names(ros, tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    gate: {nis: 3, kind: hard}\n    mount: [1, 2, 3]\n'
    )
    assert from_file(ros, path).config == Config(Gate(3.0, 'hard'), mount=(1.0, 2.0, 3.0))


@pytest.mark.parametrize('path', sorted(CONFIG.glob('*.yaml')), ids=lambda p: p.name)
def test_shipped_parameter_files_name_settings_only(path):
    """Each name exists, and its value may stand there."""
    config = NODES[path.stem]()
    content = yaml.safe_load(path.read_text(encoding='utf-8'))
    assert content
    for section in content.values():
        override(config, section['ros__parameters'])

"""The arrows of ARCHITECTURE.md: who may import whom, walked over the source by ast."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SHARED = 'track_localization'
SYSTEMS = sorted(p.parent.name for p in ROOT.glob('*_localization/__init__.py'))
SYSTEMS.remove(SHARED)
EVERYONE = {'settings', 'errors', 'notation', 'garbage'}
LIBRARY = {'geodesy', 'estimation', 'track'}
ALLOWED = {
    'nodes': {'system', 'ros'},
    'cli': {'system', 'sim', 'evaluation', 'io'} | LIBRARY,
    'ros': {'io'} | LIBRARY,
    'system': LIBRARY,
    'sim': LIBRARY,
    'evaluation': LIBRARY,
    'io': LIBRARY,
    'track': {'estimation', 'geodesy'},
    'estimation': {'geodesy'},
    'geodesy': set(),
}
LOWEST = {'settings': {'errors'}, 'errors': set(), 'notation': set(), 'garbage': set()}
ROS_PACKAGES = {
    'rclpy',
    'ament_index_python',
    'builtin_interfaces',
    'diagnostic_msgs',
    'geometry_msgs',
    'nav_msgs',
    'rcl_interfaces',
    'rosgraph_msgs',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
    'tf2_msgs',
    'tf2_ros',
}


def part_of(module: str) -> str | None:
    """Return the part of the house that a module belongs to; None outside the house."""
    names = module.split('.')
    if names[0] in SYSTEMS:
        return 'nodes' if names[1:2] == ['nodes'] else 'system'
    if names[0] != SHARED:
        return None
    return names[1] if len(names) > 1 else 'notation'


def sources() -> list[Path]:
    return [p for package in (SHARED, *SYSTEMS) for p in sorted((ROOT / package).rglob('*.py'))]


def imports(source: str, module: str) -> Iterator[str]:
    """Yield every module that a source text imports, at any depth; relative ones resolved."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = module.rsplit('.', node.level)[0] if node.level else ''
            name = '.'.join(filter(None, (base, node.module)))
            if name in (SHARED, *SYSTEMS):
                whole = ROOT / name
                for alias in node.names:
                    inside = (whole / alias.name).is_dir() or (whole / f'{alias.name}.py').exists()
                    yield f'{name}.{alias.name}' if inside else name
            else:
                yield name


def another_system(name: str, module: str) -> bool:
    theirs, ours = name.split('.')[0], module.split('.')[0]
    return theirs in SYSTEMS and ours in SYSTEMS and theirs != ours


def violations(source: str, module: str) -> list[str]:
    """Return what a source text of this module imports against the arrows."""
    part = part_of(module)
    allowed = LOWEST[part] if part in LOWEST else EVERYONE | ALLOWED[part]
    allowed = allowed | {part}
    found = []
    for name in imports(source, module):
        other = part_of(name)
        if name.split('.')[0] in ROS_PACKAGES and part not in ('ros', 'nodes'):
            found.append(f'{module} ({part}) imports {name}: ROS belongs in ros/ and nodes/')
        elif other is not None and other not in allowed:
            found.append(f'{module} ({part}) imports {name} ({other})')
        elif another_system(name, module):
            found.append(f'{module} imports another system: {name}')
    return found


@pytest.mark.parametrize('path', sources(), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_follow_the_arrows(path):
    module = '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__')
    assert violations(path.read_text(encoding='utf-8'), module) == []


@pytest.mark.parametrize(
    ('module', 'source'),
    [
        ('track_localization.estimation.x', 'from track_localization.sim import coaster'),
        ('track_localization.estimation.x', 'from track_localization import evaluation'),
        ('track_localization.io.x', 'import rclpy.node'),
        ('track_localization.sim.x', 'def f():\n    from track_localization.io import bags'),
        ('coaster_localization.x', 'from track_localization.io import bags'),
        ('coaster_localization.x', 'from sensor_msgs.msg import Imu'),
        ('coaster_localization.nodes.x', 'from track_localization.sim.coaster import config'),
        ('track_localization.errors', 'from track_localization import settings'),
    ],
)
def test_the_walk_finds_what_it_should(module, source):
    assert len(violations(source, module)) == 1


@pytest.mark.parametrize(
    ('module', 'source'),
    [
        ('coaster_localization.nodes.x', 'import rclpy\nfrom track_localization.ros import qos'),
        ('track_localization.cli.x', 'from coaster_localization import methods'),
        ('track_localization.ros.x', 'from track_localization.io import bags'),
        ('coaster_localization.x', 'from track_localization import GRAVITY'),
    ],
)
def test_the_walk_lets_pass_what_it_should(module, source):
    assert violations(source, module) == []


def test_the_house_was_walked():
    """All parts were seen, so the walk did not look at an empty folder."""
    parts = {part_of('.'.join(p.relative_to(ROOT).with_suffix('').parts)) for p in sources()}
    assert {'nodes', 'ros', 'system', 'estimation', 'track', 'io', 'settings'} <= parts

"""The package builds with colcon, and its executables run from where ``ros2 run`` looks."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
SKIPPED = shutil.ignore_patterns(
    '.*', '__pycache__', '*.egg-info', 'build', 'install', 'log', 'out'
)


@pytest.fixture(scope='module')
def installed(tmp_path_factory) -> Path:
    """Return the install space of a colcon build of a copy of the repository."""
    if not (BIN / 'colcon').exists():
        pytest.skip('colcon is not installed')
    workspace = tmp_path_factory.mktemp('workspace')
    shutil.copytree(ROOT, workspace / 'src' / 'track_localization', ignore=SKIPPED)
    path = f'{BIN}{os.pathsep}{os.environ["PATH"]}'
    subprocess.run(
        [str(BIN / 'colcon'), 'build'],
        cwd=workspace,
        env=os.environ | {'PATH': path},
        check=True,
        capture_output=True,
        timeout=120,
    )
    return workspace / 'install' / 'track_localization'


def test_colcon_installs_executables_data_and_index(installed):
    names = {p.name for p in (installed / 'lib' / 'track_localization').iterdir()}
    expected = {'imu_publisher', 'sensor_publisher', 'srdtw_matcher', 'coaster_eskf', 'evaluate'}
    assert expected <= names
    share = installed / 'share'
    assert (share / 'track_localization' / 'package.xml').exists()
    assert (share / 'track_localization' / 'config' / 'coaster.yaml').exists()
    assert (share / 'ament_index/resource_index/packages/track_localization').exists()


def test_an_installed_executable_runs(installed):
    """After sourcing the workspace, from another folder, with the installed modules."""
    node = installed / 'lib' / 'track_localization' / 'imu_publisher'
    script = f'. {installed.parent}/setup.sh && exec {node} --help'
    done = subprocess.run(
        ['bash', '-c', script], cwd=installed, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith('imu_publisher: ')

"""TUM files: evo reads them; broken ones are told by line."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.io.tum import read_tum, write_tum

EVO = Path(sys.executable).with_name('evo_traj')


def trajectory(n=50):
    angle = np.linspace(0.0, np.pi, n)
    position = np.stack([10.0 * np.cos(angle), 10.0 * np.sin(angle), 0.0 * angle], axis=1)
    zero = np.zeros(n)
    quaternion = np.stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)], axis=1)
    return Trajectory(100.0 + np.arange(n) / 10.0, position, quaternion)


def test_poses_come_back_and_nan_is_left_out(tmp_path):
    original = trajectory()
    original.position[3] = np.nan
    write_tum(tmp_path / 't.tum', original)
    back = read_tum(tmp_path / 't.tum')
    keep = np.arange(50) != 3
    np.testing.assert_allclose(back.time_s, original.time_s[keep], atol=1e-9)
    np.testing.assert_allclose(back.position, original.position[keep], atol=1e-9)
    np.testing.assert_allclose(back.quaternion, original.quaternion[keep], atol=1e-9)


@pytest.mark.skipif(not EVO.exists(), reason='evo is not installed beside this Python')
@pytest.mark.parametrize('oriented', [True, False])
def test_evo_accepts_the_file(tmp_path, oriented):
    """Report the half circle's length and its number of poses."""
    original = trajectory()
    if not oriented:
        original = Trajectory(original.time_s, original.position)
    write_tum(tmp_path / 't.tum', original)
    run = subprocess.run(
        [str(EVO), 'tum', 't.tum', '--full_check'],
        cwd=tmp_path,
        env={'HOME': str(tmp_path), 'PATH': '/usr/bin:/bin', 'MPLBACKEND': 'Agg'},
        capture_output=True,
        text=True,
        timeout=60,
    )
    said = run.stdout + run.stderr
    assert run.returncode == 0, said
    assert 'nr. of poses\t50' in said
    assert 'path length (m)\t31.41' in said
    assert 'SE(3) conform\tyes' in said
    assert 'ERROR' not in said


@pytest.mark.parametrize('text', ['', '# only\n', '1 2 3\n', '1 2 3 4 0 0 0 nan\n', 'a b c\n'])
def test_broken_files(tmp_path, text):
    (tmp_path / 't.tum').write_text(text)
    with pytest.raises(DataError, match=r't\.tum'):
        read_tum(tmp_path / 't.tum')
    with pytest.raises(DataError, match='cannot be read'):
        read_tum(tmp_path / 'none.tum')

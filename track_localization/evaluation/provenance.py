"""Where a figure comes from: the code's commit, the machine, the files."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGE = 'track_localization'


def commit() -> str:
    """
    Return the commit of the code that runs, with ``-dirty`` where files differ from it.

    Outside a repository that tracks this file: the package's version.
    """
    here = Path(__file__).resolve()
    if _git(here.parent, 'ls-files', '--error-unmatch', here.name) is not None:
        head = _git(here.parent, 'rev-parse', 'HEAD')
        changes = _git(here.parent, 'status', '--porcelain', '--untracked-files=no')
        if head:
            return head + ('-dirty' if changes else '')
    try:
        return f'version {version(PACKAGE)}'
    except PackageNotFoundError:
        return 'unknown'


def machine() -> dict[str, str]:
    """Return what the run times depend on: processors, system, Python, numerical libraries."""
    facts = {
        'processors': str(os.cpu_count()),
        'system': f'{platform.system()} {platform.machine()}',
        'Python': platform.python_version(),
    }
    for name in ('numpy', 'scipy', 'numba', 'rosbags'):
        try:
            facts[name] = version(name)
        except PackageNotFoundError:
            continue
    return facts


def fingerprint(paths: Iterable[Path], *extra: str) -> str:
    """Return a short hash of the Python files under ``paths`` and of the ``extra`` texts."""
    digest = hashlib.sha256()
    for root in paths:
        for path in sorted(root.rglob('*.py') if root.is_dir() else [root]):
            digest.update(path.name.encode() + path.read_bytes())
    for text in extra:
        digest.update(text.encode())
    return digest.hexdigest()[:16]


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ['git', '-C', str(folder), *arguments], capture_output=True, text=True, timeout=10.0
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None

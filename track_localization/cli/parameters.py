"""Parameter files of the nodes, read as settings by a command line."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, TypeVar

from track_localization.errors import DataError
from track_localization.settings import load_yaml, override, walk

T = TypeVar('T')

OF_NODES_ONLY = frozenset({'frame_map', 'frame_base', 'frame_imu', 'publish_tf', 'use_sim_time'})
"""Parameters that mean nothing to a command line."""


def read_parameters(
    path: Path,
    default: T,
    nodes: Collection[str],
    roles: Collection[str],
    skipped: tuple[str, ...] = (),
) -> tuple[T, dict[str, Path]]:
    """
    Read a ROS parameter file: the settings of some nodes, and the files that it names.

    Sections are ``/**`` and those of ``nodes``, in any namespace, each with ``ros__parameters``;
    the sections of other nodes are skipped. ``roles`` are the parameters that name files,
    ``skipped`` the beginnings of further names that are the nodes' alone. Raise DataError for an
    unknown name, or two nodes that disagree.
    """
    values: dict[str, Any] = {}
    for section, body in load_yaml(path).items():
        node = str(section).rsplit('/', 1)[-1]
        if node not in (*nodes, '**', '*'):
            continue
        if not isinstance(body, dict) or not isinstance(body.get('ros__parameters'), dict):
            raise DataError(f'{path}: section {section} has no ros__parameters')
        for name, value in _flat(body['ros__parameters']).items():
            if values.get(name, value) != value:
                raise DataError(
                    f'{path}: {name} is {values[name]} for one node and {value} for the other; '
                    'give both the same'
                )
            values[name] = value
    named: dict[str, Path] = {}
    for role in roles:
        if value := values.pop(role, None):
            named[role] = Path(str(value))
    settings = {
        name: value
        for name, value in values.items()
        if name not in OF_NODES_ONLY and not name.startswith(skipped)
    }
    try:
        return override(default, settings), named
    except DataError as error:
        raise DataError(f'{path}: {error}') from None


def config_text(config: Any) -> str:
    """Return every setting as ``name: value unit``, those that differ from the default marked."""
    lines = []
    for (name, field, value), (_, _, default) in zip(
        walk(config), walk(type(config)()), strict=True
    ):
        unit = f' {field.metadata["unit"]}' if field.metadata.get('unit') else ''
        mark = f'   (default {default})' if value != default else ''
        lines.append(f'{name}: {value}{unit}{mark}')
    return '\n'.join(lines)


def _flat(content: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, dict):
            flat |= _flat(value, f'{prefix}{name}.')
        else:
            flat[f'{prefix}{name}'] = value
    return flat

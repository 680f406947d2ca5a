"""Node parameters declared from a settings dataclass, read once at start."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from track_localization.errors import DataError
from track_localization.settings import begins, override, setting, walk

T = TypeVar('T')

ROS_OWN = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


@dataclasses.dataclass(frozen=True)
class FrameConfig:
    """Coordinate frames by name, alike in every estimator node."""

    frame_map: str = setting('map', '', 'frame of the track file and of every position')
    frame_base: str = setting('base_link', '', 'frame of the vehicle: row-1 seat, x forward')
    frame_imu: str = setting('imu_link', '', 'frame that IMU messages must name')
    publish_tf: bool = setting(False, '', 'broadcast frame_map -> frame_base (needs tf2_ros)')


def declare_config(node: Node, config: T, only: tuple[str, ...] = ('',)) -> T:
    """
    Declare settings of ``config`` as parameters of ``node``; return it with the values given.

    A setting ``a.b`` of a nested dataclass becomes the parameter ``a.b`` with the setting's
    description, unit, range and choices in its descriptor; ``only`` are the beginnings of the
    names to declare. An integer may stand for a float. Raise DataError that names the parameter,
    the value and what is allowed. Changes at run time are refused with a reason: the values are
    read here, once.
    """
    names = []
    for name, field, default in walk(config):
        if begins(name, only):
            config = _declare(node, config, name, field, default)
            names.append(name)

    def refuse(parameters: list[Parameter]) -> SetParametersResult:
        mine = [p.name for p in parameters if p.name in names]
        reason = f'{", ".join(mine)}: read at start only; restart the node with the new value'
        return SetParametersResult(successful=not mine, reason=reason if mine else '')

    node.add_on_set_parameters_callback(refuse)
    return config


def _declare(node: Node, config: T, name: str, field: dataclasses.Field[Any], default: Any) -> T:
    """Declare one setting: first untyped to see what was given, then with its own type."""
    try:
        if not node.has_parameter(name):
            any_type = ParameterDescriptor(dynamic_typing=True)
            node.declare_parameter(name, _to_ros(default), any_type)
        given = _from_ros(node.get_parameter(name).value)
        if given != default or type(given) is not type(default):
            config = override(config, {name: given})
            default = {n: v for n, _, v in walk(config)}[name]
        node.undeclare_parameter(name)
        node.declare_parameter(name, _to_ros(default), _descriptor(field, default), True)
    except DataError as error:
        raise DataError(f'parameter {str(error).removeprefix("setting ")}') from None
    except ParameterException as error:
        raise DataError(f'parameter {name}: {error}') from None
    return config


def warn_unknown(node: Node, known: Any) -> list[str]:
    """
    Log and return the parameters given to ``node`` that it has no use for.

    Needs a node made with ``automatically_declare_parameters_from_overrides``. ``known`` is a
    config whose names pass silently, since one parameter file serves several nodes. Call it after
    the last ``declare_config``: what is left undescribed then was declared by nobody.
    """
    expected = {name for name, _, _ in walk(known)}
    unknown = []
    for name in sorted(node.get_parameters_by_prefix('')):
        described = node.describe_parameter(name).description
        if not (described or name in expected or name.startswith(ROS_OWN)):
            unknown.append(name)
            node.get_logger().warning(f'parameter {name} is not known here and has no effect')
    return unknown


def read_file(path: str, name: str, read: Callable[[str], T], what: str) -> T:
    """
    Return ``read(path)`` for the file parameter ``name``.

    Raise DataError when no path was given, the file is missing, or ``read`` refuses it.
    """
    if not path:
        raise DataError(f'parameter {name}: not given; {what} (-p {name}:=PATH)')
    try:
        return read(path)
    except DataError as error:
        raise DataError(f'parameter {name}: {error}') from None
    except OSError as error:
        raise DataError(f'parameter {name}: {path}: {error.strerror or error}') from None


def _to_ros(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _from_ros(value: Any) -> Any:
    """Return tuples for arrays: rclpy gives lists, array.array or tuples, as it likes."""
    return value if value is None or isinstance(value, str | bool | int | float) else tuple(value)


def _descriptor(field: dataclasses.Field[Any], value: Any) -> ParameterDescriptor:
    meta = field.metadata
    unit = f' [{meta["unit"]}]' if meta.get('unit') else ''
    described = ParameterDescriptor(description=f'{meta.get("doc", field.name)}{unit}')
    if meta.get('choices'):
        described.additional_constraints = f'one of: {", ".join(meta["choices"])}'
    low, high = meta.get('low'), meta.get('high')
    if low is None and high is None:
        return described
    bounds = f'{"-inf" if low is None else low} to {"inf" if high is None else high}{unit}'
    described.additional_constraints = bounds
    if isinstance(value, int) and not isinstance(value, bool):
        low, high = int(low if low is not None else -(2**63)), int(high or 2**63 - 1)
        described.integer_range = [IntegerRange(from_value=low, to_value=high, step=0)]
    elif isinstance(value, float):
        low, high = float('-inf') if low is None else low, float('inf') if high is None else high
        described.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
        ]
    return described

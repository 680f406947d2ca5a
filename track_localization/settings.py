"""
Settings: frozen dataclasses whose fields carry unit, range and meaning.

A system's dataclass is the only home of its defaults. Node parameters, YAML files, ``--set`` on a
command line and the documentation are all derived from it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from track_localization.errors import DataError

T = TypeVar('T')


def setting(
    default: Any,
    unit: str,
    doc: str,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """
    Declare a dataclass field with its unit, meaning and inclusive range.

    ``unit`` is '' where the field has none; ``low`` and ``high`` bound every element of a tuple.
    """
    return dataclasses.field(
        default=default,
        metadata={'unit': unit, 'doc': doc, 'low': low, 'high': high, 'choices': choices},
    )


def walk(config: Any, prefix: str = '') -> Iterator[tuple[str, dataclasses.Field[Any], Any]]:
    """Yield (dotted name, field, value) of each setting, nested dataclasses included."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        name = prefix + field.name
        if dataclasses.is_dataclass(value):
            yield from walk(value, name + '.')
        else:
            yield name, field, value


def begins(name: str, only: tuple[str, ...]) -> bool:
    """
    Return whether a setting's name is one of ``only``, lies in one of them, or begins so.

    Beginnings end in ``.`` or ``_``, or are empty: ``track`` means no ``track_filter.lag_s``.
    """
    return any(
        name == part or name.startswith(part if part[-1:] in ('', '.', '_') else f'{part}.')
        for part in only
    )


def validate(config: T) -> T:
    """Return ``config`` itself, or raise DataError naming the first setting out of its range."""
    for name, field, value in walk(config):
        problem = check_value(field, value)
        if problem:
            raise DataError(f'setting {name}: {problem}')
    return config


def check_value(field: dataclasses.Field[Any], value: Any) -> str | None:
    """Return why ``value`` may not stand in ``field``, or None when it may."""
    meta = field.metadata
    unit = f' {meta["unit"]}' if meta.get('unit') else ''
    choices = meta.get('choices')
    if choices and value not in choices:
        return f'{value!r} is not one of {", ".join(choices)}'
    for element in value if isinstance(value, tuple) else (value,):
        if isinstance(element, bool) or not isinstance(element, int | float):
            continue
        if not math.isfinite(element):
            return f'{element} is not a finite number'
        low, high = meta.get('low'), meta.get('high')
        if low is not None and element < low:
            return f'{element}{unit} is below the least allowed, {low}{unit}'
        if high is not None and element > high:
            return f'{element}{unit} is above the most allowed, {high}{unit}'
    return None


def override(config: T, values: Mapping[str, Any]) -> T:
    """
    Return a copy of ``config`` with dotted names replaced, converted to each field's type.

    Raise DataError for an unknown name, a value of the wrong type or one out of range.
    """
    for name, value in values.items():
        config = _replace(config, name.split('.'), value, name)
    return validate(config)


def load_yaml(path: str | Path) -> dict[str, Any]:
    """Return a YAML file's mapping; raise DataError when it is missing or not a mapping."""
    path = Path(path)
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except FileNotFoundError:
        raise DataError(f'{path}: no such file') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(f'{path}: not YAML ({error}); see config/ for examples') from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise DataError(f'{path}: expected "name: value" lines, found {type(content).__name__}')
    return content


def _replace(config: Any, parts: list[str], value: Any, name: str) -> Any:
    fields = {f.name: f for f in dataclasses.fields(config)}
    if parts[0] not in fields:
        known = ', '.join(n for n, _, _ in walk(config))
        raise DataError(f'unknown setting {name!r}; known here: {known}')
    current = getattr(config, parts[0])
    if len(parts) > 1:
        if not dataclasses.is_dataclass(current):
            raise DataError(f'unknown setting {name!r}: {parts[0]} has no parts')
        new = _replace(current, parts[1:], value, name)
    else:
        new = _convert(current, value, name)
    return dataclasses.replace(config, **{parts[0]: new})


def _convert(current: Any, value: Any, name: str) -> Any:
    """Convert ``value`` (possibly text) to the type of ``current``."""
    if isinstance(value, str) and not isinstance(current, str):
        value = yaml.safe_load(value)
    problem = DataError(f'setting {name}: {value!r} cannot stand for {current!r}')
    if isinstance(current, bool):
        if not isinstance(value, bool):
            raise problem
        return value
    if isinstance(current, int | float):
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise problem
        try:
            number = float(value)
        except ValueError:
            raise problem from None
        if isinstance(current, int):
            if not number.is_integer():
                raise problem
            return int(number)
        return number
    if isinstance(current, tuple):
        if not isinstance(value, list | tuple) or (current and len(value) != len(current)):
            raise problem
        return tuple(_convert(c, v, name) for c, v in zip(current, value, strict=True))
    if isinstance(current, str):
        if not isinstance(value, str):
            raise problem
        return value
    raise problem

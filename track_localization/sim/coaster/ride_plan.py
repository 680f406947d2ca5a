"""The ride plan: the train, and what drives, lifts, brakes and stops it where."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from track_localization.errors import DataError
from track_localization.settings import load_yaml, override, setting, validate

KINDS = ('tyres', 'chain', 'launch', 'trim', 'brake', 'block', 'station')
ENDS = ('stop', 'at', 'reversal')

_NOTE = """\
# Chainages are those of row 1 along the track file and go on counting over laps. Zones pull the
# train towards speed_mps with at most accel_mps2 and brake towards it with at most brake_mps2.
# kind: tyres, chain, launch, trim, brake, block, station (stops row 1 at stop_m).
"""


@dataclasses.dataclass(frozen=True)
class Train:
    """The train and where row 1 sits in it."""

    cars: int = setting(6, '', 'number of cars', 1, 40)
    car_length_m: float = setting(2.4, 'm', 'spacing of the cars', 0.5, 30.0)
    mass_kg: float = setting(6500.0, 'kg', 'train with guests', 100.0, 1e5)
    friction: float = setting(0.011, '', 'rolling resistance over wheel load', 0.0, 0.1)
    drag_area_m2: float = setting(3.2, 'm^2', 'drag coefficient times frontal area', 0.0, 50.0)
    front_m: float = setting(1.2, 'm', 'from row 1 to the front of the train', 0.0, 10.0)
    wheelbase_m: float = setting(1.6, 'm', 'between the bogies of car 1, row 1 midway', 0.2, 20.0)
    seat_height_m: float = setting(0.9, 'm', 'row-1 seat above the rail centre', -3.0, 3.0)

    @property
    def length_m(self) -> float:
        """Length of the train [m]."""
        return self.cars * self.car_length_m


@dataclasses.dataclass(frozen=True)
class Zone:
    """
    A stretch that acts on the train, on the more of it the more of the train is inside.

    A zone pulls towards ``speed_mps`` with at most ``accel_mps2`` and brakes towards it with at
    most ``brake_mps2`` (both with the train fully inside). A chain grips the train's middle; a
    station also stops row 1 at ``stop_m``. Chainages are row 1's and go on counting over laps.
    """

    kind: str = setting('brake', '', 'what it is', choices=KINDS)
    start_m: float = setting(0.0, 'm', 'chainage where it begins')
    end_m: float = setting(0.0, 'm', 'chainage where it ends')
    speed_mps: float = setting(0.0, 'm/s', 'speed it aims at', 0.0, 100.0)
    accel_mps2: float = setting(0.0, 'm/s^2', 'greatest drive', 0.0, 50.0)
    brake_mps2: float = setting(0.0, 'm/s^2', 'greatest braking', 0.0, 50.0)
    stop_m: float = setting(0.0, 'm', 'where a station stops row 1')
    phase: int = setting(-1, '', 'acts in this phase only; -1 in all', -1, 20)


@dataclasses.dataclass(frozen=True)
class Phase:
    """
    A part of the ride: it ends with a stop in a station, on reaching ``at_m`` (the train is then
    held there) or where gravity turns the train round.
    """

    direction: int = setting(1, '', '+1 along the chainage, -1 against it', -1, 1)
    ends: str = setting('stop', '', 'what ends it', choices=ENDS)
    at_m: float = setting(0.0, 'm', 'where row 1 is caught, if it ends so')
    hold_s: float = setting(0.0, 's', 'standstill after it', 0.0, 600.0)


@dataclasses.dataclass(frozen=True)
class RidePlan:
    """
    How a train runs on a track.

    ``line_height_m`` is the height of the track file's line over the rail centre: 0 for rail
    centre, about 1.1 for a heart line. The last four fields say how rough this track is.
    """

    train: Train = Train()
    start_m: float = setting(0.0, 'm', 'chainage of row 1 at dispatch')
    line_height_m: float = setting(0.0, 'm', "the file's line above the rail centre", -3.0, 3.0)
    vibration_mps2: float = setting(1.5, 'm/s^2', 'rms per axis at 20 m/s', 0.0, 50.0)
    gyro_vibration_radps: float = setting(0.03, 'rad/s', 'rms per axis at 20 m/s', 0.0, 5.0)
    cross_track_m: float = setting(0.012, 'm', 'rms of the built track about the design', 0.0, 1.0)
    joint_spacing_m: float = setting(8.0, 'm', 'between rail joints', 1.0, 50.0)
    zones: tuple[Zone, ...] = ()
    phases: tuple[Phase, ...] = (Phase(),)

    def with_block_stop(self, hold_s: float) -> RidePlan:
        """
        Return the plan with a stop in the first block zone; it then drives the train out.

        Raise DataError when the plan has no block.
        """
        blocks = [i for i, z in enumerate(self.zones) if z.kind == 'block']
        if not blocks:
            raise DataError('ride plan: it has no zone of kind "block" to stop in')
        i = blocks[0]
        block = self.zones[i]
        stop = dataclasses.replace(block, kind='station', stop_m=block.end_m - 1.0, phase=0)
        later = [dataclasses.replace(z, phase=_after_stop(z, block)) for z in self.zones]
        return dataclasses.replace(
            self,
            zones=(*later, stop),
            phases=(Phase(1, 'stop', hold_s=hold_s), *self.phases),
        )


def _after_stop(zone: Zone, block: Zone) -> int:
    """Return the phase of a zone once a stop in ``block`` comes first: what lies beyond waits."""
    if zone.phase >= 0:
        return zone.phase + 1
    return 1 if zone.start_m >= block.start_m else -1


def read_plan(path: str | Path) -> RidePlan:
    """Read a ride plan from YAML; raise DataError naming the file and the field."""
    content = load_yaml(path)
    try:
        return plan_from(content)
    except DataError as error:
        raise DataError(f'{path}: {error}') from None


def plan_from(content: Mapping[str, Any]) -> RidePlan:
    """Build a plan from a mapping as in ``config/tracks/*.yaml``; raise DataError."""
    plain = {k: v for k, v in content.items() if k not in ('train', 'zones', 'phases')}
    train = {f'train.{k}': v for k, v in _mapping(content.get('train') or {}, 'train').items()}
    plan = override(RidePlan(), {**plain, **train})
    zones = tuple(
        _entry(Zone(), entry, f'zones[{i}]') for i, entry in enumerate(_list(content, 'zones'))
    )
    if not zones:
        raise DataError('zones: none given; a train needs a chain, a launch or tyres to move it')
    for i, zone in enumerate(zones):
        if zone.end_m <= zone.start_m:
            raise DataError(f'zones[{i}] ({zone.kind}): end_m must lie beyond start_m')
    phases = tuple(
        _entry(Phase(), entry, f'phases[{i}]') for i, entry in enumerate(_list(content, 'phases'))
    )
    return dataclasses.replace(plan, zones=zones, phases=phases or (Phase(),))


def write_plan(path: str | Path, plan: RidePlan, title: str) -> None:
    """Write a ride plan as YAML that ``read_plan`` reads back."""
    validate(plan)
    content: dict[str, Any] = {}
    for field in dataclasses.fields(plan):
        value = getattr(plan, field.name)
        if field.name == 'train':
            content['train'] = dataclasses.asdict(value)
        elif field.name in ('zones', 'phases'):
            content[field.name] = [_differences(entry) for entry in value]
        else:
            content[field.name] = value
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100)
    Path(path).write_text(f'# {title}\n{_NOTE}{text}', encoding='utf-8')


def _differences(entry: Any) -> dict[str, Any]:
    """Return the fields that differ from their defaults; the first one always."""
    fields = dataclasses.fields(entry)
    return {
        f.name: getattr(entry, f.name)
        for i, f in enumerate(fields)
        if i == 0 or getattr(entry, f.name) != f.default
    }


def _entry(default: Any, values: Any, where: str) -> Any:
    try:
        return override(default, _mapping(values, where))
    except DataError as error:
        raise DataError(f'{where}: {error}') from None


def _mapping(values: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(values, Mapping):
        raise DataError(f'{where}: expected "name: value" lines, found {values!r}')
    return values


def _list(content: Mapping[str, Any], name: str) -> list[Any]:
    values = content.get(name) or []
    if not isinstance(values, list):
        raise DataError(f'{name}: expected a list, found {values!r}')
    return values

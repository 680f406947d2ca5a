"""Settings: what they take, what they refuse, and what they say about it."""

from __future__ import annotations

import dataclasses

import pytest

from track_localization.errors import DataError
from track_localization.settings import begins, load_yaml, override, setting, validate, walk


@dataclasses.dataclass(frozen=True)
class Inner:
    gate: float = setting(9.0, '', 'gate', 0.0, 100.0)
    kind: str = setting('a', '', 'kind', choices=('a', 'b'))


@dataclasses.dataclass(frozen=True)
class Outer:
    inner: Inner = Inner()
    count: int = setting(3, '', 'count', 1, 10)
    on: bool = setting(False, '', 'switch')
    mount: tuple[float, float, float] = setting((0.0, 0.0, 0.0), 'deg', 'mount', -180.0, 180.0)
    path: str = setting('', '', 'file')


def test_walk_yields_dotted_names_in_order():
    names = [name for name, _, _ in walk(Outer())]
    assert names == ['inner.gate', 'inner.kind', 'count', 'on', 'mount', 'path']


@pytest.mark.parametrize(
    ('name', 'given', 'expected'),
    [
        ('inner.gate', 2, 2.0),
        ('inner.gate', '2.5', 2.5),
        ('count', 4.0, 4),
        ('count', '4', 4),
        ('on', True, True),
        ('on', 'true', True),
        ('mount', [1, 2, 3.5], (1.0, 2.0, 3.5)),
        ('mount', '[1, 2, 3]', (1.0, 2.0, 3.0)),
        ('path', 'ride.csv', 'ride.csv'),
        ('inner.kind', 'b', 'b'),
    ],
)
def test_override_converts(name, given, expected):
    value = {n: v for n, _, v in walk(override(Outer(), {name: given}))}[name]
    assert value == expected
    assert type(value) is type(expected)


def test_override_leaves_the_rest_and_the_original_alone():
    before = Outer()
    after = override(before, {'inner.gate': 1.0})
    assert before == Outer()
    assert dataclasses.replace(after, inner=Inner()) == before


@pytest.mark.parametrize(
    ('name', 'given', 'said'),
    [
        ('inner.gate', 100.1, 'above the most allowed, 100.0'),
        ('inner.gate', -0.1, 'below the least allowed, 0.0'),
        ('inner.gate', float('nan'), 'not a finite number'),
        ('inner.gate', float('inf'), 'not a finite number'),
        ('inner.gate', 'wide', 'cannot stand for'),
        ('inner.gate', True, 'cannot stand for'),
        ('inner.kind', 'c', 'not one of a, b'),
        ('count', 2.5, 'cannot stand for'),
        ('count', 0, 'below the least allowed, 1'),
        ('on', 1, 'cannot stand for'),
        ('on', 'maybe', 'cannot stand for'),
        ('mount', [1.0, 2.0], 'cannot stand for'),
        ('mount', [1.0, 2.0, 181.0], '181.0 deg is above'),
        ('path', 3, 'cannot stand for'),
        ('inner', 3, 'cannot stand for'),
        ('gate', 1.0, 'known here: inner.gate'),
        ('count.more', 1, 'has no parts'),
    ],
)
def test_override_refuses_with_a_reason(name, given, said):
    with pytest.raises(DataError, match=said) as caught:
        override(Outer(), {name: given})
    assert name in str(caught.value)


def test_bounds_themselves_are_allowed():
    assert override(Outer(), {'inner.gate': 0.0}).inner.gate == 0.0
    assert override(Outer(), {'inner.gate': 100}).inner.gate == 100.0


def test_validate_finds_a_default_out_of_range():
    with pytest.raises(DataError, match=r'inner\.gate'):
        validate(Outer(inner=Inner(gate=1e9)))


def test_yaml_is_read_and_bad_files_are_named(tmp_path):
    good = tmp_path / 'good.yaml'
    good.write_text('inner.gate: 4\nmount: [0, 0, 90]\n', encoding='utf-8')
    config = override(Outer(), load_yaml(good))
    assert config.inner.gate == 4.0
    assert config.mount == (0.0, 0.0, 90.0)
    empty, listed, broken = tmp_path / 'e.yaml', tmp_path / 'l.yaml', tmp_path / 'b.yaml'
    empty.write_text('', encoding='utf-8')
    assert load_yaml(empty) == {}
    listed.write_text('- 1\n', encoding='utf-8')
    broken.write_text('a: [', encoding='utf-8')
    for path in (listed, broken, tmp_path / 'none.yaml'):
        with pytest.raises(DataError, match=path.name):
            load_yaml(path)


@pytest.mark.parametrize(
    ('name', 'only', 'expected'),
    [
        ('track', ('track',), True),
        ('track_filter.lag_s', ('track',), False),
        ('track.file', ('track',), True),
        ('frame_map', ('frame_',), True),
        ('gate.nis', ('gate.',), True),
        ('gate', ('gates',), False),
        ('anything', ('',), True),
    ],
)
def test_names_of_settings_are_chosen_by_their_beginnings(name, only, expected):
    assert begins(name, only) == expected

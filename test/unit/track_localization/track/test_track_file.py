"""Track files: the layout, real-world variants, and what is said of bad ones."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.track.track_file import COLUMNS, TrackFile, read_track, write_track


@pytest.fixture
def helix() -> TrackFile:
    """Return a climbing left-hand helix with exact axes."""
    t = np.linspace(0.0, 3.0, 60)
    position = np.stack([20.0 * np.cos(t), 20.0 * np.sin(t), 2.0 * t], axis=1)
    front = np.stack([-20.0 * np.sin(t), 20.0 * np.cos(t), np.full(60, 2.0)], axis=1)
    front /= np.linalg.norm(front, axis=1, keepdims=True)
    left = np.stack([-np.cos(t), -np.sin(t), np.zeros(60)], axis=1)
    return TrackFile(position, front, left, np.cross(front, left))


def text_of(track: TrackFile, tmp_path, delimiter: str = ',') -> list[str]:
    write_track(tmp_path / 'plain.csv', track, delimiter)
    return (tmp_path / 'plain.csv').read_text().splitlines()


@pytest.mark.parametrize('delimiter', [',', '\t'])
def test_round_trip(helix, tmp_path, delimiter):
    """What is written is read back to the last digit written."""
    write_track(tmp_path / 'track.csv', helix, delimiter)
    back = read_track(tmp_path / 'track.csv')
    for name in ('position', 'front', 'left', 'up'):
        np.testing.assert_allclose(getattr(back, name), getattr(helix, name), atol=3e-9)


def test_layout_is_the_editors(helix, tmp_path):
    """The header is NoLimits 2's; the file is Y-up: map x = PosX, y = -PosZ, z = PosY."""
    lines = text_of(helix, tmp_path)
    assert lines[0] == 'No.,PosX,PosY,PosZ,FrontX,FrontY,FrontZ,LeftX,LeftY,LeftZ,UpX,UpY,UpZ'
    row = [float(cell) for cell in lines[6].split(',')]
    x, y, z = helix.position[5]
    assert row[0] == 6
    np.testing.assert_allclose(row[1:4], [x, z, -y], atol=1e-9)
    fx, fy, fz = helix.front[5]
    np.testing.assert_allclose(row[4:7], [fx, fz, -fy], atol=1e-9)


def _decimal_commas(lines: list[str]) -> str:
    return '\n'.join(line.replace(',', ';').replace('.', ',') for line in lines[1:])


VARIANTS = {
    'byte-order mark': lambda lines: '\ufeff' + '\n'.join(lines),
    'blank lines': lambda lines: '\n\n' + '\n\n'.join(lines) + '\n\n\n',
    'carriage returns': lambda lines: '\r\n'.join(lines),
    'quoted header': lambda lines: '\n'.join([','.join(f'"{c}"' for c in COLUMNS), *lines[1:]]),
    'case and blanks': lambda lines: '\n'.join(
        [lines[0].lower().replace('pos', ' Pos '), *lines[1:]]
    ),
    'decimal commas': lambda lines: ';'.join(COLUMNS) + '\n' + _decimal_commas(lines),
    'title above': lambda lines: '\n'.join(['Exported track', *lines]),
    'trailing separator': lambda lines: '\n'.join(line + ',' for line in lines),
    'last point repeated': lambda lines: '\n'.join([*lines, lines[-1]]),
}


@pytest.mark.parametrize('variant', VARIANTS)
def test_variants_are_read(helix, tmp_path, variant):
    """Files as people have them give the same track."""
    path = tmp_path / 'track.csv'
    path.write_bytes(VARIANTS[variant](text_of(helix, tmp_path)).encode('utf-8'))
    np.testing.assert_allclose(read_track(path).position, helix.position, atol=1e-8)


def _column(lines: list[str], column: int, change) -> str:
    rows = [line.split(',') for line in lines[1:]]
    for row in rows:
        row[column] = str(change(float(row[column])))
    return '\n'.join([lines[0], *(','.join(row) for row in rows)])


def _right_handed_swap(lines: list[str]) -> str:
    text = '\n'.join(lines)
    for column in (7, 8, 9):
        text = _column(text.split('\n'), column, lambda v: -v)
    return text


BAD = {
    'empty': (lambda lines: '', 'no header'),
    'no header': (lambda lines: '\n'.join(lines[1:]), 'no header'),
    'missing column': (
        lambda lines: '\n'.join([lines[0].replace('UpZ', 'Other'), *lines[1:]]),
        'UpZ missing',
    ),
    'word': (
        lambda lines: '\n'.join([*lines[:9], lines[9].replace('0.', 'zero.'), *lines[10:]]),
        'line 10 holds text',
    ),
    'not a number': (
        lambda lines: '\n'.join(
            [*lines[:9], 'nan'.join(lines[9].split(lines[9].split(',')[2], 1))]
        ),
        'PosY is not finite',
    ),
    'short row': (lambda lines: '\n'.join([*lines[:9], '1,2,3']), 'line 10 has 3 values'),
    'few rows': (lambda lines: '\n'.join(lines[:5]), 'at least 8'),
    'not unit': (lambda lines: _column(lines, 11, lambda v: 1.5 * v), 'not unit vectors'),
    'left-handed': (_right_handed_swap, 'left-handed'),
    'backwards': (lambda lines: '\n'.join([lines[0], *lines[:0:-1]]), 'against the order'),
}


@pytest.mark.parametrize('what', BAD)
def test_bad_files_are_explained(helix, tmp_path, what):
    """The error names the file and what is wrong with it."""
    make, message = BAD[what]
    path = tmp_path / 'bad.csv'
    path.write_text(make(text_of(helix, tmp_path)))
    with pytest.raises(DataError, match=message) as caught:
        read_track(path)
    assert str(path) in str(caught.value)


def test_missing_and_binary_files(tmp_path):
    """A path that is no text file at all is a DataError too."""
    with pytest.raises(DataError, match='cannot be read'):
        read_track(tmp_path / 'none.csv')
    (tmp_path / 'noise.csv').write_bytes(bytes(range(128, 256)))
    with pytest.raises(DataError, match='not text'):
        read_track(tmp_path / 'noise.csv')


def test_shifted_moves_along_up(helix):
    """From rail centre to heart line and back."""
    heart = helix.shifted(1.1)
    np.testing.assert_allclose(heart.position - helix.position, 1.1 * helix.up)
    np.testing.assert_allclose(heart.shifted(-1.1).position, helix.position)

"""Balise tables: read back what was written, and errors that say what to mend."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.track.balise_table import BaliseTable, read_balises, write_balises

GOOD = 'id,chainage_m,sigma_m\nB2,2000,0.05\nB1,1000.5,0.1\n'


def written(tmp_path, content):
    path = tmp_path / 'balises.csv'
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_written_is_read_back(tmp_path):
    table = BaliseTable(('north, 1', '007'), np.array([12.345678, 99.5]), np.array([0.05, 0.2]))
    path = tmp_path / 'new' / 'balises.csv'
    write_balises(path, table)
    back = read_balises(path)
    assert back.id == table.id
    np.testing.assert_array_equal(back.chainage, table.chainage)
    np.testing.assert_array_equal(back.sigma, table.sigma)


def test_rows_come_in_order_of_chainage(tmp_path):
    """Their order in the file does not matter; ids keep their numbers."""
    table = read_balises(written(tmp_path, GOOD))
    assert table.id == ('B1', 'B2')
    np.testing.assert_array_equal(table.chainage, [1000.5, 2000.0])
    np.testing.assert_array_equal(table.sigma, [0.1, 0.05])


def test_index_and_length(tmp_path):
    table = read_balises(written(tmp_path, GOOD))
    assert len(table) == 2
    assert (table.index('B1'), table.index('B2'), table.index('B3')) == (0, 1, None)


@pytest.mark.parametrize(
    'content',
    [
        '\ufeffid,chainage_m,sigma_m\r\nB1,1000.5,0.1\r\nB2,2000,0.05\r\n',
        '# surveyed in May\nid,chainage_m,sigma_m\n\nB1,1000.5,0.1\n# new\nB2,2000,0.05\n\n',
        'note;sigma_m;id;chainage_m\nx;0.1;B1;1000.5\ny;0.05;B2;2000\n',
        'id\tchainage_m\tsigma_m\n"B1"\t1000.5\t0.1\n B2 \t2e3\t0.05\n',
    ],
)
def test_other_ways_to_write_it(content, tmp_path):
    """A byte-order mark, comments, blank lines, other separators, other columns, quotes."""
    table = read_balises(written(tmp_path, content))
    assert table.id == ('B1', 'B2')
    np.testing.assert_array_equal(table.chainage, [1000.5, 2000.0])
    np.testing.assert_array_equal(table.sigma, [0.1, 0.05])


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ('', ['empty', 'id,chainage_m,sigma_m']),
        ('# nothing\n\n', ['empty']),
        ('id,chainage_m,sigma_m\n', ['only a header']),
        ('id,chainage_m\nB1,3\n', ['column sigma_m missing']),
        ('B1,1000,0.05\nB2,2000,0.05\n', ['id, chainage_m, sigma_m missing']),
        (GOOD + 'B1,5000,0.05\n', ['line 4', 'id B1', 'line 3', 'remove one']),
        (GOOD + 'B3,5000,0\n', ['line 4', 'sigma_m 0', 'not positive']),
        (GOOD + 'B3,5000,-0.05\n', ['line 4', 'not positive']),
        (GOOD + 'B3,nan,0.05\n', ['line 4', 'chainage_m', 'not finite']),
        (GOOD + 'B3,3000,inf\n', ['line 4', 'sigma_m', 'not finite']),
        (GOOD + '\nB3,three,0.05\n', ['line 5', 'chainage_m', "'three' is not a number"]),
        (GOOD + 'B3,,0.05\n', ['line 4', 'chainage_m', 'not a number']),
        (GOOD + ' ,3000,0.05\n', ['line 4', 'id is empty']),
        (GOOD + 'B3,3000\n', ['line 4', '2 cells', 'header 3']),
        (GOOD + 'B3,3000,0.05,9\n', ['line 4', '4 cells']),
        (b'\x00\xff\xfe\x80', ['not text']),
    ],
)
def test_a_bad_table_is_refused(content, words, tmp_path):
    """The message names the file, the line and the remedy."""
    path = written(tmp_path, content)
    with pytest.raises(DataError) as caught:
        read_balises(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_missing_file(tmp_path):
    with pytest.raises(DataError, match='cannot be read'):
        read_balises(tmp_path / 'none.csv')

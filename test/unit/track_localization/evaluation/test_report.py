"""Tables and the report file."""

import csv
import io
import re

import pytest

from track_localization.evaluation.provenance import commit, fingerprint, machine
from track_localization.evaluation.report import Picture, Section, write_report
from track_localization.evaluation.tabulate import Table, significant

TABLE = Table('Errors [m]', ('method', 'mean', 'n'), [('a|b <i>', 0.12345, 3), ('c', None, 10)])


def test_text_table_is_aligned():
    title, head, rule, first, second = TABLE.text().splitlines()
    assert title == 'Errors [m]'
    assert head == 'method    mean   n'
    assert set(rule) == {'-', ' '}
    assert first == 'a|b <i>  0.123   3'
    assert second.endswith('10')
    assert len(first) == len(second)


def test_markdown_escapes_bars():
    lines = TABLE.markdown().splitlines()
    assert lines[2] == '| method | mean | n |'
    assert lines[3] == '| --- | ---: | ---: |'
    assert lines[4] == '| a\\|b <i> | 0.123 | 3 |'


def test_csv_keeps_every_digit():
    rows = list(csv.reader(io.StringIO(TABLE.csv())))
    assert rows[1] == ['a|b <i>', '0.12345', '3']
    assert rows[2] == ['c', '', '10']


@pytest.mark.parametrize(
    ('value', 'written'),
    [
        *((1234.5, '1234'), (12.345, '12.3'), (0.04567, '0.0457'), (0.0, '0'), (-2.5, '-2.50')),
        *((1234567.8, '1234568'), (-24427436016.0, '-2.44e+10')),
    ],
)
def test_three_digits_that_matter(value, written):
    assert significant(value) == written


def test_report_is_one_file_without_links(tmp_path):
    """The picture's bytes are inside, text is escaped, and nothing points outside the file."""
    picture = tmp_path / 'p.png'
    picture.write_bytes(b'a picture')
    path = tmp_path / 'report.html'
    section = Section(
        'Results & <more>',
        ['say "x"'],
        {'commit': 'abc'},
        [TABLE],
        [Picture(picture, 'cap')],
        'a<b',
    )
    write_report(path, 'Ride', [section])
    text = path.read_text()
    assert 'data:image/png;base64,YSBwaWN0dXJl"' in text
    assert re.findall(r'(?:src|href)\s*=\s*"(?!data:)', text) == []
    assert not re.search(r'https?://|@import|url\(', text)
    assert 'a|b &lt;i&gt;' in text
    assert 'Results &amp; &lt;more&gt;' in text
    assert 'a&lt;b' in text


def test_provenance_names_the_code_and_the_machine(tmp_path):
    assert re.fullmatch(r'[0-9a-f]{40}(-dirty)?|version .+', commit())
    assert int(machine()['processors']) >= 1
    (tmp_path / 'a.py').write_text('x = 1')
    one = fingerprint([tmp_path], 'config')
    assert one == fingerprint([tmp_path], 'config')
    (tmp_path / 'a.py').write_text('x = 2')
    assert len({one, fingerprint([tmp_path], 'config'), fingerprint([tmp_path], 'other')}) == 3

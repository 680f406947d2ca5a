"""``compare`` and ``learn_line`` from the command line: files, tables, exit codes."""

import csv

import pytest

from track_localization.cli.compare import main as compare
from track_localization.cli.compare import read_elements
from track_localization.cli.learn_line import main as learn_line
from track_localization.cli.locate import main as locate
from track_localization.cli.simulate import main as simulate
from track_localization.errors import DataError
from track_localization.track.learned_line import read_learned_line

ONE_TRACK = ['--set', 'track.build_seed=1', '--set', 'ride.dwell_before_s=[4, 4]']
SLOW = ['--set', 'ride.launch=0.0', '--set', 'imu.rate_hz=50']


@pytest.fixture(scope='module')
def rides(tmp_path_factory):
    """Return the folders of two rides over one built track."""
    folders = []
    for seed in ('1', '2'):
        folder = tmp_path_factory.mktemp('ride')
        arguments = ['coaster', '--track', 'launch', '--seed', seed, *ONE_TRACK, *SLOW]
        assert simulate([*arguments, '--output', str(folder)]) == 0
        folders.append(folder)
    return folders


def test_compare_writes_what_it_says(rides, tmp_path, capsys):
    bags = [str(folder / 'bag') for folder in rides]
    elements = tmp_path / 'elements.csv'
    elements.write_text('name,from_m,to_m\nfirst hill,200,300\nlast turn,700,800\n')
    arguments = ['--elements', str(elements), '--output', str(tmp_path / 'out')]
    assert compare([*bags, *arguments]) == 0
    said = capsys.readouterr().out
    assert 'first hill' in said
    assert '+-' in said
    with (tmp_path / 'out' / 'comparison.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 2000
    for row in rows[100:-100:50]:
        difference = float(row['speed_b_mps']) - float(row['speed_a_mps'])
        assert float(row['speed_difference_mps']) == pytest.approx(difference, abs=2e-4)
        assert float(row['sigma_mps']) > 0.0
    assert (tmp_path / 'out' / 'comparison.png').stat().st_size > 20_000


def test_a_ride_beside_itself_does_not_differ(rides, tmp_path, capsys):
    bag = str(rides[0] / 'bag')
    assert compare([bag, bag, '--output', str(tmp_path / 'out')]) == 0
    said = capsys.readouterr().out
    assert 'not significant' in said
    assert 'B slower' not in said
    assert 'B faster' not in said


def test_learn_line_writes_what_locate_reads(rides, tmp_path, capsys):
    bags = [str(folder / 'bag') for folder in rides]
    assert learn_line([*bags, '--output', str(tmp_path)]) == 0
    assert 'rms' in capsys.readouterr().out
    learned = read_learned_line(tmp_path / 'learned_line.csv')
    assert (learned.rides > 1).mean() > 0.9
    assert (tmp_path / 'learned_line.png').stat().st_size > 20_000
    events = tmp_path / 'events.csv'
    events.write_text('time_s,name\n130.0,bang\n')
    arguments = ['--events', str(events), '--learned', str(tmp_path / 'learned_line.csv')]
    assert locate([bags[0], *arguments]) == 0
    with_it = capsys.readouterr().out
    assert locate([bags[0], *arguments[:2]]) == 0
    assert capsys.readouterr().out != with_it


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('name,from_m\na,1\n', ['to_m']),
        ('name,from_m,to_m\na,30,20\n', ["'a'", 'from_m', 'two']),
        ('name,from_m,to_m\na,30,2000\n', ["'a'", '500.0 m long']),
        ('name,from_m,to_m\na,x,20\n', ['from_m', "'x'"]),
    ],
)
def test_bad_elements_are_told(tmp_path, text, words):
    path = tmp_path / 'elements.csv'
    path.write_text(text)
    with pytest.raises(DataError) as error:
        read_elements(path, 500.0)
    assert all(word in str(error.value) for word in [str(path), *words])


def test_what_cannot_be_used_exits_with_1(rides, tmp_path, capsys):
    bag = str(rides[0] / 'bag')
    for command, arguments, word in (
        (compare, [bag, str(tmp_path / 'none')], 'none'),
        (compare, [bag, bag, '--learned', str(tmp_path / 'no.csv')], 'learn_line'),
        (learn_line, [bag], 'two rides'),
        (learn_line, [bag, bag], 'twice'),
        (learn_line, [bag, bag, '--design-ride', str(tmp_path / 'd.csv')], 'twice'),
    ):
        assert command([*arguments, '--output', str(tmp_path / 'out')]) == 1
        assert word in capsys.readouterr().err


def test_a_bag_without_a_design_ride_is_told(rides, tmp_path, capsys):
    bare = tmp_path / 'elsewhere'
    bare.mkdir()
    for file in (rides[0] / 'bag').iterdir():
        (bare / file.name).write_bytes(file.read_bytes())
    assert compare([str(bare), str(bare), '--output', str(tmp_path / 'out')]) == 1
    assert '--design-ride' in capsys.readouterr().err

"""Files that every command line finds, makes and leaves behind alike."""

import json

import numpy as np
import pytest

from track_localization.cli.files import (
    beside,
    make_file,
    make_folder,
    write_metrics,
    write_trajectories,
)
from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.io.tables import read_trajectory
from track_localization.io.tum import read_tum


def test_files_are_found_in_the_bag_and_beside_it(tmp_path):
    bag = tmp_path / 'ride' / 'bag'
    bag.mkdir(parents=True)
    (bag / 'a.mcap').touch()
    (tmp_path / 'ride' / 'markers.csv').touch()
    assert beside(bag, 'markers.csv') == tmp_path / 'ride' / 'markers.csv'
    assert beside(bag / 'a.mcap', 'markers.csv') == tmp_path / 'ride' / 'markers.csv'
    (bag / 'markers.csv').touch()
    assert beside(bag, 'markers.csv') == bag / 'markers.csv'
    assert beside(bag / 'a.mcap', 'markers.csv') == bag / 'markers.csv'
    assert beside(bag, 'track.csv') is None


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    made = make_folder(tmp_path / 'a' / 'b')
    assert made.is_dir()
    assert make_folder(made) == made
    (tmp_path / 'file').touch()
    with pytest.raises(DataError, match=r'--output .*file'):
        make_folder(tmp_path / 'file')


def test_a_file_that_cannot_be_made_is_told(tmp_path):
    made = make_file(tmp_path / 'a' / 'places.csv')
    made.write_text('kept')
    assert make_file(made).read_text() == 'kept'
    with pytest.raises(DataError, match=r'--output .*a: cannot be made'):
        make_file(tmp_path / 'a')
    with pytest.raises(DataError, match=r'--output .*x: cannot be made'):
        make_file(made / 'x')


def test_metrics_are_json_that_any_reader_takes(tmp_path):
    write_metrics(tmp_path, {'mean': 1.5})
    assert json.loads((tmp_path / 'metrics.json').read_text()) == {'mean': 1.5}
    with pytest.raises(ValueError, match='JSON'):
        write_metrics(tmp_path, {'mean': float('nan')})


def test_a_trajectory_is_written_twice(tmp_path):
    time = np.array([1000.0, 1000.1])
    trajectory = Trajectory(time, np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]))
    write_trajectories(tmp_path, {'one': trajectory})
    for read in (
        read_trajectory(tmp_path / 'trajectory_one.csv'),
        read_tum(tmp_path / 'trajectory_one.tum'),
    ):
        np.testing.assert_array_equal(read.time_s, time)
        np.testing.assert_array_equal(read.position, trajectory.position)

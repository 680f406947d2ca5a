"""Bags that are damaged, cut off or none: told by name, and what is whole is read."""

import sqlite3

import numpy as np
import pytest
from helpers.bags_by_hand import imu_rows, write_foreign
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from track_localization.errors import DataError
from track_localization.io import bags


@pytest.mark.parametrize(
    ('name', 'content'),
    [('a.mcap', b''), ('a.db3', b''), ('a.mcap', b'rubbish' * 99), ('a.db3', b'rubbish' * 999)],
)
def test_files_that_are_no_bags(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DataError, match=name):
        bags.read_imu(path)


def test_missing_and_empty_places(tmp_path):
    with pytest.raises(DataError, match='no such file'):
        bags.read_imu(tmp_path / 'nowhere')
    with pytest.raises(DataError, match=r'no \.mcap or \.db3'):
        bags.read_imu(tmp_path)
    (tmp_path / 'metadata.yaml').write_text('rosbag2_bagfile_information: [')
    with pytest.raises(DataError, match='cannot be opened'):
        bags.list_topics(tmp_path)


def test_broken_metadata_does_not_hide_a_good_storage_file(bag):
    (bag / 'metadata.yaml').write_text('rosbag2_bagfile_information: [')
    assert len(bags.read_imu(bag)[0]) == 400


def read_or_none(path):
    """Return what ``read_imu`` gives, or None where it refuses the file and names it."""
    try:
        return bags.read_imu(path)
    except DataError as error:
        if path.name not in str(error):
            raise AssertionError(f'the error does not name the file: {error}') from error
        return None


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_a_truncated_bag_gives_true_samples_and_counts_the_rest(tmp_path, storage):
    rows = imu_rows(300)
    write_foreign(tmp_path / 'b', {'/imu/data_raw': ('sensor_msgs/msg/Imu', rows)}, storage)
    (whole,) = [p for p in (tmp_path / 'b').iterdir() if p.suffix in bags.STORAGES]
    content = whole.read_bytes()
    for cut in np.random.default_rng(1).integers(0, len(content) - 1, 40):
        path = tmp_path / f'cut{whole.suffix}'
        path.write_bytes(content[:cut])
        result = read_or_none(path)
        if result is not None:
            series, rejected = result
            k = series.time_s - 100.5
            assert np.isin(k, np.arange(300)).all()
            np.testing.assert_array_equal(series.specific_force[:, 0], k)
            assert rejected['unreadable'] > 0
        elif storage == StoragePlugin.MCAP:
            assert cut < 0.1 * len(content)  # the definitions come first


def test_a_truncated_mcap_keeps_its_share(tmp_path):
    """Half of the bytes of a long recording hold about half of its messages, chunked or not."""
    rows = imu_rows(9000)
    for mode in (CompressionMode.NONE, CompressionMode.STORAGE):
        path = tmp_path / mode.name
        topics = {'/imu/data_raw': ('sensor_msgs/msg/Imu', rows)}
        write_foreign(path, topics, StoragePlugin.MCAP, mode)
        file = path / f'{mode.name}.mcap'
        content = file.read_bytes()
        file.write_bytes(content[: len(content) * 6 // 10])
        series, rejected = bags.read_imu(path)
        assert 4500 < len(series) < 6000
        assert rejected == {'unreadable': 1}


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_corrupt_bytes_are_told_or_harmless(tmp_path, storage):
    """Overwrite stretches of the file: all samples, a counted loss or DataError."""
    rows = imu_rows(300)
    write_foreign(tmp_path / 'b', {'/imu/data_raw': ('sensor_msgs/msg/Imu', rows)}, storage)
    (whole,) = [p for p in (tmp_path / 'b').iterdir() if p.suffix in bags.STORAGES]
    content = whole.read_bytes()
    rng = np.random.default_rng(2)
    for place in rng.integers(0, len(content) - 64, 60):
        path = tmp_path / f'hit{whole.suffix}'
        path.write_bytes(content[:place] + rng.bytes(64) + content[place + 64 :])
        result = read_or_none(path)
        if result is not None:
            series, rejected = result
            assert len(series) == 300 or sum(rejected.values()) > 0


def test_a_database_of_a_killed_recorder_is_read(tmp_path):
    write_foreign(
        tmp_path / 'b',
        {'/imu/data_raw': ('sensor_msgs/msg/Imu', imu_rows(4))},
        StoragePlugin.SQLITE3,
    )
    (tmp_path / 'b' / 'metadata.yaml').unlink()
    with sqlite3.connect(tmp_path / 'b' / 'b.db3') as database:
        database.execute('DELETE FROM metadata')
    database.close()
    assert len(bags.read_imu(tmp_path / 'b')[0]) == 4

"""Files that several tests of nodes need."""

from __future__ import annotations

import numpy as np
import pytest

from track_localization.track.balise_table import BaliseTable, write_balises
from track_localization.track.track_file import TrackFile, write_track


@pytest.fixture(scope='session')
def maglev_files(tmp_path_factory) -> dict[str, str]:
    """
    Return the paths of a balise table and a track file.

    Balises a, b, c lie a kilometre apart from 500 m on; the line goes 3 km straight from
    (100, 200, 5) along (0.6, 0.8, 0).
    """
    folder = tmp_path_factory.mktemp('line')
    table = BaliseTable(('a', 'b', 'c'), np.array([500.0, 1500.0, 2500.0]), np.full(3, 0.05))
    write_balises(folder / 'balises.csv', table)
    forward, left, up = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    points = np.array([100.0, 200.0, 5.0]) + np.arange(0.0, 3001.0, 10.0)[:, None] * forward
    axes = (np.tile(axis, (len(points), 1)) for axis in (forward, left, up))
    write_track(folder / 'track.csv', TrackFile(points, *axes))
    return {'balises': str(folder / 'balises.csv'), 'track': str(folder / 'track.csv')}

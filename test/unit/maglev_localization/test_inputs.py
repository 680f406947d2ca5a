"""The files of a line, and what is said of those that do not belong together."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_localization.inputs import read_line, warm_up_measurements
from maglev_localization.measurements import BALISE, LOOP, RADAR, sensor_of
from track_localization.errors import DataError
from track_localization.track.balise_table import BaliseTable
from track_localization.track.track_file import TrackFile, write_track

ARC_M = 700.0


def track() -> TrackFile:
    """Return a straight level line along x."""
    points = np.arange(0.0, ARC_M + 1.0, 10.0)[:, None] * np.array([1.0, 0.0, 0.0])
    return TrackFile(points, *(np.tile(axis, (len(points), 1)) for axis in np.eye(3)))


def balises(*chainage: float) -> BaliseTable:
    ids = tuple(f'b{i}' for i in range(len(chainage)))
    return BaliseTable(ids, np.array(chainage), np.full(len(chainage), 0.05))


def test_a_line_is_read_with_its_balises(tmp_path):
    write_track(tmp_path / 'track.csv', track())
    line = read_line(str(tmp_path / 'track.csv'), balises(0.0, ARC_M + 1.0))
    assert line.length == pytest.approx(ARC_M, abs=0.1)


@pytest.mark.parametrize('stray', [-20.0, 900.0])
def test_balises_of_another_line_are_told(tmp_path, stray):
    write_track(tmp_path / 'track.csv', track())
    said = rf'track\.csv: this line is 700 m long, but balise b\d lies at {stray:.0f} m; name'
    with pytest.raises(DataError, match=said):
        read_line(str(tmp_path / 'track.csv'), balises(100.0, stray))


def test_the_run_to_practise_with_has_every_sensor_in_the_order_of_a_run():
    """Stamps go back for messages that are late, and only then; the table's first id is heard."""
    table = balises(500.0, 1500.0)
    measurements = list(warm_up_measurements(table))
    assert {sensor_of(m) for m in measurements} == {LOOP, RADAR, BALISE}
    assert {m.balise for m in measurements if sensor_of(m) == BALISE} == {'none', 'b0', 'b1'}
    back = -np.diff([m.time_s for m in measurements])
    assert 0 < np.sum(back > 0.0) < 0.02 * len(measurements)
    assert back.max() < 0.5

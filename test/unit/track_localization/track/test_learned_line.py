"""``learned_line.csv``: written and read back, and what is told of a bad one."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.track.learned_line import (
    COLUMNS,
    LearnedLine,
    read_learned_line,
    write_learned_line,
)

HEADER = ','.join(COLUMNS)
GOOD = '0,10,0.1,0.001,0,0,0.002,3'


def test_what_is_written_is_read_back(tmp_path, rng):
    """To the digits of the file; what no ride told stays unknown."""
    m = 40
    speed, sigma = rng.uniform(1.0, 30.0, m), rng.uniform(1e-3, 5e-3, m)
    speed[3] = sigma[7] = np.nan
    learned = LearnedLine(
        np.arange(m) * 0.5,
        speed,
        rng.uniform(0.01, 1.0, m),
        1e-3 * rng.standard_normal((m, 3)),
        sigma,
        rng.integers(0, 5, m).astype(float),
    )
    write_learned_line(tmp_path / 'learned_line.csv', learned)
    again = read_learned_line(tmp_path / 'learned_line.csv')
    np.testing.assert_allclose(again.chainage, learned.chainage, atol=5e-4)
    np.testing.assert_allclose(again.speed, learned.speed, atol=5e-5)
    np.testing.assert_allclose(again.speed_sigma, learned.speed_sigma, atol=5e-5)
    np.testing.assert_allclose(again.turn, learned.turn, atol=5e-8)
    np.testing.assert_allclose(again.sigma, learned.sigma, atol=5e-8)
    np.testing.assert_array_equal(again.rides, learned.rides)


@pytest.mark.parametrize(
    ('lines', 'words'),
    [
        ([HEADER.replace('sigma_rad', 'sigma'), GOOD, GOOD], ['no column sigma_rad']),
        ([HEADER, GOOD], ['1 rows', 'learn']),
        ([HEADER, GOOD, GOOD], ['row 3', 'chainage_m', 'increase']),
        ([HEADER, GOOD, '1,10,0.1,x,0,0,0.002,3'], ['row 3', 'turn_x_rad', "'x'"]),
        ([HEADER, GOOD, '1,10,0.1,,0,0,0.002,3'], ['row 3', 'turn_x_rad']),
        ([HEADER, GOOD, '1,10,0.1,0.1,0,0,-0.002,3'], ['row 3', 'sigma_rad', 'positive']),
        ([HEADER, GOOD, '1,10,0.1,3.0,0,0,0.002,3'], ['row 3', 'degrees']),
        ([HEADER, GOOD, '1,10,0.1,nan,0,0,0.002,3'], ['row 3', 'turn_x_rad', 'finite']),
        ([HEADER, GOOD, '1,10'], ['row 3', '2 cells']),
        ([], ['no column']),
    ],
)
def test_a_bad_file_is_told_with_its_row(tmp_path, lines, words):
    path = tmp_path / 'learned_line.csv'
    path.write_text('\n'.join(lines))
    with pytest.raises(DataError) as error:
        read_learned_line(path)
    assert all(word in str(error.value) for word in [str(path), *words])


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(DataError, match='learn_line'):
        read_learned_line(tmp_path / 'nothing.csv')

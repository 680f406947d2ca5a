"""Tables: round trips, every separator, and errors that name the cell."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from track_localization.errors import DataError
from track_localization.estimation.trajectory import Trajectory
from track_localization.io import tables

finite = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    'text',
    [
        'time_s,name\n1.5,Loop\n2,Lift hill\n',
        'time_s;name\r\n1,5;Loop\r\n2;Lift hill\r\n',
        'name\tother\ttime_s\nLoop\t?\t1.5\n\nLift hill\t?\t2\n',
        '# by hand\n time_s , name \n1.5, Loop\n# more\n2, Lift hill\n',
        'time_s,name,\n1.5,Loop,\n2,Lift hill,,\n',
    ],
)
@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'utf-16'])
def test_separators_and_encodings(tmp_path, text, encoding):
    path = tmp_path / 'events.csv'
    path.write_bytes(text.encode(encoding))
    events = tables.read_events(path)
    np.testing.assert_array_equal(events.time_s, [1.5, 2.0])
    assert events.name == ('Loop', 'Lift hill')


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'empty'),
        ('\n# nothing\n', 'empty'),
        ('time_s,name\n', 'no rows'),
        ('time,name\n1,Loop\n', 'no column time_s'),
        ('time_s,name\n1,Loop\n\nsoon,Lift\n', "line 4, column time_s: 'soon'"),
        ('time_s,name\n1,Loop\n,Lift\n', "line 3, column time_s: ''"),
        ('time_s,name\n1,Loop\nnan,Lift\n', "line 3, column time_s: 'nan' is not finite"),
        ('time_s,name\n1\n', 'line 2 has 1 cells, the header 2'),
        ('time_s,name\n1,Loop,3\n', 'line 2 has 3 cells, the header 2'),
        ('time_s,name,name\n1,a,b\n', 'name stands twice'),
    ],
)
def test_errors_name_file_line_and_column(tmp_path, text, said):
    path = tmp_path / 'events.csv'
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        tables.read_events(path)
    assert said in str(caught.value)
    assert 'events.csv' in str(caught.value)


def test_files_that_are_no_text(tmp_path):
    with pytest.raises(DataError, match='cannot be read'):
        tables.read_events(tmp_path / 'nothing.csv')
    with pytest.raises(DataError, match='cannot be read'):
        tables.read_events(tmp_path)
    (tmp_path / 'x.csv').write_bytes(b'time_s,name\n1,\xff\xff\xff\n')
    with pytest.raises(DataError, match='UTF-8'):
        tables.read_events(tmp_path / 'x.csv')


@given(content=st.binary(max_size=200))
def test_any_bytes_give_a_table_or_a_data_error(content):
    try:
        table = tables.parse_table('t', content, ('a',))
    except DataError:
        return
    assert np.isfinite(table.numbers['a']).all()


@given(
    rows=st.lists(
        st.tuples(finite, finite, finite, finite, st.text(max_size=20)), min_size=1, max_size=20
    )
)
def test_markers_come_back(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp('markers') / 'markers.csv'
    values = np.array([row[:4] for row in rows])
    names = tuple(row[4] for row in rows)
    tables.write_markers(path, tables.Markers(values[:, 0], names, values[:, 1:]))
    back = tables.read_markers(path)
    np.testing.assert_allclose(back.time_s, values[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(back.position, values[:, 1:], rtol=0, atol=1e-6)
    assert back.name == tuple(' '.join(name.split()) for name in names)


def test_marker_header_is_the_documented_one(tmp_path):
    markers = tables.Markers(np.array([1.0]), ('Loop, top',), np.array([[1.0, 2.0, 3.0]]))
    tables.write_markers(tmp_path / 'm.csv', markers)
    assert (tmp_path / 'm.csv').read_text() == (
        'time_s,name,x_m,y_m,z_m\n1.000000000,"Loop, top",1.000000,2.000000,3.000000\n'
    )


def test_trajectory_leaves_unknown_cells_empty(tmp_path):
    path = tmp_path / 'trajectory_x.csv'
    tables.write_trajectory(path, Trajectory(np.array([0.5]), np.array([[1.0, 2.0, 3.0]])))
    header, row = path.read_text().splitlines()
    assert header == (
        'time_s,x_m,y_m,z_m,qx,qy,qz,qw,vx_mps,vy_mps,vz_mps,chainage_m,speed_mps,sigma_along_m,'
        'sigma_x_m,sigma_y_m,sigma_z_m,sigma_speed_mps'
    )
    assert row == '0.500000000,1.000000,2.000000,3.000000' + ',' * 14
    back = tables.read_trajectory(path)
    assert back.quaternion is None
    assert back.covariance is None
    assert back.chainage is None


def test_a_full_trajectory_comes_back(tmp_path):
    n = 5
    rng = np.random.default_rng(1)
    full = Trajectory(
        1.7e9 + np.arange(n) / 100.0,
        rng.normal(size=(n, 3)),
        quaternion=rng.normal(size=(n, 4)),
        velocity=rng.normal(size=(n, 3)),
        chainage=np.array([1.0, 2.0, np.nan, 4.0, 5.0]),
        speed=rng.normal(size=n),
        covariance=np.stack([np.diag([1.0, 4.0, 9.0])] * n),
        sigma_along=np.ones(n),
        sigma_speed=np.full(n, 0.5),
    )
    tables.write_trajectory(tmp_path / 't.csv', full)
    back = tables.read_trajectory(tmp_path / 't.csv')
    np.testing.assert_allclose(back.time_s, full.time_s, rtol=0, atol=1e-6)
    for name in ('position', 'quaternion', 'velocity', 'chainage', 'speed', 'covariance'):
        np.testing.assert_allclose(getattr(back, name), getattr(full, name), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(back.sigma_along, full.sigma_along)
    np.testing.assert_array_equal(back.sigma_speed, full.sigma_speed)


def test_a_trajectory_without_position_is_refused(tmp_path):
    (tmp_path / 't.csv').write_text('time_s,x_m,y_m,z_m\n1,2,,4\n')
    with pytest.raises(DataError, match='y_m'):
        tables.read_trajectory(tmp_path / 't.csv')

"""Design ride files and resampling, on a ride whose motion is known."""

import dataclasses

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.track.design_ride import (
    COLUMNS,
    DesignRide,
    read_design_ride,
    write_design_ride,
)


def ride(rate_hz: float = 100.0) -> DesignRide:
    """Return ten seconds on a flat circle of 20 m at 8 m/s."""
    t = np.arange(0.0, 10.0, 1.0 / rate_hz)
    a, zero = 0.4 * t, np.zeros(len(t))
    return DesignRide(
        time_s=t,
        chainage=8.0 * t,
        position=20.0 * np.stack([np.sin(a), 1.0 - np.cos(a), zero], axis=1),
        quaternion=np.stack([zero, zero, np.sin(a / 2), np.cos(a / 2)], axis=1),
        velocity=8.0 * np.stack([np.cos(a), np.sin(a), zero], axis=1),
        specific_force=np.stack([zero, zero + 3.2, zero + 9.80665], axis=1),
        angular_rate=np.stack([zero, zero, zero + 0.4], axis=1),
    )


def test_round_trip(tmp_path):
    """Every column survives to the digits written."""
    write_design_ride(tmp_path / 'r.csv', ride())
    back = read_design_ride(tmp_path / 'r.csv')
    for name, atol in (('time_s', 1e-6), ('position', 1e-6), ('quaternion', 1e-8)):
        np.testing.assert_allclose(getattr(back, name), getattr(ride(), name), atol=atol)
    np.testing.assert_allclose(back.specific_force, ride().specific_force, atol=1e-6)
    assert (tmp_path / 'r.csv').read_text().splitlines()[0] == (
        'time_s,chainage_m,x_m,y_m,z_m,qx,qy,qz,qw,vx_mps,vy_mps,vz_mps,'
        'fx_mps2,fy_mps2,fz_mps2,wx_radps,wy_radps,wz_radps'
    )


def test_resampling_keeps_to_the_circle():
    """From 10 Hz to 200 Hz: the cubic keeps positions to 0.1 mm (chords would be off by 4 mm)."""
    fine = ride(10.0).resample(200.0)
    assert fine.rate_hz == pytest.approx(200.0)
    a = 0.4 * fine.time_s
    expected = 20.0 * np.stack([np.sin(a), 1.0 - np.cos(a), 0 * a], axis=1)
    np.testing.assert_allclose(fine.position, expected, atol=1e-4)
    yaw = 2.0 * np.arctan2(fine.quaternion[:, 2], fine.quaternion[:, 3])
    np.testing.assert_allclose(yaw, a, atol=1e-9)


def test_quaternion_signs_do_not_matter():
    """A flipped quaternion is the same attitude; between rows the short way is taken."""
    plain = ride(10.0)
    flipped = plain.quaternion.copy()
    flipped[::2] *= -1.0
    mixed = DesignRide(
        plain.time_s,
        plain.chainage,
        plain.position,
        flipped,
        plain.velocity,
        plain.specific_force,
        plain.angular_rate,
    )
    t = np.linspace(0.0, 9.0, 333)
    dot = np.sum(plain.at(t).quaternion * mixed.at(t).quaternion, axis=1)
    np.testing.assert_allclose(np.abs(dot), 1.0, atol=1e-12)


def test_outside_the_ride_its_ends_hold():
    """Times before and after get the first and the last row."""
    out = ride().at(np.array([-5.0, 99.0]))
    np.testing.assert_allclose(out.position, ride().position[[0, -1]])
    np.testing.assert_allclose(out.chainage, ride().chainage[[0, -1]])


def _edit(lines: list[str], row: int, column: str, value: str) -> str:
    cells = lines[row].split(',')
    cells[COLUMNS.index(column)] = value
    return '\n'.join([*lines[:row], ','.join(cells), *lines[row + 1 :]])


BAD = {
    'missing column': (
        lambda t: '\n'.join([t[0].replace('qz', 'q3'), *t[1:]]),
        'column qz missing',
    ),
    'empty': (lambda t: '', 'missing'),
    'text': (lambda t: _edit(t, 5, 'fy_mps2', 'fast'), 'row 6 holds text'),
    'nan': (lambda t: _edit(t, 5, 'fy_mps2', 'nan'), 'row 6, fy_mps2 is not finite'),
    'time': (lambda t: _edit(t, 5, 'time_s', '0.01'), 'time_s does not increase at row 6'),
    'quaternion': (lambda t: _edit(t, 5, 'qw', '3.0'), 'row 6: qx,qy,qz,qw has length'),
    'ragged': (lambda t: '\n'.join([*t[:5], '1,2']), 'row 6 has 2 values'),
    'short': (lambda t: '\n'.join(t[:5]), 'at least 10'),
}


@pytest.mark.parametrize('what', BAD)
def test_bad_files_are_explained(tmp_path, what):
    """The error names file, row and column."""
    write_design_ride(tmp_path / 'good.csv', ride())
    make, message = BAD[what]
    path = tmp_path / 'bad.csv'
    path.write_text(make((tmp_path / 'good.csv').read_text().splitlines()))
    with pytest.raises(DataError, match=message) as caught:
        read_design_ride(path)
    assert str(path) in str(caught.value)


def test_columns_may_stand_in_any_order(tmp_path):
    """Columns are found by name; others may stand among them."""
    write_design_ride(tmp_path / 'r.csv', ride())
    rows = [line.split(',') for line in (tmp_path / 'r.csv').read_text().splitlines()]
    turned = [','.join(['note' if i == 0 else '1', *row[::-1]]) for i, row in enumerate(rows)]
    (tmp_path / 'turned.csv').write_text('\n'.join(turned))
    back = read_design_ride(tmp_path / 'turned.csv')
    np.testing.assert_allclose(back.velocity, ride().velocity, atol=1e-6)


@pytest.mark.parametrize(('rest_s', 'where'), [(0.0, 'along the ride'), (3.0, 'where the ride st')])
def test_forces_in_g_are_told(tmp_path, rest_s, where):
    """A ride at 4 g that stands first is 1 long at rest; one that never stands, all along."""
    good = ride()
    rest = good.time_s < rest_s
    force = np.where(rest[:, None], [0.0, 0.0, 9.80665], good.specific_force)
    force[~rest] *= 4.0 if rest_s else 1.0
    velocity = np.where(rest[:, None], 0.0, good.velocity)
    good = dataclasses.replace(good, specific_force=force, velocity=velocity)
    write_design_ride(tmp_path / 'good.csv', good)
    assert len(read_design_ride(tmp_path / 'good.csv')) == len(good)
    bad = dataclasses.replace(good, specific_force=force / 9.80665)
    write_design_ride(tmp_path / 'bad.csv', bad)
    with pytest.raises(DataError, match=rf'bad.csv: .*fx_mps2, .* in g.*{where}.*multiply'):
        read_design_ride(tmp_path / 'bad.csv')


def test_a_ride_without_forces_is_read(tmp_path):
    write_design_ride(
        tmp_path / 'r.csv', dataclasses.replace(ride(), specific_force=np.zeros((len(ride()), 3)))
    )
    assert not read_design_ride(tmp_path / 'r.csv').specific_force.any()

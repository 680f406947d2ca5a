"""Local east-north-up coordinates against rotations written out, and there and back."""

import numpy as np
import pytest

from track_localization.geodesy import Datum, enu_from_geodetic, geodetic_from_enu

DATUM = Datum(np.deg2rad(40.3458), np.deg2rad(116.0271), 50.0)
DATUMS = [
    DATUM,
    Datum(np.deg2rad(-33.9), np.deg2rad(-179.999), 5.0),
    Datum(0.0, 0.0, 0.0),
    Datum(np.deg2rad(68.4), np.deg2rad(17.4), 512.0),
]


def earth_fixed(lat, lon, h):
    """Return Earth-fixed coordinates (..., 3) from the ellipsoid's two axes."""
    a, b = 6378137.0, 6356752.314245179
    across = a * a / np.hypot(a * np.cos(lat), b * np.sin(lat))
    return np.stack(
        [
            (across + h) * np.cos(lat) * np.cos(lon),
            (across + h) * np.cos(lat) * np.sin(lon),
            ((b / a) ** 2 * across + h) * np.sin(lat),
        ],
        axis=-1,
    )


def axes(datum):
    """Return east, north and up (3, 3) of a datum, row by row, in Earth-fixed coordinates."""
    sp, cp = np.sin(datum.latitude_rad), np.cos(datum.latitude_rad)
    sl, cl = np.sin(datum.longitude_rad), np.cos(datum.longitude_rad)
    return np.array([[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])


def around(datum, rng, count=500):
    """Return latitudes, longitudes and heights (count,) within some 200 km of a datum."""
    return (
        datum.latitude_rad + rng.uniform(-0.03, 0.03, count),
        datum.longitude_rad + rng.uniform(-0.03, 0.03, count),
        datum.height_m + rng.uniform(-100.0, 3000.0, count),
    )


@pytest.mark.parametrize('datum', DATUMS)
def test_enu_is_the_rotated_difference_of_earth_fixed_positions(datum, rng):
    """Positions are 6e6 m long before the difference: they are good to 1e-9 m each."""
    lat, lon, h = around(datum, rng)
    away = earth_fixed(lat, lon, h) - earth_fixed(*datum)
    found = enu_from_geodetic(lat, lon, h, datum)
    np.testing.assert_allclose(found, away @ axes(datum).T, atol=1e-8)


@pytest.mark.parametrize('datum', DATUMS)
def test_there_and_back(datum, rng):
    """A micrometre, as an angle and as a height; longitudes come back within pi of zero."""
    lat, lon, h = around(datum, rng)
    back = geodetic_from_enu(enu_from_geodetic(lat, lon, h, datum), datum)
    assert back.shape == (500, 3)
    np.testing.assert_allclose(back[:, 0], lat, atol=1.6e-13)
    np.testing.assert_allclose(np.sin(back[:, 1] - lon), 0.0, atol=1.6e-13)
    assert np.abs(back[:, 1]).max() <= np.pi
    np.testing.assert_allclose(back[:, 2], h, atol=1e-6)


def test_the_datum_is_the_origin_and_axes_point_east_north_up():
    lat, lon, h = DATUM
    np.testing.assert_allclose(enu_from_geodetic(lat, lon, h, DATUM), [[0, 0, 0]], atol=1e-9)
    step = 1e-6
    moved = enu_from_geodetic([lat, lat + step, lat], [lon + step, lon, lon], [h, h, h + 6], DATUM)
    along = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    # A microradian of longitude is 4.9 m: the ground turns by less than that over it.
    np.testing.assert_allclose(along, np.eye(3), atol=2e-6)


def test_the_plane_leaves_the_ground():
    """At 10 km due east the ellipsoid lies d^2 / 2N below the plane."""
    lat, lon, h = DATUM
    across = 6378137.0 / np.sqrt(1.0 - 6.69437999014e-3 * np.sin(lat) ** 2) + h
    there = enu_from_geodetic(lat, lon + 1e4 / (across * np.cos(lat)), h, DATUM)[0]
    assert there[2] == pytest.approx(-(1e4**2) / (2.0 * across), rel=1e-3)


def test_one_point_many_and_none_have_the_same_shape():
    lat, lon, h = DATUM
    assert enu_from_geodetic(lat, lon, h, DATUM).shape == (1, 3)
    assert geodetic_from_enu([10.0, 20.0, 30.0], DATUM).shape == (1, 3)
    assert geodetic_from_enu(np.zeros((4, 3)), DATUM).shape == (4, 3)
    assert enu_from_geodetic([], [], [], DATUM).shape == (0, 3)
    assert geodetic_from_enu(np.zeros((0, 3)), DATUM).shape == (0, 3)

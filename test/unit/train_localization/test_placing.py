"""Places and directions in ``map`` against pymap3d's."""

from __future__ import annotations

import numpy as np
import pymap3d

from track_localization.estimation import so3
from track_localization.geodesy import Datum
from train_localization.kernels import SIZE
from train_localization.placing import Placing

DATUM = Datum(0.7, 2.0, 100.0)
NAV = np.array([0.703, 2.004, 350.0, 30.0, 40.0, 1.0, *so3.quat_from_matrix(np.eye(3))])


def test_position_is_that_of_the_library():
    """18 km from the datum; both are exact but for rounding, 1e-9 of the Earth's radius."""
    expected = pymap3d.geodetic2enu(*NAV[:3], *DATUM, deg=False)
    np.testing.assert_allclose(Placing(DATUM).position(NAV), expected, atol=1e-6)


def test_geodetic_goes_back():
    placing = Placing(DATUM)
    np.testing.assert_allclose(placing.geodetic(placing.position(NAV)), NAV[:3], rtol=1e-11)


def test_directions_turn_with_the_way_they_lead():
    """A step north by the state's own axes is the difference of two positions in map."""
    placing = Placing(DATUM)
    north = pymap3d.enu2geodetic(0.0, 1.0, 0.0, *NAV[:3], deg=False)
    step = placing.position(np.array([*north, *NAV[3:]])) - placing.position(NAV)
    np.testing.assert_allclose(placing.rotation(NAV)[:, 1], step, atol=1e-6)


def test_velocity_attitude_and_covariance_are_turned(rng):
    placing = Placing(DATUM)
    root = rng.standard_normal((SIZE, SIZE))
    P = root @ root.T
    position, quaternion, velocity, covariance = placing.place(NAV, P)
    turn = placing.rotation(NAV)
    np.testing.assert_allclose(position, placing.position(NAV))
    np.testing.assert_allclose(velocity, turn @ NAV[3:6])
    np.testing.assert_allclose(so3.matrix_from_quat(quaternion), turn, atol=1e-12)
    np.testing.assert_allclose(covariance[:3, 3:6], turn @ P[:3, 3:6] @ turn.T)
    np.testing.assert_allclose(covariance[6:, 6:], P[6:9, 6:9])

"""The ellipsoid and its gravity against tabulated values, closed forms and pyins."""

import numpy as np
import pytest
from pyins import earth as reference
from scipy.integrate import quad

from track_localization.estimation import earth

# What the slope of gravity with height leaves out: second powers of the flattening (3.35e-3) and of
# the centrifugal ratio (3.45e-3), with factors that add up to three or so.
SECOND_POWERS = 4e-5
LATITUDES = np.deg2rad([-80.0, -33.0, 0.0, 10.0, 40.3458, 55.0, 89.0])


def test_curvature_radii_at_the_equator_and_the_pole():
    a, b = 6378137.0, 6356752.314245
    assert earth.curvature_radii(0.0) == pytest.approx((b * b / a, a), rel=1e-12)
    assert earth.curvature_radii(0.5 * np.pi) == pytest.approx((a * a / b, a * a / b), rel=1e-12)


def test_meridian_radius_adds_up_to_the_quarter_of_the_meridian():
    """Tabulated for WGS 84: 10 001 965.729 m from the equator to the pole."""
    quarter, _ = quad(lambda lat: earth.curvature_radii(lat)[0], 0.0, 0.5 * np.pi)
    assert quarter == pytest.approx(10001965.729, abs=1e-3)


def test_gravity_on_the_ellipsoid_is_the_tabulated_one():
    """NIMA TR8350.2 gives ten digits for the equator and the poles."""
    assert earth.gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-10)
    for pole in (-0.5, 0.5):
        assert earth.gravity(pole * np.pi, 0.0) == pytest.approx(9.8321849378, abs=2e-10)


@pytest.mark.parametrize('lat', LATITUDES)
@pytest.mark.parametrize('height', [-400.0, 0.0, 50.0, 1500.0, 5000.0, 9000.0])
def test_gravity_is_that_of_the_exact_potential(lat, height, normal_gravity):
    """Constants have ten digits; the slope's second powers and (h / a)^3 are left out."""
    part = abs(height) / 6378137.0
    left_out = 9.8 * (2.0 * SECOND_POWERS * part + 4.0 * part**3)
    exact = normal_gravity(lat, height)
    assert earth.gravity(lat, height) == pytest.approx(exact, abs=5e-10 + left_out)


@pytest.mark.parametrize('lat', LATITUDES)
@pytest.mark.parametrize('height', [0.0, 3000.0])
def test_gravity_slope_is_the_derivative(lat, height, normal_gravity):
    step = 100.0
    slope = (normal_gravity(lat, height + step) - normal_gravity(lat, height - step)) / (2 * step)
    assert earth.gravity_slope(lat, height) == pytest.approx(
        slope, rel=SECOND_POWERS + 12.0 * (height / 6378137.0) ** 2
    )


@pytest.mark.parametrize('lat', LATITUDES)
def test_frame_rates_are_those_of_pyins(lat):
    """Its axes are north, east, down."""
    nav = np.array([lat, 1.0, 850.0, 71.0, -43.0, 2.0, 0.0, 0.0, 0.0, 1.0])
    degrees = np.rad2deg(lat)
    found = np.empty(3)
    earth.earth_rate(lat, found)
    north, east, down = reference.rate_n(degrees)
    np.testing.assert_allclose(found, [east, north, -down], rtol=1e-13, atol=1e-20)
    earth.transport_rate(nav, found)
    curvature = reference.curvature_matrix(degrees, nav[2])
    north, east, down = curvature @ [nav[4], nav[3], -nav[5]]
    np.testing.assert_allclose(found, [east, north, -down], rtol=1e-12)

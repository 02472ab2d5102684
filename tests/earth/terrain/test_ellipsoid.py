"""Against ERFA's geodesy, which astropy carries."""

import math

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import EarthLocation

from startrack.earth.terrain import cartesian, geodetic
from startrack.earth.terrain.ellipsoid import angle

RANDOM = np.random.default_rng(1)
LONGITUDE = RANDOM.uniform(-np.pi, np.pi, 2000)
LATITUDE = RANDOM.uniform(-np.pi / 2, np.pi / 2, 2000)


@pytest.mark.parametrize("height", [-5e3, 0.0, 9e3, 6e5, 3.6e7])
def test_both_ways_agree_with_erfa(height):
    there = EarthLocation.from_geodetic(
        LONGITUDE * units.rad, LATITUDE * units.rad, height * units.m, "WGS84"
    )
    expected = np.stack([one.to_value(units.m) for one in there.geocentric], axis=-1)
    point = cartesian(LONGITUDE, LATITUDE, np.full(2000, height))
    np.testing.assert_allclose(point, expected, rtol=0, atol=3e-15 * (6.4e6 + height))
    longitude, latitude, above = geodetic(expected)
    bound = 1e-15 * (6.4e6 + height)
    assert np.abs(np.sin(longitude - LONGITUDE) * np.cos(LATITUDE)).max() * 6.4e6 < bound
    assert np.abs(latitude - LATITUDE).max() * 6.4e6 < bound
    assert np.abs(above - height).max() < bound


def test_poles_and_the_date_line():
    longitude, latitude, height = geodetic(
        np.array([[0.0, 0, 6356752.314245 + 100], [0, 0, -6356752.314245], [-6378137.0, 0, 0]])
    )
    np.testing.assert_allclose(latitude, [np.pi / 2, -np.pi / 2, 0], atol=1e-15)
    np.testing.assert_allclose(height, [100, 0, 0], atol=1e-6)
    assert longitude[2] == pytest.approx(np.pi)


def test_the_angle_without_branches_is_that_of_the_standard_library():
    """Over the circle, on its axes and diagonals, and at slopes of 1e-300 to 1e300."""
    turn = np.append(np.linspace(-np.pi, np.pi, 20001), np.arange(-8, 9) * np.pi / 8)
    pairs = [(math.sin(each), math.cos(each)) for each in turn]
    pairs += [(sign * 10.0**power, 1.0) for power in range(-300, 301, 7) for sign in (-1, 1)]
    pairs += [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)]
    found = np.array([angle(y, x) for y, x in pairs])
    expected = np.array([math.atan2(y, x) for y, x in pairs])
    assert np.abs(found - expected).max() < 5e-16

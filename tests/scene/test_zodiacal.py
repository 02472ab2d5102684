import numpy as np
import pytest

from startrack.core.units import arcsec, deg
from startrack.scene.background import OBLIQUITY, zodiacal, zodiacal_spectrum
from startrack.scene.photometry import GAIA_APERTURE, ZERO_POINT, passband


def ecliptic(longitude, latitude):
    """Unit vectors, ICRS axes, of ecliptic coordinates in degrees."""
    longitude, latitude = np.broadcast_arrays(np.radians(longitude), np.radians(latitude))
    x = np.cos(latitude) * np.cos(longitude)
    y = np.cos(latitude) * np.sin(longitude)
    z = np.sin(latitude)
    c, s = np.cos(OBLIQUITY), np.sin(OBLIQUITY)
    return np.stack([x, c * y - s * z, s * y + c * z], axis=-1).reshape(-1, 3)


SUN_LONGITUDE = 70.0
SUN = ecliptic(SUN_LONGITUDE, 0.0)[0]


@pytest.mark.parametrize(
    ("longitude", "latitude", "s10"),
    [(30, 0, 1940), (60, 0, 395), (90, 0, 202), (180, 0, 180), (0, 90, 60), (-90, 0, 202)],
)
def test_the_other_table_of_the_same_paper(longitude, latitude, s10):
    """Leinert et al. (1998), table 16, in S10 where the code carries table 17, in W/m^2/sr/um."""
    seen = zodiacal(ecliptic(SUN_LONGITUDE + longitude, latitude), SUN)
    assert seen[0] == pytest.approx(s10, rel=0.01)


def test_both_sides_of_the_ecliptic_and_of_the_sun_are_alike():
    a = zodiacal(ecliptic(SUN_LONGITUDE + 47, 33), SUN)
    for longitude, latitude in ((47, -33), (-47, 33), (-47, -33)):
        np.testing.assert_allclose(zodiacal(ecliptic(SUN_LONGITUDE + longitude, latitude), SUN), a)


def test_it_has_no_steps():
    """Across the table's inner edge and through its grid: no jump along finely sampled great
    circles."""
    for inclination in (0.0, 0.4, 1.0, np.pi / 2):
        away = np.radians(np.arange(2, 179, 0.01))
        line = ecliptic(
            SUN_LONGITUDE
            + np.degrees(np.arctan2(np.sin(away) * np.cos(inclination), np.cos(away))),
            np.degrees(np.arcsin(np.sin(away) * np.sin(inclination))),
        )
        brightness = np.log(zodiacal(line, SUN))
        assert np.abs(np.diff(brightness)).max() < 0.12  # at the seam, 15 degrees from the Sun
        assert np.median(np.abs(np.diff(brightness))) < 0.001
        assert brightness.argmax() < 100


def test_far_from_the_sun_there_is_less_dust():
    """Helios measured 2.3 as the exponent between 0.3 and 1 au (Leinert et al.

    1998, section 8.2).
    """
    line = ecliptic(SUN_LONGITUDE + 90, 10)
    assert zodiacal(line, SUN, 2.0) / zodiacal(line, SUN) == pytest.approx(2**-2.3)


def test_the_pole_of_the_ecliptic_in_magnitudes():
    """60 stars of V = 10 per square degree are V 23.34 per square arcsecond; G is 0.14 brighter.

    Its reddening makes it up to 0.1 mag brighter in G than sunlight would be.
    """
    photons = 60 * zodiacal_spectrum() @ passband("G") * GAIA_APERTURE * arcsec**2
    magnitude = ZERO_POINT["G"] - 2.5 * np.log10(photons)
    assert 10 - 2.5 * np.log10(60 / (deg / arcsec) ** 2) == pytest.approx(23.34, abs=0.01)
    assert 23.05 < magnitude < 23.25

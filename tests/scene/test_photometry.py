import numpy as np
import pytest

from startrack.core.units import arcsec
from startrack.core.values import Stars
from startrack.scene import WAVELENGTH, Scene, illuminate
from startrack.scene.photometry import (
    GAIA_APERTURE,
    ZERO_POINT,
    colour_temperature,
    passband,
    photon_irradiance,
)

TEMPERATURES = [3500, 4000, 5000, 5800, 7000, 9600, 10000, 20000]


@pytest.mark.parametrize("temperature", TEMPERATURES)
def test_photon_flux_of_blackbodies(oracle, temperature):
    """Against published integrated fluxes at V = 0, converted by G - V."""
    outside = oracle("photometry.json")["blackbody_V0_photons_s_m2"][str(temperature)]
    rate = photon_irradiance(np.array([outside["G_minus_V"]]), np.array([float(temperature)]))[0]
    band = (WAVELENGTH > 400e-9) & (WAVELENGTH < 800e-9)
    assert rate[band].sum() == pytest.approx(outside["400-800nm"], rel=1e-3)
    assert rate @ passband("G") == pytest.approx(outside["gaiaG_weighted"], rel=5e-4)


def test_gaia_counts_its_zero_point():
    rate = photon_irradiance(np.array([ZERO_POINT["G"]]), np.array([9600.0]))[0]
    assert GAIA_APERTURE * rate @ passband("G") == pytest.approx(1, rel=1e-12)


def test_five_magnitudes_are_a_factor_of_a_hundred():
    bright, faint = photon_irradiance(np.array([1.0, 6.0]), np.array([6000.0, 6000.0]))
    np.testing.assert_allclose(bright / faint, 100, rtol=1e-12)


def test_vega_has_no_colour_and_the_sun_has_its_own():
    """BP - RP of the Sun is 0.82 (Casagrande & VandenBerg 2018, MNRAS 479, L102)."""
    vega, sun = colour_temperature(np.array([0.0, 0.82]))
    assert 9500 < vega < 14000  # a blackbody has no Balmer jump and needs more heat
    assert sun == pytest.approx(5772, rel=0.05)


def test_extreme_and_unknown_colours():
    blue, red, unknown = colour_temperature(np.array([-5.0, 12.0, np.nan]))
    assert (blue, red, unknown) == (pytest.approx(50000), pytest.approx(1500), 5772.0)


def test_sky_of_one_square_arcsecond_is_a_star():
    star = Stars(np.zeros(1, int), np.array([[0, 0, 1.0]]), np.array([22.0]), np.array([np.nan]))
    light = illuminate(Scene(background_g=22.0), star)
    np.testing.assert_allclose(light.background * arcsec**2, light.photon_irradiance[0], rtol=1e-12)


def test_a_black_sky_and_no_stars():
    none = Stars(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    light = illuminate(Scene(background_g=None), none)
    assert light.photon_irradiance.shape == (0, len(WAVELENGTH))
    assert not light.background.any()

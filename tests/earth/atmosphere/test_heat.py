"""Thermal radiance of ground and air."""

import numpy as np
import pytest
from astropy import units as u
from astropy.modeling.physical_models import BlackBody

from startrack.core.units import deg, um
from startrack.earth.atmosphere import (
    Reach,
    SlantPath,
    heat_of,
    in_bands,
    load_table,
    planck,
    radiance,
    refine,
)
from startrack.io import shipped

STEFAN_BOLTZMANN = 5.670374419e-8  # W / m^2 / K^4, CODATA 2018


@pytest.mark.parametrize("temperature", [60.0, 300.0, 2500.0])
def test_planck_is_that_of_astropy(temperature):
    wavelength = np.geomspace(400 / temperature, 1e5 / temperature, 50) * um
    theirs = BlackBody(temperature * u.K, scale=1 * u.W / u.m**2 / u.sr / u.m)(wavelength * u.m)
    np.testing.assert_allclose(planck(wavelength, temperature), theirs.value, rtol=1e-6)


def test_all_wavelengths_give_stefan_and_boltzmann():
    spectrum = np.geomspace(0.5, 2000, 5000) * um
    temperature = np.array([200.0, 300.0, 800.0])
    heat = heat_of(spectrum, np.ones((1, len(spectrum))))(temperature)[:, 0]
    assert heat == pytest.approx(STEFAN_BOLTZMANN * temperature**4 / np.pi, rel=1e-4)


@pytest.mark.parametrize("bad", [0.0, -3.0, np.nan, 1e4])
def test_impossible_temperatures_are_refused(bad):
    heat = heat_of(np.linspace(3, 4, 20) * um, np.ones((1, 20)))
    with pytest.raises(ValueError, match=r"temperature must lie in \[50, 3000\] K"):
        heat(np.array([bad]))


def infrared():
    table = load_table(shipped("atmosphere/molecules.fits"))
    response = ((table.spectrum >= 3.4 * um) & (table.spectrum <= 3.95 * um))[None] * 1.0
    bands = in_bands(table, response, 600e3)
    fine = refine(bands, Reach((0.0, 0.0), (0.0, 60 * deg), (30 * deg, 31 * deg), (0.0, 0.1)))
    angles = np.linspace(0, 60, 7) * deg
    flat = np.ones(7)
    sight = SlantPath(0 * flat, angles, 30.5 * deg * flat, 0.05 * flat, 0.8 * flat, flat, flat)
    return fine, sight, heat_of(table.spectrum, response)


def test_air_and_black_ground_of_one_temperature_are_a_blackbody():
    fine, sight, heat = infrared()
    terms = radiance(fine, sight, np.zeros(1), np.zeros(1), heat, np.full(7, 290.0), 290.0)
    both = terms.emitted + terms.thermal
    np.testing.assert_allclose(both[:, 0], heat(np.array([290.0]))[0, 0], rtol=1e-6)


def test_a_hot_spot_outshines_the_sun():
    fine, sight, heat = infrared()
    hot = radiance(fine, sight, np.full(1, 0.2), np.full(1, 0.2), heat, np.full(7, 900.0))
    assert (hot.emitted > 30 * hot.direct).all()


def test_heat_needs_a_temperature():
    fine, sight, heat = infrared()
    with pytest.raises(TypeError, match="temperature must be given with heat"):
        radiance(fine, sight, np.zeros(1), np.zeros(1), heat)

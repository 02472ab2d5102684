"""The spectrum of the Sun against published irradiances of bands, and the solar constant."""

import numpy as np
import pytest

from startrack.core.units import nm, um
from startrack.earth.atmosphere import vacuum
from startrack.earth.atmosphere.spectra import sun_spectrum

# Central wavelength and width (nm) of the bands of Sentinel-2A, and their solar irradiance in
# W / m^2 / um, as the metadata of its products have it (ESA, Sentinel-2 User Handbook).
BANDS = {
    "B1": (442.7, 21, 1884.69),
    "B2": (492.4, 66, 1959.66),
    "B3": (559.8, 36, 1823.24),
    "B4": (664.6, 31, 1512.06),
    "B5": (704.1, 15, 1424.64),
    "B6": (740.5, 15, 1287.61),
    "B7": (782.8, 20, 1162.08),
    "B8": (832.8, 106, 1041.63),
    "B8A": (864.7, 21, 955.32),
    "B11": (1613.7, 91, 245.59),
    "B12": (2202.4, 175, 85.25),
}


@pytest.mark.parametrize("name", BANDS)
def test_the_bands_of_sentinel_2_have_their_published_irradiance(name):
    centre, width, published = BANDS[name]
    inside = np.linspace(centre - width / 2, centre + width / 2, 200) * nm
    assert sun_spectrum(inside).mean() * 1e-6 == pytest.approx(published, rel=0.005)


def test_all_of_it_is_the_solar_constant():
    """1361 W / m^2 (Kopp and Lean 2011), of which 1.0 % lies below 300 nm."""
    spectrum = vacuum().spectrum
    total = np.trapezoid(sun_spectrum(spectrum), spectrum)
    assert total == pytest.approx(0.99 * 1361, rel=0.01)


def test_coarse_cells_keep_the_energy():
    fine = np.linspace(0.35 * um, 2.3 * um, 20001)
    coarse = fine[::400]
    edges = np.concatenate([coarse[:1], (coarse[1:] + coarse[:-1]) / 2, coarse[-1:]])
    kept = (sun_spectrum(coarse) * np.diff(edges)).sum()
    assert kept == pytest.approx(np.trapezoid(sun_spectrum(fine), fine), rel=1e-5)


def test_wavelengths_outside_are_refused():
    with pytest.raises(ValueError, match="wavelength must lie in"):
        sun_spectrum(np.array([60.0, 70.0]) * um)

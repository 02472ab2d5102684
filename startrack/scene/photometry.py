"""Magnitude and colour into a photon spectrum: blackbodies through Gaia's passbands."""

from functools import lru_cache
from importlib.resources import files

import numpy as np

from startrack.core import (
    BOLTZMANN,
    LIGHT_SPEED,
    PLANCK,
    Curve,
    Floats,
    means_around,
    nm,
    quadrature,
)

BIN = 10 * nm
# Metre, centres of the bins that span Gaia's G band.
WAVELENGTH: Floats = np.arange(325.0, 1100.0, 10.0, dtype=np.float64) * nm
WAVELENGTH.flags.writeable = False

# Gaia EDR3, Vega system: Riello et al. (2021), A&A 649, A3, table 3 and section 5.
ZERO_POINT = {"G": 25.6874, "BP": 25.3385, "RP": 24.7479}  # magnitude of one electron per second
GAIA_APERTURE = 0.7278  # m^2

SUN = 5772.0  # K, IAU 2015 nominal effective temperature
SUN_G_MINUS_V = -0.14  # Casagrande & VandenBerg (2018), MNRAS 479, L102
UNKNOWN_COLOUR = SUN
COOLEST, HOTTEST = 1500.0, 50000.0  # K, limits to which a colour is clipped


def blackbody_photons(wavelength: Floats, temperature: Floats) -> Floats:
    """Photon radiance of a blackbody, up to a factor.

        N ~ wavelength**-4 / (exp(h c / (wavelength k T)) - 1)

    wavelength   (k,) metre
    temperature  (n,) kelvin
    Returns      (n, k)
    """
    exponent = PLANCK * LIGHT_SPEED / (BOLTZMANN * wavelength * np.asarray(temperature)[:, None])
    return (wavelength / 500e-9) ** -4 / np.expm1(exponent)


def photon_irradiance(magnitude_g: Floats, temperature: Floats) -> Floats:
    """Photons of stars in the bins of WAVELENGTH.

    The spectrum of a blackbody, scaled so that Gaia would count the electrons of its zero point:
    aperture * sum(irradiance * passband) = 10**(0.4 (zero point - G)).

    magnitude_g, temperature  (n,) mag, kelvin
    Returns                   (n, k) photon / s / m^2 in each bin
    Accuracy                  model: no lines or bands, some per cent for cool stars.
                              numerical: 2e-4, from bins of 10 nm.
    """
    shape = blackbody_photons(WAVELENGTH, temperature)
    at_gaia = 10 ** (0.4 * (ZERO_POINT["G"] - np.asarray(magnitude_g))) / GAIA_APERTURE
    return shape * (at_gaia / (shape @ passband("G")))[:, None]


def colour_temperature(colour: Floats) -> Floats:
    """Temperature of the blackbody with the colour BP - RP.

    colour   (n,) mag; NaN (unknown) is replaced by the Sun's
    Returns  (n,) kelvin, within [1500, 50000]
    """
    colours, temperatures = _colour_table()
    log_temperature = np.interp(colour, colours, np.log(temperatures))
    return np.where(np.isnan(colour), UNKNOWN_COLOUR, np.exp(log_temperature))


@lru_cache(maxsize=1)
def _colour_table() -> tuple[Floats, Floats]:
    """Colours BP - RP, rising, and their temperatures."""
    temperature = np.geomspace(HOTTEST, COOLEST, 400)
    shape = blackbody_photons(WAVELENGTH, temperature)
    blue, red = shape @ passband("BP"), shape @ passband("RP")
    colour = -2.5 * np.log10(blue / red) + ZERO_POINT["BP"] - ZERO_POINT["RP"]
    return colour, temperature


@lru_cache(maxsize=3)
def passband(band: str) -> Floats:
    """Mean response of Gaia's G, BP or RP in the bins of WAVELENGTH, per photon."""
    # Read as text, since speclite's own reader loads astropy's tables first, which takes 0.2 s.
    table = (files("speclite") / f"data/filters/gaiadr3-{band}.ecsv").read_text()
    rows = [line.split() for line in table.splitlines() if line[0].isdigit()]
    angstrom, response = np.array(rows, dtype=float).T
    return in_bins(Curve(tuple((angstrom * 1e-10).tolist()), tuple(response.tolist())))


@lru_cache(maxsize=64)
def in_bins(*curves: Curve) -> Floats:
    """Mean of a product of curves in the bins of WAVELENGTH, read-only; cached for the last 64.

    Its sum weighted by the photons in each bin is the integral between 320 and 1100 nm. It is exact
    for a spectrum that is linear between the middles of the bins.
    """
    mean = means_around(WAVELENGTH, curves)
    mean.flags.writeable = False
    return mean


OUTER = 200 * nm, 3000 * nm  # range in which light outside the bins is computed


@lru_cache(maxsize=64)
def outside_bins(*curves: Curve) -> float:
    """Fraction of a sunlike star's photons, after curves, outside the bins; cached for the last 64.

    It is zero if no curve depends on wavelength.
    """
    if not any(curve.wavelength for curve in curves):
        return 0.0
    ends = WAVELENGTH[0] - BIN / 2, WAVELENGTH[-1] + BIN / 2
    place, weight, cell = quadrature(np.array([OUTER[0], *ends, OUTER[1]]), curves)
    photons = weight * blackbody_photons(place, np.array([SUN]))[0]
    for curve in curves:
        photons *= curve(place)
    return float(photons[cell != 1].sum() / max(photons.sum(), 1e-300))

"""Transmittance of water vapour, ozone and mixed gases over air mass, and the Sun's spectrum."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from startrack.core import Floats, nm

GASES = ("water", "mixed", "ozone")

# Weak bands of water below 667 nm, of which Bird and Riordan have the one at 593 nm: absorption
# coefficients of SMARTS 2.9.5 (Gueymard 2001, Solar Energy 71, 325), means over 5 nm from 500 nm
# on, 1 / cm^POWER.
WEAK_FROM, WEAK_STEP, WEAK_TO = 500 * nm, 5 * nm, 667.6 * nm
WEAK_WATER = (
    0.00019, 0.00272, 0.00106, 0.00002, 0, 0, 0, 0, 0.00094, 0.00139, 0.00035, 0, 0, 0.00008,
    0.00298, 0.00209, 0.00041, 0.00123, 0.01896, 0.01462, 0.00441, 0.00015, 0, 0, 0, 0.00054,
    0.00259, 0.00164, 0.00081, 0.00512, 0.01399, 0.00853, 0.00312, 0.00051,
)  # fmt: skip
POWER = 0.9426  # of the column: lines overlap
# Pairs of colliding oxygen molecules, in bands without lines: wavelength (nm), peak (1e-46 cm^5),
# full width at half maximum (nm). After Greenblatt et al. (1990), J. Geophys. Res. 95, 18577;
# assumed, as recalled from there.
PAIRS = ((477.3, 6.3, 6.5), (532.2, 1.0, 10.0), (577.2, 11.0, 11.0), (630.0, 7.2, 14.0))
PAIR_COLUMN = 1.25e-3  # 1e46 / cm^5: the square of the number of O2, over the standard atmosphere


def transmittance(gas: str, wavelength: Floats, mass: Floats, water: float, ozone: float) -> Floats:
    """Transmittance of one gas over the air mass.

    gas         "water", "mixed" (oxygen, carbon dioxide) or "ozone"
    wavelength  (f,) metre
    mass        (m,) 1, air masses, 1 for the zenith
    water       kilogram / square metre
    ozone       metre at standard conditions
    Returns     (f, m) 1
    Raises      ModuleNotFoundError where pvlib is missing.
    Accuracy    model: Bird and Riordan (1986), J. Climate Appl. Meteorol. 25, 87, at 122
                wavelengths from 300 to 4000 nm, some 10 nm wide below 1 micrometre; weak bands
                of water as in SMARTS, and of pairs of oxygen as Gaussians, which are part of
                the mixed gases and thin out with height as slowly as those.
    """
    if gas == "ozone":  # Beer's law; pvlib would take the air mass from the Sun's position
        nodes, once = _column(gas, 1.0, water, ozone)
        return np.interp(wavelength, nodes, once)[:, None] ** mass
    columns = [_column(gas, float(one), water, ozone) for one in mass]
    nodes = columns[0][0]
    found = np.stack([np.interp(wavelength, nodes, values) for _, values in columns], -1)
    if gas == "mixed":
        return found * np.exp(-_pairs(wavelength)[:, None] * mass)
    weak = wavelength < WEAK_TO
    at = WEAK_FROM + WEAK_STEP * np.arange(-1, len(WEAK_WATER) + 1)
    depth = np.interp(wavelength[weak], at, [0.0, *WEAK_WATER, 0.0])
    found[weak] = np.exp(-depth[:, None] * (water / 10 * mass) ** POWER)
    return found


def _pairs(wavelength: Floats) -> Floats:
    """Optical depth (f,) of pairs of oxygen in the whole column."""
    away = wavelength[:, None] / nm - np.array([middle for middle, _, _ in PAIRS])
    peak, width = np.array([each[1:] for each in PAIRS]).T
    return np.asarray(np.exp(-4 * np.log(2) * (away / width) ** 2) @ peak) * PAIR_COLUMN


def sunlight(wavelength: Floats) -> Floats:
    """The Sun's irradiance at one astronomical unit.

    wavelength  (f,) metre, between 280 and 4000 nm
    Returns     (f,) watt / m^2 / m
    Raises      ModuleNotFoundError where pvlib is missing.
    Accuracy    model: the extraterrestrial spectrum of ASTM G173-03, in steps of 0.5 to 5 nm.
    """
    spectra = _pvlib().get_reference_spectra()["extraterrestrial"]
    return np.interp(wavelength, spectra.index.to_numpy() * nm, spectra.to_numpy() / nm)


def _column(gas: str, mass: float, water: float, ozone: float) -> tuple[Floats, Floats]:
    """Wavelengths and transmittances at one air mass, from a beam with and without the gas."""
    with_gas = {
        "water": (water / 10, 0.0, mass),  # pvlib takes centimetre of water and of ozone
        "ozone": (0.0, ozone * 100, mass),
        "mixed": (0.0, 0.0, mass),
    }[gas]
    wavelength, beam = _beam(*with_gas)
    if gas == "mixed":
        # The rest is Rayleigh scattering as Bird and Riordan write it, their eq. 2-4.
        micron = wavelength / 1e-6
        clear = np.exp(-mass / (micron**4 * (115.6406 - 1.335 / micron**2)))
    else:
        clear = _beam(0.0, 0.0, mass)[1]
    return wavelength, beam / clear


def _beam(water: float, ozone: float, mass: float) -> tuple[Floats, Floats]:
    """Direct transmittance of air without aerosol."""
    spectrum = _pvlib().spectrl2(
        apparent_zenith=0.0,
        aoi=0.0,
        surface_tilt=0.0,
        ground_albedo=0.0,
        surface_pressure=101325.0,
        relative_airmass=mass,
        precipitable_water=water,
        ozone=ozone,
        aerosol_turbidity_500nm=0.0,
        dayofyear=1,
    )
    fraction = np.squeeze(spectrum["dni"]) / np.squeeze(spectrum["dni_extra"])
    return spectrum["wavelength"] * nm, fraction


def _pvlib() -> Any:
    try:
        return importlib.import_module("pvlib").spectrum
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            "new tables of the air need pvlib: python -m pip install 'startrack[earth]'"
        ) from missing

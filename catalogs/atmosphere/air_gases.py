"""Transmittance of water vapour, ozone and mixed gases, for new tables of the air."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from startrack.core import Floats, nm
from startrack.earth.atmosphere.gases import water_depth, water_spectrum

GASES = ("water", "mixed", "ozone")

WATER_TO = 2210 * nm  # beyond, Bird and Riordan's water stands for methane, too
# Pairs of colliding oxygen molecules, in bands without lines: wavelength (nm), peak (1e-46 cm^5),
# full width at half maximum (nm). Greenblatt et al. (1990), J. Geophys. Res. 95, 18577, as SMARTS
# 2.9.5 has them.
PAIRS = ((477.0, 6.5, 5.5), (532.0, 1.4, 12.4), (577.0, 12.5, 10.6), (630.0, 7.2, 14.7))
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
    Accuracy    model: water as in SMARTS 2.9.5 (Gueymard 2001) in steps of 1 nm to 1 micrometre and
                5 nm to 2.21; all else by Bird and Riordan (1986), J. Climate Appl. Meteorol. 25,
                87, at 122 wavelengths from 300 to 4000 nm, some 10 nm wide below 1 micrometre;
                pairs of oxygen as Gaussians, which are part of the mixed gases and thin out with
                height as slowly as those.
    """
    if gas == "ozone":  # Beer's law; pvlib would take the air mass from the Sun's position
        nodes, once = _column(gas, 1.0, water, ozone)
        return np.interp(wavelength, nodes, once)[:, None] ** mass
    columns = [_column(gas, float(air_mass), water, ozone) for air_mass in mass]
    nodes = columns[0][0]
    transmitted = np.stack([np.interp(wavelength, nodes, values) for _, values in columns], -1)
    if gas == "mixed":
        return transmitted * np.exp(-_pairs(wavelength)[:, None] * mass)
    spectrum = water_spectrum()
    known = (wavelength >= spectrum[0]) & (wavelength <= spectrum[-1])
    transmitted[known] = np.exp(-water_depth(wavelength[known], mass, water))
    transmitted[wavelength < spectrum[0]] = 1.0
    return transmitted


def _pairs(wavelength: Floats) -> Floats:
    """Optical depth (f,) of pairs of oxygen in the whole column."""
    away = wavelength[:, None] / nm - np.array([middle for middle, _, _ in PAIRS])
    peak, width = np.array([pair[1:] for pair in PAIRS]).T
    return np.asarray(np.exp(-4 * np.log(2) * (away / width) ** 2) @ peak) * PAIR_COLUMN


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

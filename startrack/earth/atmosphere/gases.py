"""Columns of water vapour and ozone -> their transmittance, in a table of the air."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from startrack.core import Floats
from startrack.earth.atmosphere.table import AirTable
from startrack.io import checked_arrays, shipped

POWER = 0.9426  # power of the column of water, for overlapping lines
FORMAT = 1  # of the table of water
LEAST = 1e-12  # transmittance


def with_gases(table: AirTable, water: float, ozone: float) -> AirTable:
    """The table with other columns of water vapour and ozone, otherwise unchanged.

    water     kilogram / square metre
    ozone     metre at standard conditions
    Accuracy  model: ozone by Beer's law; water to 2.21 micrometre as in SMARTS 2.9.5, beyond by
              Bird and Riordan's law: the worst difference from tables built for the column is 0.01
              up to 2.5 micrometre, 0.2 in the opaque bands beyond. Profiles over height stay
              unchanged; pressure and temperature change scattering by molecules by less than 1 %.
    """
    old_water, old_ozone = table.air.columns
    gas = table.gas.copy()
    if water != old_water:
        gas[0] = _other_water(table, water / old_water)
        spectrum = water_spectrum()
        known = (table.spectrum >= spectrum[0]) & (table.spectrum <= spectrum[-1])
        gas[0][known] = np.exp(-water_depth(table.spectrum[known], table.mass, water))
    if ozone != old_ozone:
        gas[2] = gas[2] ** (ozone / old_ozone)
    return replace(table, air=replace(table.air, water=water, ozone=ozone), gas=gas)


def _other_water(table: AirTable, ratio: float) -> Floats:
    """Transmittance (f, m) with `ratio` times the water column, by the law of Bird and Riordan.

    depth = 0.2385 x / (1 + 20.07 x)^0.45, x is proportional to water and air mass; eq. 2-8
    """
    amount = np.geomspace(1e-9, 1e6, 1500)
    depth = 0.2385 * amount / (1 + 20.07 * amount) ** 0.45
    used = table.mass > 0
    mass = table.mass[used]
    known = -np.log(np.clip(table.gas[0][:, used], LEAST, 1.0))
    per_mass = np.interp(known, depth, amount, left=0.0) / mass
    seen = known < -math.log(LEAST)  # beyond, the table does not depend on the amount
    per_mass = np.where(seen, per_mass, per_mass[:, :1])
    place = np.interp(
        np.log(np.maximum(table.mass * ratio, mass[0])), np.log(mass), range(len(mass))
    )
    low = np.minimum(place.astype(int), len(mass) - 2)
    between = per_mass[:, low] * (1 - place + low) + per_mass[:, low + 1] * (place - low)
    other = between * table.mass * ratio
    return np.asarray(np.exp(-0.2385 * other / (1 + 20.07 * other) ** 0.45))


def water_spectrum() -> Floats:
    """Wavelengths (w,) of the table of water vapour, metre."""
    return _water_table()[0]


def water_depth(wavelength: Floats, mass: Floats, water: float) -> Floats:
    """Optical depth of water vapour as in SMARTS 2.9.5 (Gueymard 2001).

    wavelength  (f,) metre, within `water_spectrum`
    mass        (m,) 1, air masses
    water       kilogram / square metre
    Returns     (f, m) 1
    """
    spectrum, nodes, amounts, table = _water_table()
    seen = RegularGridInterpolator((np.log(amounts), spectrum, nodes), table)
    column = np.log(np.clip(water, amounts[0], amounts[-1]))
    at = np.meshgrid(column, wavelength, np.clip(mass, 0, nodes[-1]), indexing="ij")
    return np.asarray(seen(np.stack(at, -1))[0] * (water / 10 * mass) ** POWER)


@lru_cache(maxsize=1)
def _water_table() -> tuple[Floats, ...]:
    """Wavelengths, air masses, columns, and (c, f, m) optical depth over (column mass)^POWER."""
    path = shipped("atmosphere/water.fits")
    names = ("WAVELENGTH", "MASS", "COLUMN", "DEPTH")
    return checked_arrays(path, "WATER", FORMAT, "a table of water vapour", names)

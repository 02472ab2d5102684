"""AirTable: radiance and transmission over wavelength and geometry, and its file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Unit, non_negative, one_of, within
from startrack.io import open_checked

AEROSOLS = ("none", "rural", "urban")


@dataclass(frozen=True)
class Air:
    """One state of the atmosphere; the defaults are a clear day in mid-latitude summer.

    aerosol     type of Shettle and Fenn (1979) below 100 km, or "none" for molecules alone
    visibility  metre, meteorological range at the ground: where contrast falls to 2 %
    water       kilogram / square metre of water vapour above the sea
    ozone       metre of pure ozone at standard conditions; 1e-5 m is a Dobson unit
    """

    aerosol: str = "rural"
    visibility: Annotated[float, Unit("m", "km")] = 23e3
    water: Annotated[float, Unit("kg / m2")] = 29.2
    ozone: Annotated[float, Unit("m", "mm")] = 3.32e-3

    def __post_init__(self) -> None:
        one_of(AEROSOLS, aerosol=self.aerosol)
        within(2e3, 150e3, visibility=self.visibility)
        non_negative(water=self.water, ozone=self.ozone)


FORMAT = 1  # of the file
AXES = ("wavelength", "height", "altitude", "sensor", "sun", "azimuth")


@dataclass(frozen=True, eq=False)
class AirTable:
    """Radiation in plane layers over a Lambert surface; absorption by gases is kept apart.

    air          its state
    wavelength   (k,) metre, nodes of scattering, which is smooth between them
    height       (h,) metre of the ground above the sea
    altitude     (a,) metre of the sensor above the ground; the last one is above the air
    sensor       (v,) radian, zenith angle of the sensor
    sun          (s,) radian, zenith angle of the Sun
    azimuth      (p,) radian, between Sun and sensor as the ground sees them; 0 for the same side
    path         (k, h, a, v, s, p) 1 / sr, radiance of the air over a black ground, over the
                 Sun's irradiance
    beam         (k, h, s) 1, direct transmittance of sunlight to the ground
    skylight     (k, h, s) 1, irradiance of the sky over a black ground, over the Sun's
    seen         (k, h, a, v) 1, direct transmittance from ground to sensor
    around       (k, h, a, v) 1, diffuse transmittance, of light from the ground around
    backscatter  (k, h) 1, spherical albedo of the air from below
    spectrum     (f,) metre
    irradiance   (f,) watt / m^2 / m, the Sun's at one astronomical unit
    mass         (m,) 1, air masses
    gas          (3, f, m) 1, transmittance of water, mixed gases and ozone of the whole column
    """

    air: Air
    wavelength: Floats
    height: Floats
    altitude: Floats
    sensor: Floats
    sun: Floats
    azimuth: Floats
    path: Floats
    beam: Floats
    skylight: Floats
    seen: Floats
    around: Floats
    backscatter: Floats
    spectrum: Floats
    irradiance: Floats
    mass: Floats
    gas: Floats


ARRAYS = tuple(field.name for field in fields(AirTable) if field.name != "air")


def save_table(path: Path, table: AirTable) -> None:
    """Write a table as FITS in single precision, with checksums; `path` is written by name.

    Raises  OSError where it cannot be written.
    """
    from astropy.io import fits

    first = fits.PrimaryHDU()
    first.header["TABLE"] = (FORMAT, "format of this table of the air")
    first.header["AEROSOL"] = table.air.aerosol
    first.header["VISIBIL"] = (table.air.visibility, "[m] at the ground")
    first.header["WATER"] = (table.air.water, "[kg / m2]")
    first.header["OZONE"] = (table.air.ozone, "[m] at standard conditions")
    parts = [fits.ImageHDU(_kept(name, getattr(table, name)), name=name) for name in ARRAYS]
    fits.HDUList([first, *parts]).writeto(path, checksum=True)


def load_table(path: Path) -> AirTable:
    """Read a table.

    Raises  FileNotFoundError; ValueError where the file is no table of the air, of another format,
            or damaged (its checksums do not fit).
    """
    with open_checked(path, "TABLE", FORMAT, "a table of the air") as parts:
        head = parts[0].header
        air = Air(head["AEROSOL"], head["VISIBIL"], head["WATER"], head["OZONE"])
        arrays = {name: parts[name].data.astype(np.float64) for name in ARRAYS}
    return AirTable(air, **arrays)


def _kept(name: str, values: Floats) -> NDArray[np.generic]:
    """Axes in double precision, large arrays in single."""
    return values if values.ndim == 1 else values.astype(np.float32)

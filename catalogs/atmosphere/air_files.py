"""Tables of the air -> FITS files with checksums, which startrack reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from startrack.earth.atmosphere import AirTable, InfraredTable, infrared
from startrack.earth.atmosphere import table as air_tables
from startrack.scene import air_above, dusk
from startrack.scene import limb as limbs


def save_checked(path: Path, cards: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Write arrays, by their names, as parts of a FITS file with checksums.

    Axes keep their precision, arrays of more dimensions are written in single.

    cards  of the first header, that of the format among them: values, or (value, comment)
    """
    from astropy.io import fits

    first = fits.PrimaryHDU()
    first.header.update(cards)
    parts = [
        fits.ImageHDU(values if values.ndim == 1 else values.astype(np.float32), name=name)
        for name, values in arrays.items()
    ]
    fits.HDUList([first, *parts]).writeto(path, checksum=True)


def save_table(path: Path, table: AirTable) -> None:
    """Write a table as FITS in single precision, with checksums; `path` is written by name.

    Raises  OSError where it cannot be written.
    """
    cards = {
        "TABLE": (air_tables.FORMAT, "format of this table of the air"),
        "AEROSOL": table.air.aerosol,
        "VISIBIL": (table.air.visibility, "[m] at the ground"),
        "WATER": (table.air.columns[0], "[kg / m2]"),
        "OZONE": (table.air.columns[1], "[m] at standard conditions"),
    }
    save_checked(path, cards, {name: getattr(table, name) for name in air_tables.ARRAYS})


def save_infrared(path: Path, table: InfraredTable) -> None:
    """Write a table as FITS in single precision, with checksums; `path` is written by name."""
    cards = {"INFRARED": (infrared.FORMAT, "format of this table of the air")}
    save_checked(path, cards, {name: getattr(table, name) for name in infrared.ARRAYS})


def save_limb(path: Path, limb: limbs.Limb) -> None:
    """Write it as FITS with checksums, radiance in single precision."""
    from astropy.io import fits

    first = fits.PrimaryHDU(limb.radiance.astype(np.float32))
    first.header["LIMB"] = (limbs.FORMAT, "format of this table of the limb")
    first.header["ALBEDO"] = limb.albedo
    axes = [fits.ImageHDU(getattr(limb, name), name=name) for name in limbs.AXES]
    fits.HDUList([first, *axes]).writeto(path, checksum=True)


def save_sky(path: Path, table: air_above.SkyTable) -> None:
    """Write a table as FITS in single precision, with checksums; `path` is written by name."""
    cards = {"SKY": (air_above.FORMAT, "format of this table of the sky")}
    save_checked(path, cards, {name: getattr(table, name) for name in air_above.ARRAYS})


def save_dusk(path: Path, table: dusk.DuskTable) -> None:
    """Write a table as FITS in single precision, with checksums; `path` is written by name."""
    cards = {"DUSK": (dusk.FORMAT, "format of this table of twilight")}
    save_checked(path, cards, {name: getattr(table, name) for name in dusk.ARRAYS})

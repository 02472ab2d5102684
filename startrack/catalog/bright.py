"""The shipped FITS file enters; its Catalog leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from startrack.catalog.assemble import assemble
from startrack.catalog.catalog import Catalog
from startrack.catalog.fits_table import fits_table

# Bits of the column FLAGS. Neither of a pair set: unknown.
GAIA_MOTION, HIPPARCOS_MOTION = 1, 2
MEASURED_COLOUR, ESTIMATED_COLOUR = 4, 8
HIPPARCOS_ENTRY = 16

COLUMNS = (
    "identifier",
    "ra",
    "dec",
    "pm_ra_cosdec",
    "pm_dec",
    "parallax",
    "g",
    "bp_rp",
    "flags",
)
LIMIT_G = 8.0


def read_bright(path: Path) -> Catalog:
    """Read `catalogs/stars/bright.fits`: stars to G = 8, described in the README beside it.

    Errors  ValueError for a file that is cut, damaged, or of another layout.
    """
    header, columns = fits_table(path)
    if missing := [name for name in COLUMNS if name not in columns]:
        raise ValueError(f"{path} must have the column {missing[0]}, got {', '.join(columns)}")
    known = (columns["flags"] & (GAIA_MOTION | HIPPARCOS_MOTION)) > 0
    return assemble(
        path,
        float(header["EPOCH"]),
        columns["identifier"],
        columns["ra"],
        columns["dec"],
        np.where(known, columns["pm_ra_cosdec"], np.nan),
        np.where(known, columns["pm_dec"], np.nan),
        columns["parallax"],
        columns["g"],
        columns["bp_rp"],
    )

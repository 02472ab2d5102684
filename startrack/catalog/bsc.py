"""The Bright Star Catalogue, 5th edition (Hoffleit & Warren 1991), enters; a Catalog leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from startrack.catalog.assemble import assemble
from startrack.catalog.catalog import Catalog
from startrack.catalog.colour import g_from_johnson
from startrack.catalog.records import Records, fixed_width
from startrack.catalog.sexagesimal import degrees

# CDS V/50, catalog: first and last byte, from 1. Position and motion are J2000, FK5, which is
# ICRS to 0.05 arcsec.
FIELDS = {
    "HR": (1, 4), "RA": (76, 83), "DE": (84, 90), "Vmag": (103, 107), "B-V": (110, 114),
    "pmRA": (149, 154), "pmDE": (155, 160), "Parallax": (162, 166),
}  # fmt: skip


def read_bsc(path: Path) -> Catalog:
    """Read the Bright Star Catalogue's file `catalog` (or ybsc5): the identifier is HR.

    Positions are printed to 0.1 s and 1 arcsec. The 14 entries that are novae, clusters or
    galaxies have no position in it, and are left out.

    Errors  ValueError for a file that is empty, cut, or of another format.
    """
    records = _stars(fixed_width(path, FIELDS, 107, 197))
    magnitude, colour = g_from_johnson(records.numbers("Vmag"), records.numbers("B-V"))
    return assemble(
        path,
        2000.0,
        records.integers("HR"),
        15 * degrees(records, "RA", (2, 4)),
        degrees(records, "DE", (3, 5)),
        1000 * records.numbers("pmRA"),
        1000 * records.numbers("pmDE"),
        1000 * records.numbers("Parallax"),
        magnitude,
        colour,
        records.line,
    )


def _stars(records: Records) -> Records:
    keep = [bool(text.strip()) for text in records.columns["RA"]]
    columns = {
        name: [text for text, star in zip(column, keep, strict=True) if star]
        for name, column in records.columns.items()
    }
    return Records(records.path, columns, list(np.array(records.line)[keep]))

"""The Hipparcos catalogues (ESA 1997, van Leeuwen 2007) enter; a Catalog leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from startrack.catalog.assemble import assemble
from startrack.catalog.catalog import Catalog
from startrack.catalog.colour import g_from_hipparcos
from startrack.catalog.records import Records, fixed_width, separated
from startrack.catalog.sexagesimal import degrees
from startrack.units import deg
from startrack.values import Floats

EPOCH = 1991.25

# CDS I/239, hip_main.dat: places between the bars, from 0.
MAIN = {
    "HIP": 1, "RAhms": 3, "DEdms": 4, "RAdeg": 8, "DEdeg": 9, "Plx": 11, "pmRA": 12, "pmDE": 13,
    "V-I": 40, "Hpmag": 44, "Vmag": 5,
}  # fmt: skip
# CDS I/311, hip2.dat: first and last byte, from 1.
NEW = {
    "HIP": (1, 6), "RArad": (16, 28), "DErad": (30, 42), "Plx": (44, 50), "pmRA": (52, 59),
    "pmDE": (61, 68), "Hpmag": (130, 136), "V-I": (166, 171),
}  # fmt: skip


def read_hipparcos(path: Path) -> Catalog:
    """Read hip_main.dat of the Hipparcos catalogue (ESA 1997, CDS I/239); identifier -HIP.

    Errors  ValueError for a file that is empty, cut, or of another format. 263 stars have no
            astrometric solution: they keep their position to 1 arcsec, without motion.
    """
    records = separated(path, MAIN, 78, 450)
    ra, dec = records.numbers("RAdeg"), records.numbers("DEdeg")
    unsolved = np.isnan(ra) | np.isnan(dec)
    rough_ra, rough_dec = degrees(records, "RAhms"), degrees(records, "DEdms")
    ra = np.where(unsolved, 15 * rough_ra, ra)
    dec = np.where(unsolved, rough_dec, dec)
    hp = records.numbers("Hpmag")
    hp = np.where(np.isnan(hp), records.numbers("Vmag"), hp)  # 14 stars; they differ by 0.1 mag
    return _catalog(records, ra, dec, hp)


def read_hipparcos2(path: Path) -> Catalog:
    """Read hip2.dat of the new reduction (van Leeuwen 2007, CDS I/311); identifier -HIP.

    Errors  ValueError for a file that is empty, cut, or of another format.
    """
    records = fixed_width(path, NEW, 171, 276)
    ra, dec = records.numbers("RArad") / deg, records.numbers("DErad") / deg
    return _catalog(records, ra, dec, records.numbers("Hpmag"))


def _catalog(records: Records, ra_deg: Floats, dec_deg: Floats, hp: Floats) -> Catalog:
    magnitude, colour = g_from_hipparcos(hp, records.numbers("V-I"))
    return assemble(
        records.path,
        EPOCH,
        -records.integers("HIP"),
        ra_deg,
        dec_deg,
        records.numbers("pmRA"),
        records.numbers("pmDE"),
        records.numbers("Plx"),
        magnitude,
        colour,
        records.line,
    )

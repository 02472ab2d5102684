"""The Tycho-2 catalogue (Hog et al. 2000) enters; a Catalog leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from startrack.catalog.assemble import assemble
from startrack.catalog.catalog import Catalog
from startrack.catalog.colour import g_from_tycho
from startrack.catalog.records import Records, separated
from startrack.values import Ints

# CDS I/259, tyc2.dat and its parts (on the CD: catalog.dat): places between the bars, from 0.
FIELDS = {
    "TYC": 0, "RAmdeg": 2, "DEmdeg": 3, "pmRA": 4, "pmDE": 5, "BTmag": 17, "VTmag": 19,
    "RAdeg": 24, "DEdeg": 25,
}  # fmt: skip


def read_tycho2(path: Path) -> Catalog:
    """Read tyc2.dat, whole or in parts: mean positions at J2000.0.

    The identifier is TYC1 * 10^6 + TYC2 * 10 + TYC3, for one Hipparcos number may stand at
    several stars. The 4 % of stars without a mean position keep the one observed in about 1991,
    without motion. Parallaxes are not in this catalogue.

    Errors  ValueError for a file that is empty, cut, or of another format. The whole catalogue,
            2.5 million stars, takes half a minute and 2.5 GB. Stars brighter than
            V = 2 or so are not in it: they are in suppl_1.dat.
    """
    records = separated(path, FIELDS, 32, 206)
    mean_ra, mean_dec = records.numbers("RAmdeg"), records.numbers("DEmdeg")
    mean = np.isfinite(mean_ra) & np.isfinite(mean_dec)
    bt, vt = records.numbers("BTmag"), records.numbers("VTmag")
    vt = np.where(np.isnan(vt), bt, vt)
    magnitude, colour = g_from_tycho(vt, bt - records.numbers("VTmag"))
    return assemble(
        path,
        2000.0,
        _identifier(records),
        np.where(mean, mean_ra, records.numbers("RAdeg")),
        np.where(mean, mean_dec, records.numbers("DEdeg")),
        records.numbers("pmRA"),
        records.numbers("pmDE"),
        np.full(len(mean), np.nan),
        magnitude,
        colour,
        records.line,
    )


def _identifier(records: Records) -> Ints:
    parts = [text.split() for text in records.columns["TYC"]]
    for line, part in zip(records.line, parts, strict=True):
        if len(part) != 3 or not all(number.isdigit() for number in part):
            raise ValueError(
                f"{records.path}, line {line}: TYC must be three numbers, got {' '.join(part)!r}"
            )
    region, number, component = np.array(parts, np.int64).T
    return region * 1_000_000 + number * 10 + component

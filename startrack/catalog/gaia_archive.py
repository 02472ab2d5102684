"""A download from the Gaia archive (CSV, ECSV, FITS or VOTable) enters; a Catalog leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from startrack.catalog.assemble import assemble
from startrack.catalog.catalog import Catalog
from startrack.catalog.delimited import csv_table, numbers
from startrack.catalog.fits_table import fits_table
from startrack.catalog.votable import votable

NEEDED = ("source_id", "ra", "dec", "phot_g_mean_mag")


def read_gaia_archive(path: Path) -> Catalog:
    """Read rows of gaia_source with at least source_id, ra, dec and phot_g_mean_mag.

    Taken if they are there: pmra, pmdec, parallax, bp_rp (or phot_bp_mean_mag and
    phot_rp_mean_mag), and ref_epoch, which is 2016.0 otherwise.

    Errors  ValueError for a file that is empty, cut, of another format, or of several epochs.
    """
    table = _table(path)
    table.rename_columns(table.colnames, [name.lower() for name in table.colnames])
    for name in NEEDED:
        if name not in table.colnames:
            raise ValueError(f"{path} must have the column {name}, got {', '.join(table.colnames)}")
    if len(table) == 0:
        raise ValueError(f"{path} must hold stars, got none")
    colour = numbers(path, table, "bp_rp")
    if "bp_rp" not in table.colnames:
        blue, red = (numbers(path, table, f"phot_{band}_mean_mag") for band in ("bp", "rp"))
        colour = blue - red
    if table["source_id"].dtype.kind not in "iu":  # as a float it would lose its last digits
        raise ValueError(f"{path}: source_id must be whole numbers, got {table['source_id'][0]!r}")
    return assemble(
        path,
        _epoch(path, table),
        np.asarray(table["source_id"], np.int64),
        numbers(path, table, "ra"),
        numbers(path, table, "dec"),
        numbers(path, table, "pmra"),
        numbers(path, table, "pmdec"),
        numbers(path, table, "parallax"),
        numbers(path, table, "phot_g_mean_mag"),
        colour,
    )


def _table(path: Path) -> Any:
    from astropy.table import Table

    start = path.read_bytes()[:200]
    if start.startswith(b"SIMPLE"):
        return Table(fits_table(path)[1])
    if start.lstrip().startswith(b"<"):
        return votable(path)
    return csv_table(path)


def _epoch(path: Path, table: Any) -> float:
    epochs = np.unique(numbers(path, table, "ref_epoch"))
    if len(epochs) > 1:
        raise ValueError(f"{path}: ref_epoch must be the same in all rows, got {epochs[:3]}")
    return 2016.0 if np.isnan(epochs[0]) else float(epochs[0])

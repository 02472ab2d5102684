"""The HYG database's CSV file enters; a Catalog leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from startrack.catalog.assemble import assemble
from startrack.catalog.catalog import Catalog
from startrack.catalog.colour import g_from_johnson
from startrack.catalog.delimited import csv_table, numbers

UNKNOWN_DISTANCE = 1e5  # parsec; HYG puts this where the parallax is missing or negative


def read_hyg(path: Path) -> Catalog:
    """Read the HYG database, versions 2 to 4 (astronexus.com): J2000.0.

    The identifier is minus the Hipparcos number, or HYG's own `id` where there is none. The Sun,
    which is in it, is left out.

    Errors  ValueError for a file that is empty, cut, or of another format.
    """
    table = csv_table(path)
    table.rename_columns(table.colnames, [name.lower() for name in table.colnames])
    for name in ("id", "hip", "ra", "dec", "mag", "dist"):
        if name not in table.colnames:
            raise ValueError(f"{path} must have the column {name}, got {', '.join(table.colnames)}")
    line = np.arange(2, len(table) + 2)
    stars = numbers(path, table, "mag") > -20
    table, line = table[stars], line[stars]
    hip, number = numbers(path, table, "hip"), numbers(path, table, "id")
    identifier = np.where(hip > 0, -hip, number).astype(np.int64)
    distance = numbers(path, table, "dist")
    known = (distance > 0) & (distance < UNKNOWN_DISTANCE)
    magnitude, colour = g_from_johnson(numbers(path, table, "mag"), numbers(path, table, "ci"))
    return assemble(
        path,
        2000.0,
        identifier,
        15 * numbers(path, table, "ra"),
        numbers(path, table, "dec"),
        numbers(path, table, "pmra"),
        numbers(path, table, "pmdec"),
        np.divide(1000.0, distance, out=np.full(len(distance), np.nan), where=known),
        magnitude,
        colour,
        line.tolist(),
    )

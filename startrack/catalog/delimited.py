"""A CSV file with a heading enters; an astropy table leaves, or one sentence that refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from startrack.catalog.records import content
from startrack.values import Floats


def csv_table(path: Path) -> Any:
    """Read a CSV file, plain or gzipped, or an ECSV file.

    Errors  ValueError for a file that is empty, cut, or whose rows differ in length.
    """
    from astropy.io import ascii

    text = content(path)
    if not text.endswith("\n"):
        raise ValueError(
            f"{path}, line {len(text.splitlines())}: the last line must end, got "
            f"{text.splitlines()[-1][-20:]!r} and no end of line: the file is cut"
        )
    # Not "csv", which would fill up rows that are too short.
    kind = "ecsv" if text.startswith("# %ECSV") else "basic"
    options = (
        {} if kind == "ecsv" else {"delimiter": ",", "fill_values": [("", "0"), ("null", "0")]}
    )
    try:
        return ascii.read(text, format=kind, guess=False, **options)
    except (ValueError, ascii.InconsistentTableError) as error:
        reason = str(error).strip().splitlines()[0]
        raise ValueError(f"{path} must be a table of comma-separated rows, got: {reason}") from None


def numbers(path: Path, table: Any, name: str) -> Floats:
    """A column of a table as numbers, NaN where it is masked or the table has no such column.

    Errors  ValueError where the column does not hold numbers.
    """
    if name not in table.colnames:
        return np.full(len(table), np.nan)
    column = table[name]
    try:
        return np.asarray(np.ma.filled(np.ma.asarray(column).astype(float), np.nan))
    except ValueError:
        raise ValueError(f"{path}: {name} must be numbers, got {column[0]!r} and others") from None

"""A FITS file enters; its first table leaves, or one sentence that refuses."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any


def fits_table(path: Path) -> tuple[Any, dict[str, Any]]:
    """The first table of a FITS file, checked against its checksums if it has some.

    path     the file
    Returns  its header, and its columns by name in lower case, in the machine's byte order
    Errors   ValueError for a file that is cut, damaged, or has no table.
    """
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyWarning

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", AstropyWarning)  # astropy only warns of a cut file
            with path.open("rb") as raw, fits.open(raw, checksum=True, memmap=False) as file:
                tables = [unit for unit in file if isinstance(unit, fits.BinTableHDU)]
                if not tables:
                    raise ValueError("it has no table")
                header, data = tables[0].header, tables[0].data
                columns = {
                    name.lower(): data[name].astype(data[name].dtype.newbyteorder("="))
                    for name in data.names
                }
    except (OSError, ValueError, TypeError, AstropyWarning) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ValueError(f"{path} must be a whole FITS table, got: {reason}") from None
    return header, columns

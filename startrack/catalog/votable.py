"""A VOTable file enters; its first table leaves, or one sentence that refuses."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

NROWS = re.compile(rb"<TABLE\b[^>]*\bnrows=[\"'](\d+)")


def votable(path: Path) -> Any:
    """The first table of a VOTable file.

    path     the file
    Returns  an astropy table
    Errors   ValueError for a file that is cut, has no table, or fewer rows than it says.
    """
    from astropy.io.votable import parse
    from astropy.io.votable.exceptions import VOWarning

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VOWarning)  # the archives' own files are not perfect
            table = parse(path).get_first_table().to_table()
    except Exception as error:  # expat, astropy and numpy each raise their own
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ValueError(f"{path} must be a whole VOTable, got: {reason}") from None
    said = NROWS.search(path.read_bytes())  # astropy does not hold the file to it
    if said and int(said[1]) != len(table):
        raise ValueError(f"{path} must have the {int(said[1])} rows it says, got {len(table)}")
    return table

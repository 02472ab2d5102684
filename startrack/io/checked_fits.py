"""FITS file -> its parts with verified checksums, or a sentence that says what is wrong."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def open_checked(path: Path, keyword: str, form: int, what: str) -> Iterator[Any]:
    """The parts of a file, while it is open.

    keyword  of the first header, that names the format
    form     its value
    what     the file is to be, for the sentence
    Raises   FileNotFoundError; ValueError where it is something else, another format, or damaged.
    """
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyUserWarning

    try:
        # astropy would leave a file open that it opened and then refused.
        with Path(path).open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("error", AstropyUserWarning)
            with fits.open(file, checksum=True, memmap=False) as parts:
                found = parts[0].header.get(keyword, "none")
                if found != form:
                    raise ValueError(f"{path} must be {what} of format {form}, got {found}")
                yield parts
    except FileNotFoundError:
        raise
    except (OSError, AstropyUserWarning, KeyError, AttributeError, TypeError) as error:
        raise ValueError(f"{path} must be {what}, whole, got: {error}") from error

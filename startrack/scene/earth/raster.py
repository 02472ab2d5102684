"""A GeoTIFF, or any raster that GDAL reads, as a source of heights or of another map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.scene.earth.surface import FULL_TURN, Grid

Singles = NDArray[np.float32]

GEOGRAPHIC = "EPSG:4326"  # longitude and latitude in degree on WGS84
SEAM = 1e-6  # of a step


@dataclass(frozen=True)
class Raster:
    """A map in a file, in whatever coordinates; GDAL warps it and uses its overviews.

    path   of the file
    band   1, the first
    exact  whether values are classes, such as of land cover, between which there is no mean

    Errors  ImportError where rasterio is missing; OSError where the file cannot be read; ValueError
            where it has no georeference or none that PROJ knows.
    """

    path: Path
    band: int = 1
    exact: bool = False

    def __post_init__(self) -> None:
        _ = self.grid

    @cached_property
    def grid(self) -> Grid:
        """Pixel centres, of the file itself where its axes are longitude and latitude."""
        rasterio = _rasterio()
        with _open(self.path) as file:
            if file.crs is None or file.transform.is_identity:
                raise ValueError(f"{self.path} must have a georeference, but has none")
            if not 1 <= self.band <= file.count:
                raise ValueError(
                    f"band of {self.path} must lie in [1, {file.count}], got {self.band}"
                )
            try:
                with rasterio.vrt.WarpedVRT(file, crs=GEOGRAPHIC) as warped:
                    transform, columns, rows = warped.transform, warped.width, warped.height
            except (rasterio.errors.RasterioError, rasterio._err.CPLE_BaseError) as error:
                raise ValueError(
                    f"{self.path} must have a coordinate system that PROJ knows: {error}"
                ) from None
        step_x, step_y = math.radians(transform.a), math.radians(-transform.e)
        return Grid(
            math.radians(transform.c) + step_x / 2, math.radians(transform.f) - step_y / 2,
            step_x, step_y, min(columns, round(FULL_TURN / step_x)), rows,
        )  # fmt: skip

    def read(self, grid: Grid) -> Singles:
        """Bilinear (nearest where exact), with GDAL's smoothing where the steps are coarser."""
        out = np.full((grid.rows, grid.columns), np.nan, np.float32)
        for turn in (-FULL_TURN, 0.0, FULL_TURN):
            west = grid.west + turn
            east = west + (grid.columns - 1) * grid.step_x
            mine = self.grid
            if west > mine.west + mine.columns * mine.step_x or east < mine.west - mine.step_x:
                continue
            part = self._warp(grid, west)
            np.copyto(out, part, where=np.isnan(out))
        return out

    def _warp(self, grid: Grid, west: float) -> Singles:
        rasterio = _rasterio()
        across, down = math.degrees(grid.step_x), math.degrees(grid.step_y)
        transform = rasterio.Affine(
            across,
            0,
            math.degrees(west) - across / 2,
            0,
            -down,
            math.degrees(grid.north) + down / 2,
        )
        method = rasterio.enums.Resampling
        with _open(self.path) as file:
            try:
                with rasterio.vrt.WarpedVRT(
                    file, crs=GEOGRAPHIC, transform=transform, width=grid.columns, height=grid.rows,
                    resampling=method.nearest if self.exact else method.bilinear,
                    nodata=math.nan, dtype="float32",
                ) as warped:  # fmt: skip
                    return np.asarray(warped.read(self.band), np.float32)
            except rasterio.errors.RasterioError as error:
                raise OSError(f"{self.path} must be a whole raster file: {error}") from None


def _open(path: Path) -> Any:
    rasterio = _rasterio()
    try:
        return rasterio.open(path)
    except rasterio.errors.RasterioIOError as error:
        raise OSError(f"{path} must be a raster file that GDAL reads: {error}") from None


def _rasterio() -> Any:
    try:
        import rasterio
        import rasterio._err  # what GDAL says has no public name
        import rasterio.enums
        import rasterio.vrt
    except ImportError:
        raise ImportError(
            "rasterio must be installed to read terrain files: pip install 'startrack[earth]'"
        ) from None
    return rasterio

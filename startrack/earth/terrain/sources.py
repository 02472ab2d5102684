"""Sources of heights and maps on a grid: GDAL rasters, arrays, fractal terrain from a seed."""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from startrack.core import Floats, Singles, Streams, positive, require_memory, whole, within
from startrack.earth.terrain.surface import FULL_TURN, Grid
from startrack.io import regular_file

GEOGRAPHIC = "EPSG:4326"  # longitude and latitude in degree on WGS84
FRACTAL_BYTES = 40  # of a height while terrain is made; measured: 36
# Of a step, to the south-east: a vertex on the edge that two tiles share lies in one of them.
NUDGE = 1e-7


@dataclass(frozen=True)
class Raster:
    """A map in a file, in whatever coordinates; GDAL warps it and uses its overviews.

    path   of the file
    band   1, the first
    exact  whether values are classes, such as of land cover, between which there is no mean

    Raises  ImportError where rasterio is missing; OSError where the file cannot be read; ValueError
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
        rasterio = require_rasterio("to read terrain files")
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
            except Exception as error:
                if not type(error).__module__.startswith("rasterio."):
                    raise  # GDAL's own errors are rasterio's, too, but have no public name
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
            west, mine = grid.west + turn, self.grid
            east = west + (grid.columns - 1) * grid.step_x
            if west <= mine.west + mine.columns * mine.step_x and east >= mine.west - mine.step_x:
                np.copyto(out, self._warp(grid, west), where=np.isnan(out))
        return out

    def _warp(self, grid: Grid, west: float) -> Singles:
        rasterio = require_rasterio("to read terrain files")
        across, down = math.degrees(grid.step_x), math.degrees(grid.step_y)
        left, top = math.degrees(west), math.degrees(grid.north)
        left, top = left + across * (NUDGE - 0.5), top - down * (NUDGE - 0.5)
        transform = rasterio.Affine(across, 0, left, 0, -down, top)
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
    rasterio = require_rasterio("to read terrain files")
    regular_file(path, "a raster file")  # GDAL would wait for a FIFO, and read a network
    try:
        return rasterio.open(path)
    except rasterio.errors.RasterioIOError as error:
        raise OSError(f"{path} must be a raster file that GDAL reads: {error}") from None


def require_rasterio(purpose: str) -> Any:
    """The package, with its warping.

    purpose  of it, for the message: "to read terrain files"
    Raises   ImportError where it is missing.
    """
    try:
        import rasterio
        from rasterio import control, enums, vrt, warp  # noqa: F401
    except ImportError:
        raise ImportError(
            f"rasterio must be installed {purpose}: pip install 'startrack[earth]'"
        ) from None
    return rasterio


class Source(Protocol):
    """A map of one quantity over a part of the Earth."""

    @property
    def grid(self) -> Grid:
        """Its vertices, or the ones that fit it best."""
        ...

    def read(self, grid: Grid) -> Singles:
        """Its values at the vertices of another grid, smoothed to that one's steps.

        Returns  (rows, columns); NaN where it has none
        """
        ...


@dataclass(frozen=True, eq=False)
class Array:
    """A map in memory.

    grid    its vertices
    values  (rows, columns); NaN is no value
    """

    grid: Grid
    values: Singles

    def __post_init__(self) -> None:
        if self.values.shape != (self.grid.rows, self.grid.columns):
            raise ValueError(
                f"values must have the shape of their grid, {(self.grid.rows, self.grid.columns)}, "
                f"got {self.values.shape}"
            )

    @cached_property
    def _levels(self) -> list[Singles]:
        """Those levels of the pyramid that were read, from the finest on."""
        return [self.values.astype(np.float32)]

    def level(self, wanted: int) -> tuple[Singles, int]:
        """A level, each at every second vertex of the one before, or the last; and its number."""
        levels = self._levels
        while len(levels) <= wanted and min(levels[-1].shape) > 2:
            levels.append(halve(levels[-1]))
        number = min(wanted, len(levels) - 1)
        return levels[number], number

    def read(self, grid: Grid) -> Singles:
        """Bilinear, in the coarsest level whose steps do not exceed those of `grid`."""
        ratio = max(grid.step_x / self.grid.step_x, grid.step_y / self.grid.step_y)
        values, level = self.level(max(0, int(np.floor(np.log2(ratio) + 1e-6))))
        scale = 2.0**level
        turn = FULL_TURN / self.grid.step_x
        mine = self.grid
        u = _steps(grid.west - mine.west, grid.step_x, grid.columns) / mine.step_x
        u -= turn * np.floor((u - (mine.columns - 1) / 2) / turn + 0.5)
        v = _steps(mine.north - grid.north, grid.step_y, grid.rows) / mine.step_y
        return bilinear(values, v[:, None] / scale, u[None] / scale, self.grid.closed)


def _steps(first: float, step: float, count: int) -> Floats:
    return first + np.arange(count, dtype=np.float64) * step


def halve(values: Singles) -> Singles:
    """Every second vertex, as a mean with its neighbours weighted 1, 2, 1 along both axes.

    What has no value is left out of the mean. A grid of an even number of vertices loses its
    outermost one.
    """
    finite = np.isfinite(values)
    total, weight = np.where(finite, values, 0).astype(np.float64), finite.astype(np.float64)
    for axis in (0, 1):
        total, weight = (_tent(part, axis) for part in (total, weight))
    with np.errstate(invalid="ignore", divide="ignore"):
        return (total / weight).astype(np.float32)


def _tent(values: Floats, axis: int) -> Floats:
    values = np.moveaxis(values, axis, 0)
    padded = np.concatenate([values[1:2], values, values[-2:-1]])
    out = 0.25 * padded[:-2:2] + 0.5 * values[::2] + 0.25 * padded[2::2]
    return np.moveaxis(out, 0, axis)


def bilinear(
    values: Singles, v: Floats, u: Floats, closed: bool = False, exact: bool = False
) -> Singles:
    """Values between vertices, at rows v and columns u that broadcast; NaN beyond the edges.

    exact  whether to take the nearest vertex instead
    """
    rows, columns = values.shape
    slack = 1e-6  # of a step, so that rounding does not lose the vertices of an edge
    inside = (v >= -slack) & (v <= rows - 1 + slack) & (closed | (u >= -slack))
    inside = inside & (closed | (u <= columns - 1 + slack))
    u = u % columns if closed else np.clip(u, 0, columns - 1)
    v = np.clip(v, 0, rows - 1)
    j = np.clip(np.floor(v).astype(np.int64), 0, rows - 2)
    i = np.clip(np.floor(u).astype(np.int64), 0, columns - (1 if closed else 2))
    after = (i + 1) % columns
    y, x = v - j, u - i
    if exact:
        y, x = np.round(y), np.round(x)
    out = np.zeros(np.broadcast_shapes(v.shape, u.shape))
    for row, column, fraction in (
        (j, i, (1 - y) * (1 - x)), (j, after, (1 - y) * x),
        (j + 1, i, y * (1 - x)), (j + 1, after, y * x),
    ):  # fmt: skip
        # A vertex without a fraction has no say, be it a hole.
        used = fraction > 1e-9
        out += np.where(used, values[row, column] * fraction, 0.0) if used.any() else 0.0
    return np.where(inside, out, np.nan).astype(np.float32)


def fractal(
    rows: int, columns: int, streams: Streams, relief: float, roughness: float = 2.0
) -> Singles:
    """Heights with the spectrum of a fractal surface.

        amplitude(k) ~ |k|^-roughness, phases uniform

    Source: Voss (1985), in Fundamental Algorithms for Computer Graphics, 805: an amplitude of
    |k|^-(H + 1) has the Hurst exponent H; mountains have H near 0.8 to 1.

    relief     metre, from the lowest height, which is 0, to the highest
    roughness  1, lower for rougher terrain
    Returns    (rows, columns) metre; it repeats itself beyond its edges
    """
    whole(2, 2**15, rows=rows, columns=columns)
    positive(relief=relief)
    within(-10, 10, roughness=roughness)
    require_memory(FRACTAL_BYTES * rows * columns, f"terrain of {columns} x {rows} heights")
    k = np.hypot(np.fft.fftfreq(rows, 1 / rows)[:, None], np.fft.rfftfreq(columns, 1 / columns))
    k[0, 0] = np.inf
    phase = streams("terrain").random(k.shape) * 2j * np.pi
    heights = np.fft.irfft2(k**-roughness * np.exp(phase), s=(rows, columns))
    heights -= heights.min()
    return (heights * (relief / heights.max())).astype(np.float32)

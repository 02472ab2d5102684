"""Sources of heights and maps on a grid: GDAL rasters, arrays, fractal terrain from a seed."""

import math
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from startrack.core import (
    Flags,
    Floats,
    Refused,
    Singles,
    Streams,
    positive,
    require_memory,
    whole,
    within,
)
from startrack.earth.terrain.surface import FULL_TURN, Grid
from startrack.io import regular_file

GEOGRAPHIC = "EPSG:4326"  # longitude and latitude in degree on WGS84
FRACTAL_BYTES = 40  # memory of a height while terrain is made; measured: 36
# Fraction of a step to the south-east: a vertex on the common edge of two tiles then lies in one
# tile.
NUDGE = 1e-7
NEAR_POLE = 0.1  # cosine of the latitude; below it, GDAL chooses the grid in degree
PIXELS = 2**22  # pixels per block, for the extremes of a file
# GDAL's drivers with all data in one file; others, such as VRT and WMS, name further files.
DRIVERS = ("GTiff", "SRTMHGT", "DTED", "USGSDEM", "GTX")
# Options that let GDAL read no further file: no .aux.xml, .ovr, .msk or .tfw.
ALONE = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    "GTIFF_REPORT_COMPD_CS": "YES",  # without it GDAL drops a vertical coordinate system
    "CPL_VSIL_CURL_ALLOWED_FILENAME": "none",
}
GRIDS = "PROJ_NETWORK"  # variable that lets PROJ fetch grids of datums
ELSEWHERE = ("OVERVIEWS", "xml:VRT")  # domains of metadata that let GDAL open other files
SURVEY_FOOT = 1200 / 3937  # metre
# metre, limits of ground and sea floor, with geoid and margin
DEEPEST, HIGHEST = -11_100.0, 9_100.0
# Numbers that many programs write for a missing height. (Trenches of the sea reach -9999 m.)
VOIDS = (-9999.0, -32768.0)
SEARCHED = 2**28  # pixel, largest file that is searched for these numbers before heights are read
# Metre per unit of height; names of GDAL, EPSG and the makers of elevation models.
METRES = {
    **dict.fromkeys(("m", "metre", "meter", "metres", "meters"), 1.0),
    **dict.fromkeys(("dm", "decimetre", "decimeter"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimeter"), 0.01),
    **dict.fromkeys(("km", "kilometre", "kilometer"), 1000.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot", "international feet"), 0.3048),
    **dict.fromkeys(("us survey foot", "us survey feet", "us-ft", "ftus", "usft"), SURVEY_FOOT),
    **dict.fromkeys(("foot_us", "us_survey_foot"), SURVEY_FOOT),
}


class Scaling(NamedTuple):
    """Scale of a band: value = scale * number + offset, in metre for heights.

    unit     unit of the numbers as the file names it; "" if it does not
    surface  vertical coordinate system of heights; "" if the file names none
    gravity  whether this system is of a geoid or another level, and not of an ellipsoid
    """

    scale: float
    offset: float
    unit: str
    surface: str
    gravity: bool = False


class Extremes(NamedTuple):
    """Extremes of the values of a file; NaN without values.

    holes        1, fraction without a value
    void_number  lowest number, before scale and unit, if it is among VOIDS
    """

    lowest: float
    highest: float
    holes: float
    void_number: float | None = None

    @property
    def impossible(self) -> float | None:
        """First extreme outside the heights of the Earth, metre; None if both are possible."""
        if self.lowest < DEEPEST:
            return self.lowest
        return self.highest if self.highest > HIGHEST else None

    @property
    def of_the_earth(self) -> bool:
        """Whether all values can be heights of the Earth and none of them is in VOIDS."""
        return self.impossible is None and self.void_number is None


@dataclass(frozen=True)
class Raster:
    """A map in a file of one of the DRIVERS, in any coordinates; GDAL warps it.

    No other file is read: no side-car file, and no file or address that the file names. Scale and
    offset are applied. Heights are converted to metre from the unit of the band and of the vertical
    coordinate system; metre is assumed for a band without a unit.

    path     of the file
    band     1, the first
    exact    whether values are classes, such as land cover, which have no mean
    heights  whether values are heights or undulations of a geoid

    Raises  ImportError without rasterio; OSError if the file cannot be read; Refused if it
            has no georeference that PROJ knows, or heights have a unit other than length, have two
            units, or point down.
    """

    path: Path
    band: int = 1
    exact: bool = False
    heights: bool = False

    def __post_init__(self) -> None:
        _ = self.grid, self.scaling

    @cached_property
    def grid(self) -> Grid:
        """Pixel centres; the file's own where its axes are longitude and latitude.

        For a map projection, cells have the size of its pixels in the middle, along both axes.
        """
        rasterio = require_rasterio("to read terrain files")
        with _opened(self.path) as file:
            if file.crs is None or file.transform.is_identity:
                raise Refused(f"{self.path} must have a georeference, but has none")
            if not 1 <= self.band <= file.count:
                raise Refused(f"band of {self.path} must lie in [1, {file.count}], got {self.band}")
            try:
                with rasterio.vrt.WarpedVRT(file, crs=GEOGRAPHIC) as warped:
                    transform, columns, rows = warped.transform, warped.width, warped.height
                if not file.crs.is_geographic:
                    transform, columns, rows = _as_fine(file, transform, columns, rows)
            except Exception as error:
                if not type(error).__module__.startswith("rasterio."):
                    raise  # GDAL's errors are also rasterio's, but have no public name
                raise Refused(
                    f"{self.path} must have a coordinate system that PROJ knows: {error}"
                ) from None
        step_x, step_y = math.radians(transform.a), math.radians(-transform.e)
        west = math.radians(transform.c) + step_x / 2
        north = math.radians(transform.f) - step_y / 2
        return Grid(west, north, step_x, step_y, min(columns, round(FULL_TURN / step_x)), rows)

    @cached_property
    def scaling(self) -> Scaling:
        """Factor and offset that convert numbers of the band to heights in metre."""
        with _opened(self.path) as file:
            scale, offset = file.scales[self.band - 1], file.offsets[self.band - 1]
            if not (math.isfinite(scale) and scale != 0 and math.isfinite(offset)):
                raise Refused(
                    f"scale and offset of {self.path} must be finite, and the scale not 0, got "
                    f"{scale:g} and {offset:g}"
                )
            if not self.heights:
                return Scaling(scale, offset, file.units[self.band - 1] or "", "")
            unit, surface, gravity = _height_unit(self.path, file.units[self.band - 1], file.crs)
        metre = METRES[unit.lower()] if unit else 1.0
        return Scaling(scale * metre, offset * metre, unit, surface, gravity)

    def read(self, grid: Grid) -> Singles:
        """Values by bilinear interpolation (nearest if exact), smoothed by GDAL for coarser steps.

        Raises    Refused for heights outside the heights of the Earth. Warns of a file of heights
                  that contains one of VOIDS without declaring a number for missing heights.
        Accuracy  a file of more than SEARCHED pixels is not searched for VOIDS.
        """
        out = np.full((grid.rows, grid.columns), np.nan, np.float32)
        for turn in (-FULL_TURN, 0.0, FULL_TURN):
            west, mine = grid.west + turn, self.grid
            east = west + (grid.columns - 1) * grid.step_x
            if west <= mine.west + mine.columns * mine.step_x and east >= mine.west - mine.step_x:
                np.copyto(out, self._warp(grid, west), where=np.isnan(out))
        scale, offset = self.scaling[:2]
        if (scale, offset) != (1.0, 0.0):
            out = (scale * out + offset).astype(np.float32)
        if self.heights:
            lowest, highest = (
                float(extreme.reduce(out, axis=None)) for extreme in (np.fmin, np.fmax)
            )
            self._judge(Extremes(lowest, highest, np.isnan(out).mean(), self._unnamed_void))
        return out

    def covers(self, longitude: Floats, latitude: Floats) -> Flags:
        """Whether points lie within the file by at least a pixel; the file may have a hole
        there."""
        rasterio = require_rasterio("to read terrain files")
        inside = np.zeros(longitude.shape, np.bool_)
        with _opened(self.path) as file:
            places = np.degrees(longitude).ravel(), np.degrees(latitude).ravel()
            for turn in (-360.0, 0.0, 360.0):
                x, y = rasterio.warp.transform(GEOGRAPHIC, file.crs, places[0] + turn, places[1])
                to_pixel, x, y = ~file.transform, np.asarray(x), np.asarray(y)
                u = to_pixel.a * x + to_pixel.b * y + to_pixel.c
                v = to_pixel.d * x + to_pixel.e * y + to_pixel.f
                within = (u >= 1) & (u <= file.width - 1) & (v >= 1) & (v <= file.height - 1)
                inside |= within.reshape(longitude.shape)
        return inside

    def extremes(self, advance: Callable[[int], None] = lambda _: None) -> Extremes:
        """Lowest and highest value of all pixels, and the fraction of pixels without a value.

        advance  called with the number of rows read since the last call
        """
        lowest, highest, holes = math.inf, -math.inf, 0
        with _opened(self.path) as file:
            step = max(1, PIXELS // file.width)
            for first in range(0, file.height, step):
                rows = min(step, file.height - first)
                window = ((first, first + rows), (0, file.width))
                try:
                    part = file.read(self.band, window=window, masked=True)
                except Exception as error:
                    if not type(error).__module__.startswith("rasterio."):
                        raise
                    raise OSError(f"{self.path} must be a whole raster file: {error}") from None
                known = part.compressed()
                known = known[np.isfinite(known)]
                holes += part.size - known.size
                if known.size:
                    lowest, highest = min(lowest, known.min()), max(highest, known.max())
                advance(rows)
            fraction = holes / (file.width * file.height)
        if fraction == 1:
            return Extremes(math.nan, math.nan, fraction)
        scale, offset = self.scaling[:2]
        low, high = sorted((scale * float(lowest) + offset, scale * float(highest) + offset))
        return Extremes(low, high, fraction, float(lowest) if lowest in VOIDS else None)

    @cached_property
    def _unnamed_void(self) -> float | None:
        """The number among VOIDS that the file contains without declaring it."""
        with _opened(self.path) as file:
            named = file.nodatavals[self.band - 1] is not None
            large = file.width * file.height > SEARCHED
        return None if named or large else self.extremes().void_number

    def _judge(self, heights: Extremes) -> None:
        """Warn of numbers that may mean missing heights, and refuse impossible heights."""
        if heights.void_number is not None:
            warnings.warn(
                f"{self.path} contains {heights.void_number:g} and declares no number for missing "
                "heights (nodata): it is taken as a height",
                stacklevel=3,
            )
        if heights.impossible is not None:
            raise Refused(
                f"heights of {self.path} must lie in [{DEEPEST:g}, {HIGHEST:g}] m, got "
                f"{heights.impossible:g} m: declare the number for missing heights in the file "
                "(nodata)"
            )

    def _warp(self, grid: Grid, west: float) -> Singles:
        rasterio = require_rasterio("to read terrain files")
        across, down = math.degrees(grid.step_x), math.degrees(grid.step_y)
        left, top = math.degrees(west), math.degrees(grid.north)
        left, top = left + across * (NUDGE - 0.5), top - down * (NUDGE - 0.5)
        transform = rasterio.Affine(across, 0, left, 0, -down, top)
        method = rasterio.enums.Resampling
        with _opened(self.path) as file:
            try:
                with rasterio.vrt.WarpedVRT(
                    file,
                    crs=GEOGRAPHIC,
                    transform=transform,
                    width=grid.columns,
                    height=grid.rows,
                    resampling=method.nearest if self.exact else method.bilinear,
                    nodata=math.nan,
                    dtype="float32",
                    # GDAL would guess them from the sizes of windows, and smooth small windows.
                    XSCALE=min(1.0, self.grid.step_x / grid.step_x),
                    YSCALE=min(1.0, self.grid.step_y / grid.step_y),
                ) as warped:
                    return np.asarray(warped.read(self.band), np.float32)
            except rasterio.errors.RasterioError as error:
                raise OSError(f"{self.path} must be a whole raster file: {error}") from None


def _as_fine(file: Any, warped: Any, columns: int, rows: int) -> tuple[Any, int, int]:
    """A grid (transform in degree, columns, rows) with the pixel size of a projected file.

    GDAL's grid has equal steps in degree, too coarse along the meridian.
    """
    rasterio = require_rasterio("to read terrain files")
    own = file.transform
    column, row = (size / 2 + np.eye(3)[k] for k, size in ((1, file.width), (2, file.height)))
    x, y = own.a * column + own.b * row + own.c, own.d * column + own.e * row + own.f
    longitude, latitude = rasterio.warp.transform(file.crs, GEOGRAPHIC, x, y)
    # Along each axis: steps of a column and of a row, which may be rotated.
    across, down = (math.hypot(*(np.array(part[1:]) - part[0])) for part in (longitude, latitude))
    near_pole = math.cos(math.radians(latitude[0])) < NEAR_POLE
    if near_pole or not (across > 0 and down > 0):
        return warped, columns, rows
    transform = rasterio.Affine(across, 0, warped.c, 0, -down, warped.f)
    return transform, math.ceil(columns * warped.a / across), math.ceil(-rows * warped.e / down)


def _height_unit(path: Path, band: str | None, system: Any) -> tuple[str, str, bool]:
    """Unit of the heights of a file, "" for none; their vertical coordinate system, if the file
    names it; and whether that is of gravity, as a third axis of an ellipsoid's system is not.

    Raises  Refused if the unit is not a length, band and coordinate system disagree, or the axis
            points down.
    """
    table = system.to_dict(projjson=True)
    axes = [
        (axis, part["name"], part.get("type") == "VerticalCRS")
        for part in table.get("components", [table])
        for axis in part.get("coordinate_system", {}).get("axis", [])
        if axis["direction"] in ("up", "down")
    ]
    surface, vertical, gravity = "", "", False
    if axes:
        axis, surface, gravity = axes[0]
        if axis["direction"] == "down":
            raise Refused(f"{path} must have heights, got depths: {surface} points down")
        unit = axis.get("unit", "metre")
        vertical = unit if isinstance(unit, str) else str(unit["name"])
    units = [unit.strip() for unit in (band or "", vertical) if unit.strip()]
    for unit in units:
        if unit.lower() not in METRES:
            known = ", ".join(METRES)
            raise Refused(f"unit of the heights of {path} must be one of {known}, got {unit!r}")
    if len({METRES[unit.lower()] for unit in units}) > 1:
        raise Refused(
            f"heights of {path} must have one unit, got {units[0]!r} of the band and {units[1]!r} "
            f"of {surface}"
        )
    across = {
        unit if isinstance(unit, str) else str(unit["name"])
        for part in table.get("components", [table])
        for axis in part.get("coordinate_system", {}).get("axis", [])
        for unit in [axis.get("unit", "metre")]
    }
    feet = [unit for unit in sorted(across) if "foot" in unit.lower()]
    if feet and not units:
        raise Refused(
            f"heights of {path} must have a unit, as its eastings and northings are in {feet[0]}: "
            "give the band's, for example by gdal_edit.py -units ft"
        )
    return (units[0] if units else ""), surface, gravity


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A raster file, open in GDAL without its side-car files and the files that it names."""
    rasterio = require_rasterio("to read terrain files")
    regular_file(path, "a raster file")  # GDAL would wait for a FIFO or read from a network
    real = os.path.realpath(path)  # absolute: GDAL takes a name with a colon for a protocol
    if real.startswith("/vsi"):
        raise Refused(
            f"{path} must not lie in a folder whose name begins with /vsi, the virtual files of "
            "GDAL"
        )
    before = os.environ.get(GRIDS)
    os.environ[GRIDS] = "OFF"
    try:
        with rasterio.Env(**ALONE), _opened_by_driver(path, real) as file:
            for domain in ELSEWHERE:
                if file.tags(ns=domain) or any(
                    file.tags(band, ns=domain) for band in range(1, file.count + 1)
                ):
                    raise Refused(f"{path} must not name other files, but has {domain}")
            yield file
    finally:
        os.environ.pop(GRIDS)
        if before is not None:
            os.environ[GRIDS] = before


def _opened_by_driver(path: Path, real: str) -> Any:
    rasterio = require_rasterio("to read terrain files")
    errors = []
    for driver in DRIVERS:
        try:
            return rasterio.open(real, driver=driver, sharing=False)
        except rasterio.errors.RasterioIOError as error:
            errors.append(error)
    drivers = ", ".join(DRIVERS)
    raise OSError(f"{path} must be a raster file of GDAL's {drivers}: {errors[0]}")


def require_rasterio(purpose: str) -> Any:
    """The package rasterio with its module for warping.

    purpose  for the message: "to read terrain files"
    Raises   ImportError without rasterio.
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
        """Vertices of the map, or the vertices that fit it best."""
        ...

    def read(self, grid: Grid) -> Singles:
        """Values at the vertices of another grid, smoothed to the steps of that grid.

        Returns  (rows, columns); NaN where the map has no value
        """
        ...

    def covers(self, longitude: Floats, latitude: Floats) -> Flags:
        """Whether points (radian, of any shape) lie within the map, which may have holes."""
        ...


@dataclass(frozen=True, eq=False)
class Array:
    """A map in memory.

    grid    vertices of the map
    values  (rows, columns); NaN: no value
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
        """The levels of the pyramid computed so far, the finest first."""
        return [self.values.astype(np.float32)]

    def level(self, wanted: int) -> tuple[Singles, int]:
        """The wanted level of the pyramid, or the last level if there are fewer, and its number.

        Each level has every second vertex of the level before.
        """
        levels = self._levels
        while len(levels) <= wanted and min(levels[-1].shape) > 2:
            levels.append(halve(levels[-1]))
        number = min(wanted, len(levels) - 1)
        return levels[number], number

    def read(self, grid: Grid) -> Singles:
        """Values by bilinear interpolation in the coarsest level with steps up to the steps of
        `grid`."""
        ratio = max(grid.step_x / self.grid.step_x, grid.step_y / self.grid.step_y)
        values, level = self.level(max(0, int(np.floor(np.log2(ratio) + 1e-6))))
        scale = 2.0**level
        turn = FULL_TURN / self.grid.step_x
        mine = self.grid
        u = _steps(grid.west - mine.west, grid.step_x, grid.columns) / mine.step_x
        u -= turn * np.floor((u - (mine.columns - 1) / 2) / turn + 0.5)
        v = _steps(mine.north - grid.north, grid.step_y, grid.rows) / mine.step_y
        return bilinear(values, v[:, None] / scale, u[None] / scale, self.grid.closed)

    def covers(self, longitude: Floats, latitude: Floats) -> Flags:
        """Whether points lie within the grid of the map."""
        mine = self.grid
        east = (longitude - mine.west) % FULL_TURN
        across = east <= mine.cells_across * mine.step_x
        return across & (latitude <= mine.north) & (latitude >= mine.south)


def _steps(first: float, step: float, count: int) -> Floats:
    return first + np.arange(count, dtype=np.float64) * step


def halve(values: Singles) -> Singles:
    """Every second vertex, as a mean with its neighbours weighted 1, 2, 1 along both axes.

    Vertices without a value are left out of the mean. A grid with an even number of vertices loses
    the outermost vertex.
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
    """Values between vertices, at rows v and columns u, which broadcast; NaN beyond the edges.

    exact  whether to take the nearest vertex instead
    """
    rows, columns = values.shape
    slack = 1e-6  # fraction of a step, so that rounding does not lose the vertices of an edge
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
        (j, i, (1 - y) * (1 - x)),
        (j, after, (1 - y) * x),
        (j + 1, i, y * (1 - x)),
        (j + 1, after, y * x),
    ):
        # A vertex of weight zero has no effect, even as a hole.
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
    Returns    (rows, columns) metre; the terrain is periodic
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

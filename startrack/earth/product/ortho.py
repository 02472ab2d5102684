"""Points of the ground -> line and column in an image; an image on a grid of a map projection."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates, maximum_filter

from startrack.core import LIGHT_SPEED, Camera, Flags, Floats, deg, one_of, positive
from startrack.earth.geometry import EarthScene, fly
from startrack.earth.imager import Sheet
from startrack.earth.terrain import (
    EQUATORIAL,
    Ground,
    NorthUp,
    between,
    rays_down,
    require_rasterio,
    survey,
)
from startrack.space import sun_direction

NODES = 65  # nodes of the flight's spline over the image
BEYOND = 0.1  # fraction of the lines, before and after the image, over which the spline extends
STEPS = 8  # largest number of steps of the search for a line
CLOSE = 1e-6  # line
NO_DATA, SATURATED, SHADOW, STEEP, HIDDEN, CLOUD, CLOUD_SHADOW = 1, 2, 4, 8, 16, 32, 64
QUALITY = {
    "no data": NO_DATA,
    "saturated": SATURATED,
    "shadow": SHADOW,
    "steep": STEEP,
    "hidden": HIDDEN,
    "cloud": CLOUD,
    "cloud shadow": CLOUD_SHADOW,
}
PROJECTIONS = "utm", "geographic"
RESAMPLING = {"nearest": 0, "bilinear": 1, "cubic": 3}  # order of each spline
STEEPEST = 60 * deg  # between a slope's normal and the camera; chosen by hand
CLOUDY = 0.1  # vertical optical depth from which a layer counts as cloud; chosen by hand
CELLS = 2**17  # cells at a time, to limit the memory
SLACK = 0.5  # pixel on the ground; a point this far behind the visible ground is hidden
GEOGRAPHIC = "EPSG:4326"


class Locator:
    """The inverse of a sight: from points to the image.

    A line camera sees a point when the point crosses the plane of the line. Newton's method finds
    this time, on splines of position, velocity and attitude.

    scene  scene with its sensor
    lens   camera of the sensor's pixels, with its distortion; None: the sensor's own, without
    """

    def __init__(self, scene: EarthScene, lens: Camera | None = None) -> None:
        sensor, carrier = scene.sensor, scene.carrier
        dating = sensor.dating(carrier)
        margin = BEYOND * sensor.lines + 2 * sensor.stages
        at = np.linspace(-margin, sensor.lines - 1 + margin, NODES)
        if not dating.period:
            at = np.linspace(-1.0, 1.0, 4)
        flight = fly(carrier, dating.at(at))
        turn = scene.pointing.camera_to_itrs(flight).as_matrix().reshape(-1, 9)
        values = np.concatenate([flight.position, flight.velocity, turn], 1)
        self._sensor, self._lens = sensor, lens or sensor.camera
        self._flight, self._row = CubicSpline(at, values), sensor.elements(carrier)
        self._at_once = not dating.period  # a matrix

    def locate(self, point: Floats) -> Floats:
        """Places of points in the image.

        point     (n, 3) metre, in the Earth's fixed axes
        Returns   (n, 2) column and line, integers at the centres of pixels; far outside the image,
                  or NaN, for points that are not in it
        Accuracy  numerical: 1e-6 pixel. Staggered rows, and the stages of TDI, count as one row in
                  their middle. Earth rotation between the rows displaces even and odd columns in
                  opposite directions, by 0.09 pixel for the camera `hsrs`.
        """
        sensor, row = self._sensor, self._row
        if self._at_once:
            return self._project(point, np.zeros(len(point)))
        first, last = row.x.mean(1)[[0, -1]]
        step = (last - first) / (len(row.x) - 1)
        y, late = float(row.y.mean()), float(row.delay.mean())
        line = np.full(len(point), (sensor.lines - 1) / 2)
        pace = self._pace(point, y, late)
        low, high = self._flight.x[[0, -1]]
        seen = self._project(point, line + late)
        for _ in range(STEPS):
            change = (seen[:, 1] - y) / pace
            line = np.clip(line - change, low - late, high - late)
            seen = self._project(point, line + late)
            if not (np.abs(change) > CLOSE).any():
                break
        return np.stack([(seen[:, 0] - first) / step, line], 1)

    def camera(self, line: Floats) -> Floats:
        """Position (n, 3) metre of the camera at lines (n,)."""
        return self._at(line)[:, :3]

    def _pace(self, point: Floats, y: float, late: float) -> float:
        """Rows per line of the ground's motion, near the image's middle."""
        middle = (self._sensor.lines - 1) / 2 + late
        some = point[:: max(1, len(point) // 16)]
        before, after = (self._project(some, np.full(len(some), middle + d)) for d in (-0.5, 0.5))
        moved = (after - before)[:, 1]
        moved = moved[np.isfinite(moved)]
        return float(moved.mean()) if len(moved) and moved.mean() else -1.0

    def _at(self, line: Floats) -> Floats:
        return np.asarray(self._flight(np.zeros_like(line) if self._at_once else line))

    def _project(self, point: Floats, line: Floats) -> Floats:
        """Pixel (n, 2) of points on the camera's grid, at the times of lines."""
        flight = self._at(line)
        sight = point - flight[:, :3]
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        # The camera's direction a has a - v / c along the sight: see `sight`.
        drift = flight[:, 3:6] / LIGHT_SPEED
        along = np.einsum("ij,ij->i", sight, drift)
        square = np.einsum("ij,ij->i", drift, drift)
        sight = (np.sqrt(along**2 + 1 - square) - along)[:, None] * sight + drift
        turn = flight[:, 6:].reshape(-1, 3, 3)
        return self._lens.project(np.einsum("nij,ni->nj", turn, sight))


Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class MapGrid(NorthUp):
    """Cells of a map, from the outer corner of the first cell; in metre, or degree if geographic.

    system  coordinate system, such as EPSG:32632
    """

    system: str

    def places(self, rows: slice) -> tuple[Floats, Floats]:
        """Longitude and latitude (n,), radian, of the centres of the cells in the given rows."""
        y = self.north - (np.arange(rows.start, rows.stop, dtype=float) + 0.5) * self.step_y
        x = self.west + (np.arange(self.columns, dtype=float) + 0.5) * self.step_x
        x, y = (coordinate.ravel() for coordinate in np.meshgrid(x, y))
        return transformed(x, y, self.system, GEOGRAPHIC, 1.0, deg)


def transformed(
    x: Floats, y: Floats, system: str, other: str, unit: float, other_unit: float
) -> tuple[Floats, Floats]:
    """Coordinates (n,) in another system, in `unit`."""
    if system == other:
        return x * (other_unit / unit), y * (other_unit / unit)
    warp = require_rasterio("to project maps").warp
    coordinates = warp.transform(system, other, x / unit, y / unit)
    return np.array(coordinates[0]) * other_unit, np.array(coordinates[1]) * other_unit


def grid_of(longitude: Floats, latitude: Floats, projection: str, cell: float) -> MapGrid:
    """The cells that contain all points; the corner is a multiple of the cell size.

    longitude, latitude  (n,) radian, at least one; NaN is ignored
    projection           utm, in the zone of the middle; or geographic, with cells of equal size
                         east and north in the middle
    cell                 metre, size of a cell
    """
    one_of(PROJECTIONS, projection=projection)
    positive(cell=cell)
    finite = np.isfinite(longitude)
    longitude, latitude = longitude[finite], latitude[finite]
    # Longitudes relative to the first point, so that the date line does not split an image.
    longitude = longitude[0] + (longitude - longitude[0] + math.pi) % (2 * math.pi) - math.pi
    east, north = (float(np.median(angle)) / deg for angle in (longitude, latitude))
    if projection == "utm":
        zone = int((east + 180) % 360 // 6) + 1
        system = f"EPSG:{(32600 if north >= 0 else 32700) + zone}"
        step_x = step_y = cell
        x, y = transformed(longitude, latitude, GEOGRAPHIC, system, deg, 1.0)
    else:
        system, x, y = GEOGRAPHIC, longitude / deg, latitude / deg
        step_y = cell / EQUATORIAL / deg
        step_x = step_y / math.cos(north * deg)
    west, top = math.floor(x.min() / step_x) * step_x, math.ceil(y.max() / step_y) * step_y
    columns = max(math.ceil((x.max() - west) / step_x), 1)
    rows = max(math.ceil((top - y.min()) / step_y), 1)
    return MapGrid(west, top, step_x, step_y, columns, rows, system)


class Part(NamedTuple):
    """Some rows of a map: place of each cell in the image, and quality of that place.

    rows     rows of the grid
    pixel    (rows, columns, 2) line and column of the image
    quality  (rows, columns) bits, of geometry alone
    """

    rows: slice
    pixel: Floats
    quality: Bytes


def place_cells(
    scene: EarthScene,
    folder: Path,
    grid: MapGrid,
    distance: Floats,
    spread: float,
    lens: Camera | None = None,
    clouds: tuple[Sheet, ...] = (),
) -> Iterator[Part]:
    """Places of each cell's terrain in the image, some rows at a time.

    distance  (lines, columns) metre from the camera to the ground of each pixel; NaN for the sky
    spread    metre on the ground between rays of the image, for the choice of the terrain's level
    lens      as for `Locator`
    clouds    layers between the ground and the camera or the Sun
    """
    terrain, locator = scene.terrain.open(folder), Locator(scene, lens)
    sun = sun_direction(scene.carrier.epoch, scene.sensor.delay)
    # The farthest of the surrounding pixels, so that slopes do not count as hidden.
    farthest = maximum_filter(np.nan_to_num(distance, nan=0.0), 3)
    step = max(1, CELLS // grid.columns)
    for first in range(0, grid.rows, step):
        rows = slice(first, min(first + step, grid.rows))
        place = grid.places(rows)
        ground = survey(terrain, rays_down(*place, spread), sun)
        pixel = np.full((len(ground), 2), math.nan)
        hit = ground.hit
        pixel[hit] = locator.locate(ground.point[hit])
        quality = _quality(ground, locator, pixel, farthest, spread * SLACK, clouds)
        shape = rows.stop - rows.start, grid.columns
        yield Part(rows, pixel[:, ::-1].reshape(*shape, 2), quality.reshape(shape))


def _quality(
    ground: Ground,
    locator: Locator,
    pixel: Floats,
    farthest: Floats,
    slack: float,
    clouds: tuple[Sheet, ...],
) -> Bytes:
    lines, columns = farthest.shape
    x, y = pixel.T
    with np.errstate(invalid="ignore"):
        inside = (x > -0.5) & (x < columns - 0.5) & (y > -0.5) & (y < lines - 0.5)
    out = np.where(inside, 0, NO_DATA).astype(np.uint8)
    seen = np.flatnonzero(inside)
    sight = locator.camera(pixel[seen, 1]) - ground.point[seen]
    away = np.linalg.norm(sight, axis=1)
    near = np.rint(pixel[seen]).astype(np.int64)
    there = farthest[near[:, 1], near[:, 0]]
    steep = between(ground.normal[seen], sight / away[:, None]) > STEEPEST
    flags = [(steep, STEEP), (ground.shadow[seen], SHADOW), (away > there + slack, HIDDEN)]
    for sheet in clouds:
        before = sheet.cross(ground.point[seen], sight / away[:, None])
        shaded = sheet.cross(ground.point[seen], ground.sun).depth > CLOUDY
        flags.append(((before.depth > CLOUDY) & (before.distance < away), CLOUD))
        flags.append((shaded, CLOUD_SHADOW))
    for flag, bit in flags:
        out[seen] |= np.where(flag, bit, 0).astype(np.uint8)
    return out


def resample(values: Floats, pixel: Floats, method: str) -> Floats:
    """Values of an image at fractional pixels.

    values   (lines, columns); NaN: no value
    pixel    (..., 2) line and column
    method   nearest, bilinear, cubic (a spline through the pixels)
    Returns  (...); NaN outside, and beside pixels without a value
    """
    one_of(tuple(RESAMPLING), resampling=method)
    order = RESAMPLING[method]
    lines, columns = values.shape
    with np.errstate(invalid="ignore"):
        inside = (pixel > -0.5).all(-1) & (pixel < np.array([lines - 0.5, columns - 0.5])).all(-1)
    out = np.full(pixel.shape[:-1], math.nan)
    finite = np.isfinite(values)
    if not finite.any() or not inside.any():
        return out
    # The image extends half a pixel beyond the centres of the outermost pixels, which are repeated
    # there.
    at = np.clip(pixel[inside], 0, np.array([lines - 1, columns - 1])).T
    filled = np.where(finite, values, values[finite].mean())
    interpolated = map_coordinates(filled, at, order=order, mode="nearest")
    lost = map_coordinates((~finite).astype(float), at, order=min(order, 1), mode="nearest")
    out[inside] = np.where(lost > 1e-6, math.nan, interpolated)
    return out


def touched(flags: Flags, pixel: Floats) -> Flags:
    """Whether places (..., 2), line and column, have a flagged pixel among the four neighbours."""
    out = np.zeros(pixel.shape[:-1], np.bool_)
    finite = np.isfinite(pixel).all(-1)
    at = pixel[finite].T
    out[finite] = map_coordinates(flags.astype(float), at, order=1, mode="constant") > 1e-6
    return out

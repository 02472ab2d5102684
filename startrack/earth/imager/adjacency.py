"""Reflectance of the ground around each pixel, mixed by the air into lines of sight and
skylight."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from startrack.core import Floats, printed
from startrack.earth.atmosphere import SPREADS
from startrack.earth.imager.band import Band, terms_in_band
from startrack.earth.terrain import EQUATORIAL, Ground, Rays, rays_down

WIDE = 3.0  # standard deviations; extent of a Gaussian; chosen by hand
FINE = 0.3  # side of a cell in standard deviations; chosen by hand
COARSE = 2.5  # rays: the least side of a cell; with 5, the light 20 m from an edge errs by 2 %
GOLDEN = (math.sqrt(5) - 1) / 2
CELLS = 2**17  # cells at a time, to limit the memory


class Plane(NamedTuple):
    """A map around a place of an image, in metre east and north; errs by 1 % within 100 km."""

    longitude: float
    latitude: float

    def at(self, longitude: Floats, latitude: Floats) -> tuple[Floats, Floats]:
        """East and north (n,) metre of places (n,) radian."""
        turn = (longitude - self.longitude + math.pi) % (2 * math.pi) - math.pi
        return (
            turn * math.cos(self.latitude) * EQUATORIAL,
            (latitude - self.latitude) * EQUATORIAL,
        )

    def places(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Inverse of `at`."""
        wide = EQUATORIAL * math.cos(self.latitude)
        return self.longitude + x / wide, self.latitude + y / EQUATORIAL


class Cells(NamedTuple):
    """Square cells of a Plane: centre of the first cell, side in metre, and numbers of cells."""

    x: float
    y: float
    side: float
    columns: int
    rows: int

    def middles(self) -> tuple[Floats, Floats]:
        """East and north (rows columns,) metre."""
        across = self.x + self.side * np.arange(float(self.columns))
        along = self.y + self.side * np.arange(float(self.rows))
        x, y = (np.asarray(place, np.float64) for place in np.meshgrid(across, along))
        return x.ravel(), y.ravel()

    def samples(self) -> tuple[Floats, Floats]:
        """A point in each cell; points of a row or column are spread evenly over the parts of their
        cells.

        So edges of the ground parallel to the cells do not move to the cells' borders.
        """
        x, y = (place.reshape(self.rows, self.columns) for place in self.middles())
        row, column = np.arange(self.rows)[:, None], np.arange(self.columns)
        x = x + self.side * (row * GOLDEN % 1 - 0.5)
        y = y + self.side * (column * GOLDEN % 1 - 0.5)
        return x.ravel(), y.ravel()

    def position(self, x: Floats, y: Floats) -> Floats:
        """Row and column (2, n) of points."""
        return np.stack([(y - self.y) / self.side, (x - self.x) / self.side])


@printed
class Environment(NamedTuple):
    """Reflectance of the ground, mixed by the air, over places and heights.

    cells, plane  places of the values
    height        (h,) metre above the sea
    reflectance   (2, h, rows, columns) 1, for lines of sight and for skylight
    mean          1, mean reflectance of the ground beyond all cells
    """

    plane: Plane
    cells: Cells
    height: Floats
    reflectance: Floats
    mean: float

    def at(self, ground: Ground) -> Floats:
        """Reflectance (2, n) around rays, for lines of sight and for skylight; the mean for rays
        that miss."""
        out = np.full((2, len(ground)), self.mean)
        hit = ground.hit
        place = self.cells.position(*self.plane.at(ground.longitude[hit], ground.latitude[hit]))
        level = np.interp(ground.height[hit], self.height, np.arange(len(self.height)))
        for kind, maps in zip(out, self.reflectance, strict=True):
            kind[hit] = map_coordinates(maps, [level, *place], order=1, mode="nearest")
        return out


def leaving(ground: Ground, band: Band, sky: Floats, direct: Floats | None = None) -> Floats:
    """Reflectance (n,) of level Lambertian ground that sends as much light upwards as the given
    ground.

    Slopes and shadows are included; light that goes back and forth between ground and air is not.

    sky, direct  (n,) 1, reflectance factors for skylight and sunlight
    """
    zenith = ground.sun_zenith
    no_shadow, open_sky = np.zeros(len(ground), bool), np.ones(len(ground))
    level = replace(ground, sun_incidence=zenith, shadow=no_shadow, sky_view=open_sky)
    white = terms_in_band(level, band, np.ones(1), 0.0)
    lit = np.maximum(np.cos(ground.sun_incidence), 0) * ~ground.shadow
    with np.errstate(divide="ignore", invalid="ignore"):
        beam = white.direct * np.where(zenith < math.pi / 2, lit / np.cos(zenith), 0)
        sent = (sky if direct is None else direct) * beam + sky * ground.sky_view * white.indirect
        full = white.direct + white.indirect
        return np.clip(np.where(full > 0, sent / full, 0.0), 0, 1)


def surrounded(
    glimpse: list[Ground],
    spacing: float,
    mean: float,
    band: Band,
    values: Callable[[Floats, Floats], Floats],
) -> Environment:
    """The environment of an image.

    glimpse  ground in a sample of its pixels
    spacing  metre on the ground between rays of the sample
    mean     1, reflectance beyond the image
    values   function of longitude and latitude (n,) radian: reflectance (n,), NaN where unknown
    """
    longitude, latitude = (
        np.concatenate([getattr(part, name) for part in glimpse])
        for name in ("longitude", "latitude")
    )
    plane = Plane(float(longitude[0]), float(np.median(latitude)))
    x, y = plane.at(longitude, latitude)
    sides = np.maximum(SPREADS * FINE, COARSE * spacing)
    # a few more of the finest cells cost less than coarser cells
    sides[sides < 2 * sides[0]] = sides[0]
    fine = _cells(x, y, float(sides[0]), 0.0)
    place = fine.middles()
    weights = band.table.spread
    if weights is None:
        raise ValueError(
            "air must scatter for light of the surroundings, got a band without scattering"
        )
    out = np.full((*weights.shape[:2], fine.rows, fine.columns), mean)
    last: tuple[Cells, Floats] | None = None
    for weight, width, side in zip(
        np.moveaxis(weights[:, :, 0], -1, 0)[::-1], SPREADS[::-1], sides[::-1], strict=True
    ):  # the widest first
        if last is None or last[0].side != side:
            cells = _cells(x, y, float(side), WIDE * width)
            here = values(*plane.places(*cells.samples())).reshape(cells.rows, cells.columns)
            last = cells, np.where(np.isnan(here), 0.0, here - mean)
        blurred = gaussian_filter(last[1], width / side, mode="nearest", truncate=WIDE)
        change = map_coordinates(blurred, last[0].position(*place), order=1, mode="nearest")
        out += weight[:, :, None, None] * change.reshape(fine.rows, fine.columns)
    return Environment(plane, fine, band.table.height, np.clip(out, 0, 1), mean)


def _cells(x: Floats, y: Floats, side: float, margin: float) -> Cells:
    """Cells that contain all points and a margin, metre."""
    margin += 2 * side
    columns, rows = (math.ceil((np.ptp(along) + 2 * margin) / side) + 1 for along in (x, y))
    return Cells(x.min() - margin, y.min() - margin, side, columns, rows)


def around_scene(
    seen: Callable[[Rays], Ground],
    glimpse: list[Ground],
    spacing: float,
    mean: float,
    band: Band,
    reflectance: Callable[[Ground], Floats],
) -> Environment:
    """The environment of an image from its terrain, including terrain beyond the image.

    seen         ground that rays meet
    reflectance  function of ground: (n,) 1, as `leaving`
    """

    def values(longitude: Floats, latitude: Floats) -> Floats:
        out = np.full(len(longitude), math.nan)
        side = math.sqrt(np.ptp(longitude) * math.cos(latitude[0]) * np.ptp(latitude) / len(out))
        for first in range(0, len(out), CELLS):
            some = slice(first, first + CELLS)
            ground = seen(rays_down(longitude[some], latitude[some], side * EQUATORIAL))
            out[some][ground.hit] = reflectance(ground[ground.hit])
        return out

    return surrounded(glimpse, spacing, mean, band, values)

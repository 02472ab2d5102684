"""Small terrain, rays that meet it, and files of a small scene and its camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.core.streams import Streams
from startrack.earth.terrain import ConstantHeight, Grid, Rays, cartesian, fractal, up
from startrack.earth.terrain.pyramid import Flags, Levels, beside, under
from startrack.earth.terrain.surface import Surface
from startrack.earth.terrain.trace import RayHits, blocked, trace

STEP = np.radians(1 / 3600)  # 31 m along a meridian


@dataclass(frozen=True, eq=False)
class Relief:
    """One surface in memory, and the sea around it.

    sea  metre above the ellipsoid beyond the edges of the surface; None for nothing
    """

    surface: Surface
    sea: float | None = None

    def meet(self, rays: Rays) -> tuple[RayHits, Levels]:
        """As `trace`, or the sea if it is nearer and outside of the surface."""
        hits = trace(self.surface, rays)
        if self.sea is not None:
            hits = beside(self.surface, ConstantHeight(self.sea).meet(rays)[0], hits)
        return hits, np.zeros(len(rays), np.int8)

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """As `blocked`; rays also end at the sea, and at the Earth below all heights."""
        return blocked(self.surface, rays, start) | under(self.surface, self.sea, rays, start)


def mountains(cells: int = 200, relief: float = 1500.0) -> tuple[Grid, NDArray[np.float32]]:
    grid = Grid(np.radians(10.0), np.radians(47.0), STEP, STEP, cells + 1, cells + 1)
    return grid, fractal(cells + 1, cells + 1, Streams(1, 0), relief)


def flat(height: float = 0.0, cells: int = 40) -> tuple[Grid, NDArray[np.float32]]:
    grid = Grid(np.radians(10.0), np.radians(47.0), STEP, STEP, cells + 1, cells + 1)
    return grid, np.full((cells + 1, cells + 1), height, np.float32)


def axes(longitude: float, latitude: float) -> tuple[NDArray, NDArray, NDArray]:
    """East, north and up."""
    rise = up(np.array(longitude), np.array(latitude))
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    return east, np.cross(rise, east), rise


def ray(longitude, latitude, height, elevation, azimuth=0.0, distance=3e5) -> Rays:
    """Rays that look down at places, from `distance` away at an elevation in degree."""
    place = np.atleast_2d(cartesian(*np.broadcast_arrays(longitude, latitude, height)))
    east, north, rise = axes(np.mean(longitude), np.mean(latitude))
    e, a = np.radians(elevation), np.atleast_1d(azimuth)[:, None]
    view = np.sin(e) * rise + np.cos(e) * (np.sin(a) * east + np.cos(a) * north)
    view = np.broadcast_to(view, place.shape)
    return Rays(place + distance * view, -view, np.zeros(len(place)))


def random_rays(
    grid: Grid, count: int, elevation: float, highest: float, lowest: float = 0.0
) -> Rays:
    """From all directions, through random points over the inner three quarters of a grid."""
    random = np.random.default_rng(1)
    u, v, height, azimuth = random.random((4, count))
    return ray(
        grid.west + (0.125 + 0.75 * u) * (grid.columns - 1) * grid.step_x,
        grid.north - (0.125 + 0.75 * v) * (grid.rows - 1) * grid.step_y,
        lowest + (highest - lowest) * height,
        elevation,
        2 * np.pi * azimuth,
    )


def hills() -> tuple[Grid, NDArray[np.float32]]:
    """Hills by a formula, 0 to 1000 m, which another program can also evaluate."""
    step = np.radians(1 / 3600)
    grid = Grid(np.radians(10.0), np.radians(47.0), step, step, 257, 257)
    at = np.arange(257)
    wave = np.sin(at / 9.0) + np.sin(at[:, None] / 7.0) + np.sin((at + 2 * at[:, None]) / 23.0)
    return grid, (500 + 500 / 3 * wave).astype(np.float32)


def globe(per_degree: float = 1.0) -> tuple[Grid, NDArray[np.float32]]:
    """A whole Earth of pixel centres whose heights change with longitude and latitude."""
    rows, columns = round(180 * per_degree), round(360 * per_degree)
    step = np.radians(1 / per_degree)
    grid = Grid(-np.pi + step / 2, np.pi / 2 - step / 2, step, step, columns, rows)
    lon = grid.west + step * np.arange(columns)
    lat = grid.north - step * np.arange(rows)[:, None]
    return grid, (3000 + 2000 * np.sin(3 * lon) * np.cos(lat)).astype(np.float32)


SCENE = """
camera = "small.toml"
lines = 30
columns = 24
[aircraft]
epoch = "2026-06-21T10:00:00"
longitude = "10 deg"
latitude = "47 deg"
[air]
[terrain]
highest = "500 m"
[terrain.fractal]
longitude = "10 deg"
latitude = "47 deg"
cell = "5 m"
cells = 128
relief = "100 m"
[land]
texture = 0.3
"""
CAMERA = """
[[channels]]
name = "green"
[channels.optics]
focal_length = "50 mm"
f_number = 4
psf = "airy"
[channels.band]
wavelength = ["520 nm", "525 nm", "575 nm", "580 nm"]
value = [0.0, 1.0, 1.0, 0.0]
[channels.detector]
columns = 512
rows = 30
pixel_pitch = "20 um"
exposure = "1 ms"
full_well = "500e3 electron"
[channels.detector.scan]
kind = "line"
"""

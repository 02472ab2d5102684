"""Rays from an orbit meet fractal mountains, beside the exact search of every cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.benchmark.stage import Stage
from startrack.core import Floats, Streams
from startrack.earth.terrain import (
    ConstantHeight,
    Grid,
    Rays,
    Scan,
    cartesian,
    fractal,
    index,
    trace,
    up,
)

STEP = np.radians(1 / 3600)
HEIGHT, RELIEF = 600e3, 1500.0


def mountains(cells: int, relief: float = RELIEF) -> tuple[Grid, NDArray[np.float32]]:
    """A square of cells at the latitude of the Alps, and the heights of its vertices, metre."""
    grid = Grid(np.radians(10.0), np.radians(47.0), STEP, STEP, cells + 1, cells + 1)
    return grid, fractal(cells + 1, cells + 1, Streams(1, 0), relief)


def axes(grid: Grid) -> tuple[Floats, Floats, Floats]:
    """East, north and up in the middle of a grid."""
    lon = np.array(grid.west + grid.step_x * grid.columns / 2)
    lat = np.array(grid.north - grid.step_y * grid.rows / 2)
    rise = up(lon, lat)
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return east, np.cross(rise, east), rise


def towards(grid: Grid, elevation: float, azimuth: NDArray[Any]) -> Floats:
    """Unit vectors (n, 3) away from the middle of a grid."""
    east, north, rise = axes(grid)
    e, a = np.radians(elevation), np.atleast_1d(azimuth)[:, None]
    view: Floats = np.sin(e) * rise + np.cos(e) * (np.sin(a) * east + np.cos(a) * north)
    return view


def random_rays(
    random: np.random.Generator, grid: Grid, count: int, elevation: float, fraction: float = 0.5
) -> Rays:
    """Rays from random azimuths to random points in the middle of a grid."""
    u, v, height, azimuth = random.random((4, count))
    low = (1 - fraction) / 2
    target = cartesian(
        grid.west + (low + fraction * u) * (grid.columns - 1) * grid.step_x,
        grid.north - (low + fraction * v) * (grid.rows - 1) * grid.step_y,
        RELIEF * height,
    )
    view = towards(grid, elevation, 2 * np.pi * azimuth)
    return Rays(target + HEIGHT * view, -view, np.zeros(count))


def image_rays(grid: Grid, side: int, elevation: float) -> Rays:
    """Parallel rays in rows and columns over four fifths of a grid, as of a far camera."""
    at = np.linspace(0.1, 0.9, side)
    u, v = np.meshgrid(at, at)
    target = cartesian(
        grid.west + u.ravel() * (grid.columns - 1) * grid.step_x,
        grid.north - v.ravel() * (grid.rows - 1) * grid.step_y,
        np.full(side**2, RELIEF / 2),
    )
    view = np.broadcast_to(towards(grid, elevation, np.zeros(1)), target.shape)
    return Rays(target + HEIGHT * view, -view.copy(), np.zeros(side**2))


CELLS, SIDE, ELEVATION = 512, 400, 60  # cells and rays a side; degree
JUDGED = slice(None, None, 37)  # rays that the reference computes


def rays_down() -> Rays:
    """Parallel rays in rows and columns."""
    return image_rays(mountains(CELLS)[0], SIDE, ELEVATION)


def terrain() -> Stage:
    """The median error of the distance; the alternative is a surface of constant height."""
    grid, heights = mountains(CELLS)
    surface, rays = index(grid, heights), rays_down()
    reference, _ = Scan(grid, heights, HEIGHT - 3e4, HEIGHT + 3e4).meet(rays[JUDGED])
    level = ConstantHeight(float(heights.mean()))

    def judge(distance: NDArray[np.floating]) -> float:
        return float(np.nanmedian(np.abs(distance[JUDGED] - reference.distance)))

    return Stage(
        "terrain",
        f"a ray from {HEIGHT / 1e3:g} km at {ELEVATION} deg to {CELLS} x {CELLS} cells of "
        f"{STEP * 6.4e6:.0f} m",
        "median of the distance, metre",
        {
            "startrack": lambda: trace(surface, rays).distance,
            "startrack level": lambda: level.meet(rays)[0].distance,
        },
        judge,
        float(np.finfo(float).eps * 6.4e6),
        "rounding of coordinates",
        len(rays),
    )

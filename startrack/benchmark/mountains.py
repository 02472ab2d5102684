"""Mountains from a seed, and rays that look down on them from an orbit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.scene.earth import Grid, Rays, cartesian, fractal, up
from startrack.streams import Streams

Floats = NDArray[np.float64]

STEP = np.radians(1 / 3600)
HEIGHT, RELIEF = 600e3, 1500.0


def mountains(cells: int, relief: float = RELIEF) -> tuple[Grid, NDArray[np.float32]]:
    """A square of cells in the Alps' latitude, and the heights of its vertices, metre."""
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
    random: np.random.Generator, grid: Grid, count: int, elevation: float, share: float = 0.5
) -> Rays:
    """From all sides, at random points of the middle of a grid."""
    u, v, height, azimuth = random.random((4, count))
    low = (1 - share) / 2
    target = cartesian(
        grid.west + (low + share * u) * (grid.columns - 1) * grid.step_x,
        grid.north - (low + share * v) * (grid.rows - 1) * grid.step_y,
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

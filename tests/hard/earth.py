"""Rays that meet terrain at its corners, against surfaces with a closed form."""

from __future__ import annotations

import numpy as np

from startrack.benchmark.earth import HEIGHT, RELIEF, STEP, image_rays, mountains, towards
from startrack.earth.terrain import ConstantHeight, Grid, Rays, TerrainScan, cartesian, index
from startrack.earth.terrain.trace import trace
from tests.hard.case import hard, refused


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


def plain(height: float, west: float = 10.0, north: float = 47.0, cells: int = 40):
    grid = Grid(np.radians(west), np.radians(north), STEP, STEP, cells + 1, cells + 1)
    return grid, np.full((cells + 1, cells + 1), height, np.float32)


def over(grid: Grid, height: float):
    """A place above the middle of a plain, (1, 3)."""
    lon, lat = (np.array([at]) for at in (grid.west + 20 * STEP, grid.north - 20 * STEP))
    return cartesian(lon, lat, np.array([height]))


def off_the_level(height: float, **place: float) -> float:
    grid, heights = plain(height, **place)
    rays = image_rays(grid, 20, 89)
    found, level = trace(index(grid, heights), rays), ConstantHeight(height).meet(rays)[0]
    both = found.hit & level.hit
    return float(np.abs(found.distance - level.distance)[both].max()) if both.sum() > 300 else 1e9


for _name, _height, _place in (
    ("below the sea, -400 m", -400.0, {}),
    ("at 9000 m", 9000.0, {}),
    ("across the date line", 300.0, {"west": 179.997}),
    ("next to the pole", 300.0, {"north": 89.99}),
):

    @hard("earth", f"flat terrain {_name}: distance off the closed form, m", (0, 1e-6))
    def _flat(height=_height, place=_place) -> float:
        return off_the_level(height, **place)


@hard("earth", "500 rays at 2 deg: another ridge than a search of all cells", (0, 0))
def _grazing() -> float:
    grid, heights = mountains(160)
    rays = random_rays(np.random.default_rng(2), grid, 500, 2.0)
    wanted, _ = TerrainScan(grid, heights, HEIGHT - 5e4, HEIGHT + 5e4).meet(rays)
    found = trace(index(grid, heights), rays)
    both = found.hit & wanted.hit
    far = np.abs(found.distance[both] - wanted.distance[both]) > 1.0
    return float((found.hit != wanted.hit).sum() + far.sum())


@hard("earth", "a ray that looks up from below the terrain's shell into the sky, hits", (0, 0))
def _up() -> float:
    grid, heights = plain(100.0)
    up = towards(grid, 90, np.zeros(1))
    at = over(grid, 150.0)
    return float(trace(index(grid, heights), Rays(at, up, np.zeros(1))).hit.sum())


@hard("earth", "a ray through a hole in the heights, hits", (0, 0))
def _hole() -> float:
    grid, heights = plain(500.0)
    heights[18:23, 18:23] = np.nan
    heights[0, 0] = 0
    down = towards(grid, 90, np.zeros(1))
    at = over(grid, HEIGHT)
    return float(trace(index(grid, heights), Rays(at, -down, np.zeros(1))).hit.sum())


@hard("earth", "heights of another shape than their grid", "must")
def _shape() -> str:
    grid, heights = plain(100.0)
    return refused(lambda: index(grid, heights[:-1]))

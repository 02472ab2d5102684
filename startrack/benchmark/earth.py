"""Rays onto fractal mountains against a search of every cell; radiance against its solver."""

import importlib
import math
import sys
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.benchmark.stage import BenchmarkStage
from startrack.core import Floats, Streams, deg, nm
from startrack.earth import atmosphere
from startrack.earth.terrain import (
    ConstantHeight,
    Grid,
    Rays,
    TerrainScan,
    cartesian,
    fractal,
    index,
    trace,
    up,
)
from startrack.io import shipped

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


def image_rays(grid: Grid, side: int, elevation: float) -> Rays:
    """Parallel rays in rows and columns over four fifths of a grid, as to a far camera."""
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


def terrain() -> BenchmarkStage:
    """The median error of the distance; the alternative is a surface of constant height."""
    grid, heights = mountains(CELLS)
    surface, rays = index(grid, heights), rays_down()
    reference, _ = TerrainScan(grid, heights, HEIGHT - 3e4, HEIGHT + 3e4).meet(rays[JUDGED])
    level = ConstantHeight(float(heights.mean()))

    def judge(distance: NDArray[np.floating]) -> float:
        return float(np.nanmedian(np.abs(distance[JUDGED] - reference.distance)))

    return BenchmarkStage(
        name="terrain",
        work=f"a ray from {HEIGHT / 1e3:g} km at {ELEVATION} deg to {CELLS} x {CELLS} cells of "
        f"{STEP * 6.4e6:.0f} m",
        error="median of the distance, metre",
        ways={
            "startrack": lambda: trace(surface, rays).distance,
            "startrack level": lambda: level.meet(rays)[0].distance,
        },
        judge=judge,
        limit=float(np.finfo(float).eps * 6.4e6),
        limit_of="rounding of coordinates",
        pieces=len(rays),
    )


WAVELENGTHS: Floats = np.array([450, 550, 800]) * nm
ALBEDO = 0.2
PIXELS = 180  # pixels of the image
PLACES = 24  # pixels that the solver computes
REACH = atmosphere.Reach((0.0, 2e3), (0.0, 5 * deg), (40 * deg, 45 * deg), (0.0, math.pi))


def image(size: int) -> atmosphere.SlantPath:
    """A nadir image over hills, as smooth as images are."""
    y, x = np.mgrid[:size, :size] / size
    height = 1000 + 900 * np.sin(7 * x) * np.cos(5 * y)
    sensor = (0.1 + 4.8 * np.hypot(x - 0.5, y - 0.5)) * deg
    sun = (40.5 + 4 * x) * deg
    azimuth = np.abs(np.arctan2(y - 0.5, x - 0.5))
    flat = np.ones(size * size)
    places = [part.ravel() for part in (height, sensor, sun, azimuth)]
    return atmosphere.SlantPath._make([*places, np.cos(places[2]), flat, flat])


def lines(table: atmosphere.AirTable) -> tuple[atmosphere.AirTable, Floats, NDArray[np.intp]]:
    """The table without gas lines, which the solver lacks; single wavelengths; their nodes."""
    node = np.argmin(np.abs(table.spectrum - WAVELENGTHS[:, None]), 1)
    response = np.zeros((len(node), len(table.spectrum)))
    response[range(len(node)), node] = 1
    return atmosphere.AirTable(**{**vars(table), "gas": np.ones_like(table.gas)}), response, node


class EarthScenery(NamedTuple):
    """An image of hills, and the table for its computation.

    fine  the part of the table that the image needs, in the wavelengths' bands
    unit  (bands,) divisor that makes a radiance a fraction of the sunlight
    node  (bands,) of the wavelengths in the table
    pick  pixels that are judged
    """

    table: atmosphere.AirTable
    fine: atmosphere.FineTable
    sight: atmosphere.SlantPath
    unit: Floats
    node: NDArray[np.intp]
    pick: NDArray[np.intp]


def scenery() -> EarthScenery:
    """The input of all ways."""
    table = atmosphere.load_table(shipped("atmosphere/rural-23km.fits"))
    bare, response, node = lines(table)
    unit = response @ (np.gradient(table.spectrum) * table.irradiance)
    fine = atmosphere.refine(atmosphere.in_bands(bare, response, 600e3), REACH)
    pick = np.linspace(0, PIXELS**2 - 1, PLACES).astype(np.intp)
    return EarthScenery(table, fine, image(PIXELS), unit, node, pick)


def radiance() -> BenchmarkStage:
    """Three wavelengths of an image of hills."""
    scene = scenery()
    ground = np.full((PIXELS**2, len(scene.node)), ALBEDO, np.float32)
    around = np.full(len(scene.node), ALBEDO)
    wanted, missing = None, "the solver needs the extra `earth`; without it there is no error"
    if find_spec("sasktran2"):
        wanted, missing = direct(scene), ""

    def ours() -> Floats:
        parts = atmosphere.look_up(scene.fine, scene.sight, ground, around)
        return (parts[0] + parts[1] + parts[2])[scene.pick] / scene.unit

    def judge(values: Floats) -> float:
        return math.nan if wanted is None else float(np.median(np.abs(values / wanted - 1)))

    return BenchmarkStage(
        "radiance",
        f"a pixel of an image of hills at {len(scene.node)} wavelengths, seen from an orbit",
        "median against runs of the solver, relative",
        {"startrack": ours},
        judge,
        pieces=PIXELS**2,
        missing=missing,
    )


def direct(scene: EarthScenery) -> Floats:
    """The solver's reflectance at the pixels that are judged, (n, bands), for one unit of light."""
    sys.path.append(str(shipped("atmosphere")))  # the folder of the scripts that build the tables
    solver = importlib.import_module("air_solver")
    rows, wavelength = [], scene.table.spectrum[scene.node]
    for i in scene.pick:
        height, sensor, sun, azimuth = (part[i] for part in scene.sight[:4])
        rays = [(math.cos(sensor), math.pi - azimuth, solver.TOP)]
        radiance = solver.solve_radiance(
            scene.table.air, wavelength, height, math.cos(sun), rays, (ALBEDO,), 8, polarised=True
        )
        rows.append(radiance[0][0, :, 0])
    return np.array(rows)

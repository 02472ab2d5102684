"""How fast and how accurate are intersections of rays and terrain, compared with embree, and how
much does the pyramid save?

One thread; times are CPU times, shortest of three. Mountains from a seed with cells of 1 arcsec,
1500 m high, are seen from 600 km. The reference is the search of every cell with exact geodetic
coordinates; embree gets the same vertices as triangles, in float32. The time of embree's distances
is compared with startrack's time for distance, geodetic place and normal. The time to build
embree's tree is given separately (`embree_index_4k_s`); neither it nor startrack's index is
counted.

    python experiments/terrain.py [--json FILE] [--figure FILE] [--quick]
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from textwrap import fill
from typing import Any

import command
import numpy as np
import one_thread  # noqa: F401  before numpy
from numpy.typing import NDArray

from startrack import Streams
from startrack.benchmark import earth as cases
from startrack.core import Floats
from startrack.earth.terrain import (
    LIFT,
    Array,
    Grid,
    Mosaic,
    Pyramid,
    Rays,
    Surface,
    TerrainScan,
    blocked,
    cartesian,
    fractal,
    index,
    survey,
    trace,
)
from startrack.plots import MARKERS, colour_bar, legend_below, picture, save_picture, styled
from tests.earth.terrain.scenes import Relief
from tests.hard.earth import random_rays

ELEVATIONS = (85, 60, 30, 10)
PARTS = ("hits", "shadow", "cache", "aliasing", "speed-1k", "speed-4k", "rugged", "grazing")
RANDOM = np.random.default_rng(20260621)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figure", type=Path, metavar="FILE")
    parser.add_argument(
        "--grazing", type=int, default=1_000_000, help="number of grazing rays (default: 1e6)"
    )
    parser.add_argument("--without-embree", action="store_true")
    parser.add_argument(
        "--rugged", metavar="PYTHON", help="Python interpreter that has orekit-jpype"
    )
    parser.add_argument(
        "--only", nargs="+", metavar="PART", help=f"parts to run: {', '.join(PARTS)}"
    )
    options = command.read(parser, grazing=100)
    small = 16 if options.quick else 1  # factor by which cells, rays and pixels per side are fewer
    parts = options.only or PARTS
    if unknown := set(parts) - set(PARTS):
        parser.error(f"PART must be one of {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    studies: dict[str, Callable[[], dict[str, Any]]] = {
        "hits": lambda: hits(512 // small, 5000 // small**2),
        "shadow": lambda: shadow(300 // small, 30_000 // small**2),
        "cache": lambda: cache(small),
        "aliasing": lambda: aliasing(options.figure, 1024 // small, 96 // small),
        "speed-1k": lambda: speed(1024 // small, "1k", not options.without_embree, 1000 // small),
        "speed-4k": lambda: speed(4096 // small, "4k", not options.without_embree, 1000 // small),
        "rugged": lambda: rugged(options.rugged),
        "grazing": lambda: grazing(options.grazing),
    }
    result: dict[str, Any] = {}
    for name in parts:
        found = studies[name]()
        print(name, json.dumps(found), flush=True)
        result |= found
        gc.collect()
    command.save(options, result)


def hits(cells: int, count: int) -> dict[str, Any]:
    """Difference from the reference at four elevations."""
    grid, heights = cases.mountains(cells)
    surface, errors = index(grid, heights), {}
    for elevation in ELEVATIONS:
        rays = random_rays(RANDOM, grid, count, elevation)
        expected, _ = TerrainScan(grid, heights, cases.HEIGHT - 3e4, cases.HEIGHT + 3e4).meet(rays)
        found = trace(surface, rays)
        both = found.hit & expected.hit
        errors[elevation] = np.abs(found.distance[both] - expected.distance[both])
    everything = np.concatenate(list(errors.values()))
    return {
        "hit_median_m": float(np.median(everything)),
        "hit_p99_m": float(np.percentile(everything, 99)),
        "hit_p99_m_of_elevation": {e: float(np.percentile(x, 99)) for e, x in errors.items()},
    }


def grazing(count: int) -> dict[str, Any]:
    """Grazing rays of 2 to 10 degrees: number of rays that hit another ridge than the reference, or
    none."""
    grid, heights = cases.mountains(160)
    surface, wrong, asked = index(grid, heights), 0, 0
    while asked < count:
        rays = random_rays(RANDOM, grid, min(50_000, count - asked), RANDOM.uniform(2, 10))
        expected, _ = TerrainScan(grid, heights, cases.HEIGHT - 5e4, cases.HEIGHT + 5e4).meet(rays)
        found = trace(surface, rays)
        both = found.hit & expected.hit
        wrong += int((found.hit != expected.hit).sum())
        wrong += int((np.abs(found.distance[both] - expected.distance[both]) > 1.0).sum())
        asked += len(rays)
        print(f"  {asked} grazing rays, {wrong} wrong", flush=True)
    return {"wrong_ridge": wrong, "grazing_rays": asked}


def shadow(cells: int, count: int) -> dict[str, Any]:
    """Fraction of points whose shadow differs from the reference, at four heights of the sun."""
    grid, heights = cases.mountains(cells)
    rays = random_rays(RANDOM, grid, count, 80, 0.9)
    ground, reference = (
        Relief(index(grid, heights)),
        TerrainScan(grid, heights, cases.HEIGHT - 2e4, cases.HEIGHT + 2e4),
    )
    wrong, shaded = [], []
    for elevation in (60, 30, 10, 2):
        sun = cases.towards(grid, elevation, np.array([1.0]))[0]
        found, expected = (survey(one, rays, sun) for one in (ground, reference))
        wrong.append(float((found.shadow != expected.shadow).mean()))
        shaded.append(float(expected.shadow.mean()))
    return {"shadow_mismatch": float(np.mean(wrong)), "shaded": shaded}


def cache(small: int) -> dict[str, Any]:
    """A pushbroom over 8192 x 8192 heights, or fewer, with memory for 32 tiles."""
    cells, columns, side = 8192 // small, 2048 // small, 2048 // small
    grid = Grid(np.radians(10.0), np.radians(47.0), cases.STEP, cases.STEP, cells + 1, cells + 1)
    heights = np.tile(fractal(side, side, Streams(1, 0), cases.RELIEF), (5, 5))[
        : cells + 1, : cells + 1
    ]
    ground = Pyramid(Mosaic((Array(grid, heights),)), lowest=0, highest=cases.RELIEF, tiles=32)
    across = np.linspace(0.002, 0.998, columns) * cells
    view = cases.towards(grid, 85, np.zeros(1))
    begin = time.process_time()
    for down in np.linspace(0.002, 0.998, 512 // small) * cells:
        target = cartesian(
            grid.west + across * cases.STEP,
            np.full(columns, grid.north - down * cases.STEP),
            np.full(columns, 700.0),
        )
        ground.meet(
            Rays(target + cases.HEIGHT * view, np.repeat(-view, columns, axis=0), np.zeros(columns))
        )
    return {
        "cache_miss_ratio": ground.cache.misses / len(ground.cache.touched),
        "cache_tiles_touched": len(ground.cache.touched),
        "cache_memory_mb": ground.cache.memory / 1e6,
        "cache_seconds": time.process_time() - begin,
    }


def speed(cells: int, name: str, with_embree: bool, side: int) -> dict[str, Any]:
    """Rays per second downwards and to the sun, compared with embree on the same vertices."""
    grid, heights = cases.mountains(cells)
    index(*cases.mountains(16))  # compiles
    built = best(lambda: index(grid, heights))
    surface = index(grid, heights)
    rays = cases.image_rays(grid, side, 85)
    found = trace(surface, rays)
    nadir = best(lambda: trace(surface, rays))
    point = rays.origin + found.distance[:, None] * rays.direction
    suns = {e: cases.towards(grid, e, np.array([0.7]))[0] for e in (60, 30, 10)}
    shadows = {e: to_sun(point, sun) for e, sun in suns.items()}
    mine = {e: best(lambda r=r: blocked(surface, r, LIFT)) for e, r in shadows.items()}  # type: ignore[misc]
    result: dict[str, Any] = {
        f"nadir_mray_per_s_{name}": len(rays) / nadir / 1e6,
        f"shadow_mray_per_s_{name}": {e: len(rays) / x / 1e6 for e, x in mine.items()},
        f"index_{name}_s": built,
    }
    if name == "4k":
        result |= {
            "nadir_mray_per_s": len(rays) / nadir / 1e6,
            "memory_over_heights": memory(surface) / heights.nbytes,
        }
    if with_embree:
        result |= against_embree(grid, heights, rays, shadows, found.distance, nadir, mine, name)
    return result


def to_sun(point: Floats, sun: Floats) -> Rays:
    return Rays(point, np.broadcast_to(sun, point.shape).copy(), np.zeros(len(point)))


def memory(surface: Surface) -> int:
    return sum(each.nbytes for each in surface if isinstance(each, np.ndarray))


class Embree:
    """embree with the vertices of a grid as triangles, in float32.

    Raises  ImportError without embreex.
    """

    def __init__(self, grid: Grid, heights: NDArray[np.float32]) -> None:
        scenes = import_module("embreex.rtcore_scene")
        meshes = import_module("embreex.mesh_construction")
        longitude = grid.west + np.arange(grid.columns) * grid.step_x
        latitude = grid.north - np.arange(grid.rows) * grid.step_y
        self.middle = cartesian(
            longitude[grid.columns // 2], latitude[grid.rows // 2], np.zeros(())
        )
        corner = np.empty((*heights.shape, 3), np.float32)
        for j, row in enumerate(heights):
            at = cartesian(*np.broadcast_arrays(longitude, latitude[j], row.astype(float)))
            corner[j] = at - self.middle
        corner = corner.reshape(-1, 3)
        number = np.arange(heights.size, dtype=np.int32).reshape(heights.shape)
        a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
        c, d = number[1:, :-1].ravel(), number[1:, 1:].ravel()
        triangles = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
        before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
        self.scene = scenes.EmbreeScene()
        meshes.TriangleMesh(self.scene, corner, triangles)
        self.scene.run(corner[:1], np.ones((1, 3), np.float32))
        self.built = time.process_time() - begin  # second
        self.grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before  # kB

    def single(self, rays: Rays, lift: float = 0.0) -> tuple[Any, Any]:
        """Origins, lifted along the rays (metre), and directions."""
        start = rays.origin + lift * rays.direction - self.middle
        return start.astype(np.float32), rays.direction.astype(np.float32)

    def distance(self, origin: Any, direction: Any) -> Any:
        return self.scene.run(origin, direction, query="DISTANCE")

    def blocked(self, origin: Any, direction: Any) -> Any:
        return self.scene.run(origin, direction, query="OCCLUDED")


def against_embree(
    grid: Grid,
    heights: NDArray[np.float32],
    rays: Rays,
    shadows: dict[int, Rays],
    distance: Floats,
    nadir: float,
    mine: dict[int, float],
    name: str,
) -> dict[str, Any]:
    if command.missing("embree is", "embreex"):
        return {"absent": ["embreex"]}
    embree = Embree(grid, heights)
    looks = embree.single(rays)
    down = best(lambda: embree.distance(*looks))
    error = np.abs(embree.distance(*looks) - distance)
    sunlit = {}
    for elevation, one in shadows.items():
        # A metre above the surface, because of float32.
        sunward = embree.single(one, 1.0)
        sunlit[elevation] = best(lambda s=sunward: embree.blocked(*s))  # type: ignore[misc]
    ratios = {e: sunlit[e] / mine[e] for e in mine}
    result = {
        f"embree_nadir_mray_per_s_{name}": len(rays) / down / 1e6,
        f"embree_error_median_m_{name}": float(np.median(error)),
        f"embree_error_p99_m_{name}": float(np.percentile(error, 99)),
        f"embree_index_{name}_s": embree.built,
        f"embree_memory_{name}_mb": embree.grown / 1024,
        f"nadir_over_embree_{name}": down / nadir,
        f"shadow_over_embree_{name}": float(np.exp(np.mean(np.log(list(ratios.values()))))),
        f"shadow_over_embree_{name}_of_elevation": ratios,
    }
    return result | ({"nadir_over_embree": down / nadir} if name == "4k" else {})


def rugged(python: str | None) -> dict[str, Any]:
    """Orekit's Rugged on the same rays; its time includes a Java call for each ray."""
    if not python:
        print("Rugged is left out: --rugged names no interpreter that has it")
        return {"absent_rugged": True}
    grid, heights = cases.mountains(512)
    rays = random_rays(RANDOM, grid, 3000, 80, 0.2)
    with tempfile.NamedTemporaryFile(suffix=".npz") as file:
        np.savez(
            file.name,
            heights=heights,
            grid=np.array([grid.west, grid.south, grid.step_x]),
            origin=rays.origin,
            direction=rays.direction,
        )
        script = str(Path(__file__).with_name("terrain_rugged.py"))
        told = subprocess.run(
            [python, script, file.name], capture_output=True, text=True, check=True
        ).stdout
    answer = json.loads(told.splitlines()[-1])
    surface = index(grid, heights)
    found = trace(surface, rays)
    error = np.linalg.norm(
        cartesian(*np.array(answer["place"]).T) - cartesian(*found.place.T), axis=1
    )
    mine = best(lambda: trace(surface, rays))
    return {
        "rugged_difference_median_m": float(np.median(error)),
        "rugged_difference_p99_m": float(np.percentile(error, 99)),
        "over_rugged_with_its_calls": answer["seconds"] / mine,
    }


def aliasing(figure: Path | None, cells: int, side: int) -> dict[str, Any]:
    """Brightness of slopes in pixels of eight cells: finest level and pyramid.

    The truth is the mean of 32 x 32 rays of each pixel on the finest level.
    """
    pixel, edge = 8, (cells - 8 * side) // 4  # cells in a pixel, and in the margin of the picture
    grid = Grid(np.radians(10.0), np.radians(47.0), cases.STEP, cases.STEP, cells + 1, cells + 1)
    heights = fractal(cells + 1, cells + 1, Streams(3, 0), 400.0, 1.2)
    sun = cases.towards(grid, 25, np.array([0.7]))[0]
    mosaic = Mosaic((Array(grid, heights),))

    def render(rays_per_side: int, sharpness: float) -> tuple[Floats, float]:
        count = side * rays_per_side
        at = edge + (np.arange(count) + 0.5) / rays_per_side * pixel
        u, v = np.meshgrid(at, at)
        target = cartesian(
            grid.west + u.ravel() * cases.STEP,
            grid.north - v.ravel() * cases.STEP,
            np.zeros(count**2),
        )
        view = np.broadcast_to(cases.towards(grid, 89, np.zeros(1)), target.shape)
        ground = Pyramid(mosaic, lowest=0, highest=500, sharpness=sharpness)
        spread = pixel * cases.STEP * 6378137 / rays_per_side / cases.HEIGHT
        rays = Rays(target + cases.HEIGHT * view, -view.copy(), np.full(count**2, spread))
        survey(ground, rays[: min(1000, len(rays))], sun)  # loads tiles into the cache
        begin = time.process_time()
        found = survey(ground, rays, sun)
        seconds = time.process_time() - begin
        bright = np.where(found.shadow, 0.0, np.cos(found.sun_incidence))
        return bright.reshape(side, rays_per_side, side, rays_per_side).mean(axis=(1, 3)), seconds

    truth, _ = render(32, 0.0)
    curves: dict[str, list[dict[str, float]]] = {}
    images = {"truth": truth}
    for name, sharpness in (("finest level", 0.0), ("pyramid", 1.0)):
        curves[name] = []
        for rays_per_side in (1, 2, 4, 8):
            image, seconds = render(rays_per_side, sharpness)
            images.setdefault(name, image)
            error = float(np.sqrt(np.mean((image - truth) ** 2)))
            curves[name].append(
                {"rays": rays_per_side**2, "rms": error, "us_per_pixel": seconds / side**2 * 1e6}
            )
    if figure:
        draw(figure, images, curves)
    one = {name: curve[0]["rms"] for name, curve in curves.items()}
    return {
        "aliasing_contrast": float(truth.std()),
        "aliasing_fall": one["finest level"] / one["pyramid"],
        "aliasing": curves,
    }


@styled
def draw(path: Path, images: dict[str, Floats], curves: dict[str, list[dict[str, float]]]) -> None:
    figure = picture(8.5, "Rough terrain in pixels of 8 x 8 cells, the Sun at 25 deg")
    grid = figure.add_gridspec(3, 3)
    titles = {
        "truth": "1024 rays a pixel",
        "finest level": "finest level, 1 ray a pixel",
        "pyramid": "pyramid, 1 ray a pixel",
    }
    low, high = np.percentile(images["truth"], [0.5, 99.5])
    for column, name in enumerate(("truth", "finest level", "pyramid")):
        axes = figure.add_subplot(grid[0, column])
        shown = axes.imshow(images[name], cmap="gray", vmin=low, vmax=high)
        axes.set(title=fill(titles[name], 18), xlabel="column (pixel)", ylabel="row (pixel)")
        axes.grid(visible=False)
        label = "cosine to the Sun (1)"
        colour_bar(shown, axes, images[name], label, orientation="horizontal", aspect=14)
    left, right = figure.add_subplot(grid[1, :]), figure.add_subplot(grid[2, :])
    for (name, curve), mark in zip(curves.items(), MARKERS, strict=False):
        rms = [each["rms"] for each in curve]
        left.loglog([each["rays"] for each in curve], rms, f"{mark}-", label=name)
        right.loglog([each["us_per_pixel"] for each in curve], rms, f"{mark}-", label=name)
    left.set(xlabel="rays per pixel (number)", ylabel="rms error of the brightness (1)")
    right.set(xlabel="CPU time per pixel (us)", ylabel="rms error of the brightness (1)")
    legend_below(right, 4)
    save_picture(path, figure)


def best(call: Callable[[], Any], repeats: int = 3) -> float:
    call()
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return min(times)


if __name__ == "__main__":
    command.run(main)

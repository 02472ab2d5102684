"""Rays from an orbit meet mountains, against the search of every cell on exact coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.benchmark.mountains import HEIGHT, STEP, image_rays, mountains
from startrack.benchmark.stage import Stage
from startrack.scene.earth import Level, Rays, Scan, index
from startrack.scene.earth.trace import trace

CELLS, SIDE, ELEVATION = 512, 400, 60  # cells and rays a side; degree
JUDGED = slice(None, None, 37)  # rays that the reference is asked for


def rays_down() -> Rays:
    """Parallel rays in rows and columns."""
    return image_rays(mountains(CELLS)[0], SIDE, ELEVATION)


def terrain() -> Stage:
    """The median error of the distance; a level surface is what one has without terrain."""
    grid, heights = mountains(CELLS)
    surface, rays = index(grid, heights), rays_down()
    reference, _ = Scan(grid, heights, HEIGHT - 3e4, HEIGHT + 3e4).meet(rays[JUDGED])
    level = Level(float(heights.mean()))

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

"""Ground line by line from an EarthScene: what each ray of an image meets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from startrack.core import Camera, Floats
from startrack.earth.geometry.parameters import EarthScene
from startrack.earth.geometry.sensor import together
from startrack.earth.geometry.sight import Jitter, scan_lines
from startrack.earth.terrain import Ground, read_charts, survey
from startrack.space import sun_direction

BATCH = 2**17  # rays at a time, which limit the memory; chosen by hand


@dataclass(frozen=True, eq=False)
class Strip:
    """Some lines of an image and the ground that they see.

    first   number of its first line
    shape   lines, columns, rays of a pixel: how the rays of the ground are ordered
    ground  of all rays
    """

    first: int
    shape: tuple[int, int, int]
    ground: Ground

    def mean(self, values: Floats) -> Floats:
        """(lines, columns) mean over the rays of each pixel that have a value; NaN of none."""
        rays = np.asarray(values, float).reshape(self.shape)
        known = np.isfinite(rays)
        with np.errstate(invalid="ignore"):
            return np.where(known, rays, 0).sum(axis=2) / known.sum(axis=2)


def observe_earth(
    scene: EarthScene, folder: Path, turn: Jitter | None = None, camera: Camera | None = None
) -> Iterator[Strip]:
    """Ground that all pixels of a scene see, some lines at a time.

    folder   folder of the files
    turn     attitude jitter, as in `sight`
    camera   of the sensor's pixels, with its distortion; None: the sensor's own, without
    """
    terrain, charts = scene.terrain.open(folder), scene.terrain.charts(folder)
    cell = terrain.terrain.grid.step_y
    sensor, orbit = scene.sensor, scene.carrier
    elements, dating = sensor.elements(orbit), sensor.dating(orbit)
    sun = sun_direction(orbit.epoch, sensor.delay)
    rays_of_line = elements[0].x.size * sensor.rays**2
    step = max(1, BATCH // rays_of_line)
    for first in range(0, sensor.lines, step):
        count = min(step, sensor.lines - first)
        row, lines = elements[0], np.arange(first, first + count, dtype=np.float64)
        if len(elements) > 1:  # a matrix, whose rows are exposed together
            row, lines = together(elements[first : first + count]), np.zeros(1)
        rays = scan_lines(
            camera or sensor.camera, row, lines, dating, orbit, scene.pointing, turn, sensor.rays
        )
        ground = survey(terrain, rays, sun, scene.sky_rays)
        ground = read_charts(ground, charts, cell)
        shape = (count, sensor.columns, len(rays) // (count * sensor.columns))
        yield Strip(first, shape, ground)

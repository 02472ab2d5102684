"""Points where rays meet a surface, by a search of every cell: the slow, simple reference.

The search shares only the surface's definition with the march. Meridians are planes and parallels
are cones, so the intersections of a ray with the borders of cells have a closed form. Between
borders the height above the surface is searched with exact geodetic coordinates.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.core import Flags, Floats, kernel
from startrack.earth.terrain.ellipsoid import ECCENTRICITY_2, EQUATORIAL, vertical
from startrack.earth.terrain.ground import Levels, Rays
from startrack.earth.terrain.march import HIT, MISS
from startrack.earth.terrain.surface import FULL_TURN, Grid, index
from startrack.earth.terrain.trace import RayHits, describe_all, no_hits

SAMPLES = 5  # samples of the height above the surface in each cell
GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True, eq=False)
class TerrainScan:
    """The reference: it searches every cell between two distances in metres along each ray."""

    grid: Grid
    heights: NDArray[np.floating]
    start: float
    stop: float

    def meet(self, rays: Rays) -> tuple[RayHits, Levels]:
        """The first cell in which each ray lies on or under the surface."""
        hits = no_hits(len(rays))
        heights = self.heights.astype(np.float32)
        hits.distance[:] = self._search(heights, rays, self.start)
        hits.status[:] = np.where(np.isfinite(hits.distance), HIT, MISS)
        point = rays.origin + np.where(hits.hit, hits.distance, np.nan)[:, None] * rays.direction
        describe_all(index(self.grid, heights), point, hits.hit, hits.place, hits.normal)
        return hits, np.zeros(len(rays), np.int8)

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """Whether rays meet the surface from `start` on, over the same length."""
        return np.isfinite(self._search(self.heights, rays, start))

    def _search(self, heights: NDArray[np.floating], rays: Rays, start: float) -> Floats:
        """Distance (n,) metre at which each ray first lies on or under the surface, or infinity.

        Accuracy  numerical: 1e-9 m, by bisection; a dip under the surface shorter than a fifth of a
                  cell is found only where a parabola shows it.
        """
        shape = (self.grid.west, self.grid.north, self.grid.step_x, self.grid.step_y)
        stop = start + (self.stop - self.start)
        return _scan(shape, heights, rays.origin, rays.direction, start, stop)


@kernel
def _scan(grid, heights, origin, direction, start, stop):  # type: ignore[no-untyped-def]
    rows, columns = heights.shape
    out = np.full(len(origin), np.inf)
    borders = np.empty(2 * (rows + columns) + 2)
    for n in range(len(origin)):
        count = _borders(grid, rows, columns, origin[n], direction[n], start, stop, borders)
        ordered = np.sort(borders[:count])
        for k in range(count - 1):
            if ordered[k + 1] > ordered[k]:
                distance = _search(
                    grid, heights, origin[n], direction[n], ordered[k], ordered[k + 1]
                )
                if distance < math.inf:
                    out[n] = distance
                    break
    return out


@kernel
def _borders(grid, rows, columns, origin, direction, start, stop, out):  # type: ignore[no-untyped-def]
    """All distances where a line crosses a meridian or a parallel of the grid."""
    west, north, step_x, step_y = grid
    out[0], out[1] = start, stop
    count = 2
    for i in range(columns):
        longitude = west + i * step_x
        sine, cosine = math.sin(longitude), math.cos(longitude)
        across = cosine * direction[1] - sine * direction[0]
        at = -(cosine * origin[1] - sine * origin[0]) / across
        if start < at < stop:
            out[count] = at
            count += 1
    for j in range(rows):
        # The cone of one latitude: x^2 + y^2 = cot^2 (z - apex)^2, written with sine and cosine.
        sine, cosine = math.sin(north - j * step_y), math.cos(north - j * step_y)
        apex = -ECCENTRICITY_2 * EQUATORIAL / math.sqrt(1 - ECCENTRICITY_2 * sine**2) * sine
        s2, c2, z = sine * sine, cosine * cosine, origin[2] - apex
        a = s2 * (direction[0] ** 2 + direction[1] ** 2) - c2 * direction[2] ** 2
        b = s2 * (origin[0] * direction[0] + origin[1] * direction[1]) - c2 * z * direction[2]
        c = s2 * (origin[0] ** 2 + origin[1] ** 2) - c2 * z * z
        root = b * b - a * c
        if root < 0:
            continue
        root = math.sqrt(root)
        q = -(b + math.copysign(root, b))
        for at in (q / a, c / q):
            if start < at < stop:
                out[count] = at
                count += 1
    return count


@kernel
def _search(grid, heights, origin, direction, begin, end):  # type: ignore[no-untyped-def]
    """First distance within one cell at which the ray is not above the surface."""
    _west, _north, step_x, _step_y = grid
    rows, columns = heights.shape
    middle = 0.5 * (begin + end)
    u, v, _ = _place(grid, columns, origin, direction, middle)
    i, j = math.floor(u), math.floor(v)
    closed = columns * step_x > FULL_TURN - 0.5 * step_x
    if i < 0 or j < 0 or j > rows - 2 or i > columns - (1 if closed else 2):
        return math.inf
    after = (i + 1) % columns
    corner = (heights[j, i], heights[j, after], heights[j + 1, i], heights[j + 1, after])
    low, value = begin, _clear(grid, columns, corner, j, i, origin, direction, begin)
    if value <= 0:
        return begin
    step = (end - begin) / SAMPLES
    before, high = value, begin
    for k in range(1, SAMPLES + 1):
        high = begin + k * step
        value = _clear(grid, columns, corner, j, i, origin, direction, high)
        if value <= 0:
            return _bisect(grid, columns, corner, j, i, origin, direction, low, high)
        # Golden section finds a dip between the samples, unless a straight line excludes it.
        if min(before, value) < step:
            a, b = low, high
            while b - a > 1e-7:
                near, far = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
                if _clear(grid, columns, corner, j, i, origin, direction, near) < _clear(
                    grid, columns, corner, j, i, origin, direction, far
                ):
                    b = far
                else:
                    a = near
            if _clear(grid, columns, corner, j, i, origin, direction, a) <= 0:
                return _bisect(grid, columns, corner, j, i, origin, direction, low, a)
        low, before = high, value
    return math.inf


@kernel
def _bisect(grid, columns, corner, j, i, origin, direction, low, high):  # type: ignore[no-untyped-def]
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if _clear(grid, columns, corner, j, i, origin, direction, middle) > 0:
            low = middle
        else:
            high = middle
    return high


@kernel
def _place(grid, columns, origin, direction, s):  # type: ignore[no-untyped-def]
    """Column, row and height of a point of a ray."""
    west, north, step_x, step_y = grid
    x, y = origin[0] + s * direction[0], origin[1] + s * direction[1]
    z = origin[2] + s * direction[2]
    sine, cosine, height, _ = vertical(x, y, z)
    turn = FULL_TURN / step_x
    u = ((math.atan2(y, x) - west) / step_x) % turn
    if u > 0.5 * (turn + columns):
        u -= turn
    return u, (north - math.atan2(sine, cosine)) / step_y, height


@kernel
def _clear(grid, columns, corner, j, i, origin, direction, s):  # type: ignore[no-untyped-def]
    """Height of a point of a ray above the surface of a cell, metre; NaN in a hole."""
    u, v, height = _place(grid, columns, origin, direction, s)
    turn = FULL_TURN / grid[2]
    u -= i
    u -= turn * math.floor(u / turn + 0.5)
    v -= j
    upper, lower = corner[0] + (corner[1] - corner[0]) * u, corner[2] + (corner[3] - corner[2]) * u
    return height - (upper + (lower - upper) * v)

"""Grids that find directions within an angle, and spots near a position."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Ints, kernel

Indices = NDArray[np.int32]

MOST_CUBES = 80  # most cubes along an axis: their table takes 2 MB; chosen by hand


class SkyGrid(NamedTuple):
    """Stars sorted into the cubes of a grid over [-1, 1]^3.

    Cubes in space have neither poles nor a jump of right ascension. Most cubes are empty; an empty
    cube costs one access to `start`.

    side       number of cubes along an axis
    start      (side^3 + 1,) index of the first star of each cube in `member`
    member     (n,) index of each star in the directions from which the grid was made
    direction  (n, 3) unit vectors, in the order of `member`
    """

    side: int
    start: Indices
    member: Indices
    direction: Floats


class VerificationStars(NamedTuple):
    """The stars that verify hypotheses, and their brightness.

    sky        n directions
    magnitude  (n,) expected, except for the zero point
    blur       (n,) magnitude, standard deviation of `magnitude`
    """

    sky: SkyGrid
    magnitude: Floats
    blur: Floats


def sky_grid(direction: Floats, spacing: float) -> SkyGrid:
    """Sort unit vectors into cubes.

    direction  (n, 3) unit vectors
    spacing    radian, smallest edge of a cube; a third of the radius of the cones is best
    """
    side = cubes(spacing)
    cell = np.minimum(((direction + 1) / 2 * side).astype(np.int64), side - 1)
    key = (cell[:, 0] * side + cell[:, 1]) * side + cell[:, 2]
    member = np.argsort(key, kind="stable").astype(np.int32)
    start = np.searchsorted(key[member], np.arange(side**3 + 1)).astype(np.int32)
    return SkyGrid(side, start, member, np.ascontiguousarray(direction[member]))


def cubes(spacing: float) -> int:
    """Number of cubes of at least this edge along an axis."""
    return int(min(max(2 / spacing, 1), MOST_CUBES))


@kernel
def cubes_around(grid: SkyGrid, axis: Floats, radius: float) -> tuple[Ints, Ints]:
    """First and last cubes (3,) along each axis that a cone can touch."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(3):
        low[k] = max(int((axis[k] - radius + 1) / 2 * grid.side), 0)
        high[k] = min(int((axis[k] + radius + 1) / 2 * grid.side), grid.side - 1)
    return low, high


@kernel
def most_within(grid: SkyGrid, low: Ints, high: Ints) -> int:
    """Number of stars in these cubes."""
    most = 0
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            row = (i * grid.side + j) * grid.side
            most += grid.start[row + high[2] + 1] - grid.start[row + low[2]]
    return most


@kernel
def cone(grid: SkyGrid, axis: Floats, radius: float) -> Indices:
    """Indices into `grid.member` of the stars within an angle of an axis.

    axis    (3,) unit vector
    radius  radian
    """
    low, high = cubes_around(grid, axis, radius)
    inside = np.empty(most_within(grid, low, high), np.int32)
    count = 0
    limit = np.cos(min(radius, np.pi))
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            row = (i * grid.side + j) * grid.side
            for s in range(grid.start[row + low[2]], grid.start[row + high[2] + 1]):
                d = grid.direction[s]
                if d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2] >= limit:
                    inside[count] = s
                    count += 1
    return inside[:count]


MOST_CELLS = 160  # most cells along an axis: the 50 kB of the grid stay in the processor's cache


class SpotGrid(NamedTuple):
    """A grid over the image; each cell has the index of a spot at most one cell away, or -1.

    cell    (columns, rows)
    low     (2,) corner of the grid in the image plane
    width   1, of a cell in the image plane
    radius  1, largest distance between a position and its spot
    """

    cell: NDArray[np.int16]
    low: Floats
    width: float
    radius: float


@kernel
def spot_grid(plane: Floats, low: Floats, high: Floats, radius: float) -> SpotGrid:
    """Make the grid; each cell gets the spot nearest to its centre.

    plane      (n, 2) spots in the image plane, fewer than 32768
    low, high  (2,) corners of the image
    radius     1, as in `SpotGrid`
    """
    width = max(radius, max(high[0] - low[0], high[1] - low[1]) / MOST_CELLS)
    columns = math.ceil((high[0] - low[0]) / width) + 1
    rows = math.ceil((high[1] - low[1]) / width) + 1
    cell = np.full((columns, rows), -1, np.int16)
    for n in range(len(plane)):
        x, y = (plane[n, 0] - low[0]) / width, (plane[n, 1] - low[1]) / width
        i, j = math.floor(x), math.floor(y)
        for k in range(max(i - 1, 0), min(i + 2, columns)):
            for m in range(max(j - 1, 0), min(j + 2, rows)):
                other = cell[k, m]
                if other >= 0:
                    ox = (plane[other, 0] - low[0]) / width - k - 0.5
                    oy = (plane[other, 1] - low[1]) / width - m - 0.5
                    if ox * ox + oy * oy <= (x - k - 0.5) ** 2 + (y - m - 0.5) ** 2:
                        continue
                cell[k, m] = n
    return SpotGrid(cell, low, width, radius)


@kernel
def hits(screen: SpotGrid, plane: Floats, place: Floats) -> int:
    """Number of positions within the radius of a spot; rarely too small, if spots are close.

    plane  (n, 2) the spots of the grid
    place  (m, 2) positions in the image plane, all inside the image
    """
    met = 0
    for j in range(len(place)):
        x, y = place[j]
        i = int((x - screen.low[0]) / screen.width)
        k = int((y - screen.low[1]) / screen.width)
        n = screen.cell[i, k]
        if n >= 0 and (plane[n, 0] - x) ** 2 + (plane[n, 1] - y) ** 2 <= screen.radius**2:
            met += 1
    return met

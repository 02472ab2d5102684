"""A grid of spots that finds the spot near a position with one array access.

Most hypotheses are false: no star except those that they were made from lies near a spot. The grid
makes this test fast, because it is done for every star of every hypothesis.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, kernel

MOST_CELLS = 160  # along an axis: 50 kB, so that the grid stays in the processor's cache


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
def spot_grid(
    plane: Floats, low: Floats, high: Floats, radius: float
) -> SpotGrid:  # pragma: no cover
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
def hits(sieve: SpotGrid, plane: Floats, place: Floats) -> int:  # pragma: no cover
    """Number of positions within the radius of a spot; rarely too small, where spots are close.

    plane  (n, 2) the spots of the grid
    place  (m, 2) positions in the image plane, all inside the image
    """
    met = 0
    for j in range(len(place)):
        x, y = place[j]
        i = int((x - sieve.low[0]) / sieve.width)
        k = int((y - sieve.low[1]) / sieve.width)
        n = sieve.cell[i, k]
        if n >= 0 and (plane[n, 0] - x) ** 2 + (plane[n, 1] - y) ** 2 <= sieve.radius**2:
            met += 1
    return met

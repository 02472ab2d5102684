"""One pyramid of tiles from sources of different resolution and extent, the best source first."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from startrack.core import Flags, Floats, Singles
from startrack.earth.terrain.sources import Source
from startrack.earth.terrain.surface import FULL_TURN, SEAM, Grid
from startrack.earth.terrain.tile import CELLS, VERTICES


@dataclass(frozen=True, eq=False)
class Mosaic:
    """Sources that cover parts of one grid.

    A level has every second vertex of the level before. Each vertex has the value of the finest
    source that covers it.

    sources  the sources, in any order
    """

    sources: tuple[Source, ...]

    def __post_init__(self) -> None:
        if not self.sources:
            raise ValueError("sources must have one entry or more, got none")

    @cached_property
    def ordered(self) -> tuple[Source, ...]:
        """The sources, smallest cells first."""
        return tuple(sorted(self.sources, key=lambda own: own.grid.step_y * own.grid.step_x))

    @cached_property
    def grid(self) -> Grid:
        """The vertices of level 0: spaced as in the finest source, over the extent of all
        sources."""
        first = self.ordered[0].grid
        if first.closed:
            west, columns = first.west, first.columns
        else:
            west, width = _span([source.grid for source in self.sources])
            before = math.floor((first.west - west) % FULL_TURN / first.step_x + SEAM)
            west = first.west - before * first.step_x
            columns = math.ceil(width / first.step_x - SEAM) + 1
            columns = min(columns, round(FULL_TURN / first.step_x))
        north = max(source.grid.north for source in self.sources)
        south = min(source.grid.south for source in self.sources)
        before = math.floor((north - first.north) / first.step_y + SEAM)
        north = first.north + before * first.step_y
        rows = math.floor((north - south) / first.step_y + SEAM) + 1
        return Grid(west, north, first.step_x, first.step_y, columns, rows)

    @cached_property
    def levels(self) -> int:
        """Number of levels, down to a level of a few cells; around the Earth, down to the last
        closed level."""
        grid = self.grid
        coarsest = max(1, (min(grid.columns, grid.rows) - 1).bit_length() - 1)
        if not grid.closed:
            return coarsest
        return min(coarsest, (grid.columns & -grid.columns).bit_length())

    def shape(self, level: int) -> tuple[int, int]:
        """Cells down and across at a level; they extend beyond the edges by less than a cell."""
        return -(-(self.grid.rows - 1) >> level), -(-self.grid.cells_across >> level)

    def level_of(self, place: Floats) -> NDArray[np.int8]:
        """The level of the finest source at longitudes and latitudes (n, 2); (n,).

        The level of the coarsest source holds outside all sources.
        """
        finest = self.grid.step_y
        levels = [
            min(round(math.log2(own.grid.step_y / finest)), self.levels - 1) for own in self.ordered
        ]
        out = np.full(len(place), levels[-1], np.int8)
        for source, level in zip(reversed(self.ordered), reversed(levels), strict=True):
            grid = source.grid
            east = (place[:, 0] - grid.west) % FULL_TURN
            inside = (
                (east <= grid.cells_across * grid.step_x)
                & (place[:, 1] <= grid.north)
                & (place[:, 1] >= grid.south)
            )
            out[inside] = level
        return out

    def window(self, level: int, j: int, i: int) -> Grid | None:
        """The vertices of one tile within the grid; None beyond a pole."""
        grid, scale = self.grid, 1 << level
        step_x, step_y = grid.step_x * scale, grid.step_y * scale
        down, across = self.shape(level)
        north = grid.north - j * CELLS * step_y
        rows = min(VERTICES, down - j * CELLS + 1, int((north + math.pi / 2) / step_y + SEAM) + 1)
        columns = min(VERTICES, across - i * CELLS + 1)
        if rows < 2:
            return None
        return Grid(grid.west + i * CELLS * step_x, north, step_x, step_y, columns, rows)

    def read(self, level: int, j: int, i: int) -> Singles:
        """The values of one tile, (513, 513); NaN where no source has a value."""
        tile = np.full((VERTICES, VERTICES), np.nan, np.float32)
        window = self.window(level, j, i)
        if window:
            part = tile[: window.rows, : window.columns]
            for source in self.ordered:
                np.copyto(part, source.read(window), where=np.isnan(part))
                if not np.isnan(part).any():
                    break
        return tile

    def covers(self, longitude: Floats, latitude: Floats) -> Flags:
        """Whether points (n,), in radian, lie within any source."""
        inside = np.zeros(longitude.shape, np.bool_)
        for source in self.ordered:
            inside |= source.covers(longitude, latitude)
        return inside


def _span(grids: list[Grid]) -> tuple[float, float]:
    """West edge and width of the shortest span of longitudes that contains all grids."""
    best = (0.0, math.inf)
    for first in grids:
        if first.closed:
            return first.west, FULL_TURN
        width = max(
            (grid.west - first.west) % FULL_TURN + (grid.columns - 1) * grid.step_x
            for grid in grids
        )
        best = min(best, (first.west, width), key=lambda span: span[1])
    return best[0], min(best[1], FULL_TURN)
